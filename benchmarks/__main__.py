"""Run the benchmarks: `python -m benchmarks [--quick] [--only NAME] [--out FOLDER]`."""

import argparse
import dataclasses
import time
from pathlib import Path

import torchlinf
from benchmarks import report
from benchmarks.questions import QUESTIONS
from benchmarks.results import environment, markdown, save, target_table
from benchmarks.sizes import SIZES

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
DOCS = ROOT / "docs"


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, and store what is to be kept."""
    options = _parser().parse_args(arguments)
    size = SIZES[options.size]
    results, docs = (options.out, options.out) if options.out else (RESULTS, DOCS)
    keep = options.out is not None or size.name == "full"
    if not options.report:
        torchlinf.warm_up()  # or the first contender would be timed with its compilation
    for name in [] if options.report else options.only or QUESTIONS:
        began = time.perf_counter()
        setting = environment(size.name)
        result = dataclasses.replace(QUESTIONS[name](size), environment=setting)
        print(f"## {result.title} ({time.perf_counter() - began:.0f} s)\n\n{target_table([result])}", flush=True)
        print("\n".join(markdown(table) for table in result.tables), flush=True)
        if keep:
            save(result, results)
    if keep or options.report:
        for path in report.write(report.stored(results, list(QUESTIONS)), docs):
            print(f"wrote {path}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--size", choices=SIZES, default="full", help="full (default), quick, or toy")
    size.add_argument("--quick", dest="size", action="store_const", const="quick", help="the same as --size quick")
    parser.add_argument("--only", action="append", choices=QUESTIONS, metavar="NAME", help=f"of {', '.join(QUESTIONS)}")
    parser.add_argument(
        "--out",
        type=Path,
        help="folder for results, tables and plots; by default a full run renews those of the repository, and smaller "
        "ones only print",
    )
    parser.add_argument("--report", action="store_true", help="measure nothing: renew tables and plots from results")
    return parser


if __name__ == "__main__":
    main()
