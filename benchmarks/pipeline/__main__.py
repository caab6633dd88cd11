"""Measure the entry points: `python -m benchmarks.pipeline [--only labels] [--threads 1]`; prints Markdown tables."""

import argparse
from statistics import median

import torch

from benchmarks import shapes
from benchmarks.pipeline import files, labels, loader, regions, shards
from benchmarks.timing import Ratio


def main(arguments: list[str] | None = None) -> None:
    """Print one table a question."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pipeline", description=__doc__)
    parser.add_argument("--only", choices=("files", "labels", "loader", "regions", "shards"), help="one question")
    parser.add_argument("--threads", type=int, default=1, help="torch's threads, for the label map")
    parser.add_argument("--toy", action="store_true", help="sizes that say nothing, for tests")
    options = parser.parse_args(arguments)
    torch.set_num_threads(options.threads)
    if options.only in (None, "files"):
        print(_files(files.run(24, 2, 8, 1) if options.toy else files.run()), flush=True)
    if options.only in (None, "labels"):
        print(_labels(labels.run(128, 9, 1) if options.toy else labels.run()), flush=True)
    if options.only in (None, "loader"):
        print(_loader(loader.run(4, 48, 1, 1) if options.toy else loader.run()), flush=True)
    if options.only in (None, "regions"):
        print(_regions(regions.run(24, 1, (8,)) if options.toy else regions.run()), flush=True)
    if options.only in (None, "shards"):
        print(_shards(shards.run(24, 40, 2, 1) if options.toy else shards.run()), flush=True)


def _files(answer: files.Answer) -> str:
    gains, rates = answer.gains, [turn.rate for turn in answer.one]
    return (
        f"| PNG files, {shapes.origin()} | |\n|---|---|\n"
        f"| scored in a second of processor time | {1e3 / answer.each:.0f} |\n"
        f"| ms a mask | {answer.each:.2f} |\n"
        f"| of which reading | {100 * answer.reading / answer.each:.0f} % |\n"
        f"| one worker, masks a second on the clock | {median(rates):.0f} |\n"
        f"| two workers, times as many | {median(gains):.2f} ({min(gains):.2f} to {max(gains):.2f}) |\n"
        f"| the same by processor time, on two cores that do nothing else | {answer.gain_of_two_cores:.2f} |\n"
    )


def _labels(answer: labels.Answer) -> str:
    return (
        "| label map | |\n|---|---|\n"
        f"| `labels.complexity_table`, {answer.objects:,} objects | {answer.seconds:.2f} s |\n"
        f"| a loop over boxes cut by `regionprops`, times as long | {_times(answer.cropped)} |\n"
        f"| the same in processor time | {answer.cropped.cpu:.2f} |\n"
        f"| a loop over `label_map == label`, times as long | {answer.full:.0f} |\n"
    )


def _loader(answers: list[loader.Answer]) -> str:
    rows = [
        f"| {answer.name} | {answer.each:.1f} | {_times(answer.slowdown)} | {answer.agreement:.3f} |"
        for answer in answers
    ]
    head = "| scored | ms a sample, one process | an epoch with two workers, times as long | rank correlation |"
    return "\n".join([head, "|---|---|---|---|", *rows, ""])


def _regions(answers: list[regions.Answer]) -> str:
    rows = [
        f"| {answer.width} | {answer.milliseconds:.0f} | {_times(answer.background)} | {_times(answer.opened)} |"
        for answer in answers
    ]
    head = "| units a layer | ms, the network on the grid | complexity, times as long | with the open frame |"
    return "\n".join([head, "|---|---|---|---|", *rows, ""])


def _shards(answer: shards.Answer) -> str:
    stages = [f"| {stage.name} | {stage.median:.3f} | {stage.least:.3f} |" for stage in answer.stages]
    return "\n".join(
        [
            f"{answer.masks:,} masks of {answer.pixels:,.0f} pixels inside, in {answer.shards} tar shards; a mask: "
            f"{answer.bytes_in:,.0f} bytes in, {answer.bytes_out:,.0f} out\n",
            "| stage | processor time a mask, ms: median | least |\n|---|---|---|",
            *stages,
            f"| all, shards to parts in one process | {answer.local:.3f} | |",
            f"| all, by the workers of a local Ray | {answer.workers:.3f} | |",
            f"| beside that, by Ray's other processes and the program | {answer.around:.3f} | |",
            f"\nRay's start and its workers' imports: {answer.start:.1f} s of processor time\n",
        ]
    )


def _times(ratio: Ratio) -> str:
    return f"{ratio.median:.2f} ({ratio.low:.2f} to {ratio.high:.2f})"


if __name__ == "__main__":
    main()
