"""`torchlinf score --ray`: the command's side of `torchlinf.scoring.ray`."""

import logging
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict
from pathlib import Path

import typer

from torchlinf.cli.inputs import tell_passed_over
from torchlinf.cli.outputs import INTERRUPTED, end_if_failed, fail, is_standard_output, say
from torchlinf.scoring import Part, ScoreOptions, find_shards
from torchlinf.scoring.ray import connected, score_shards

# What is the name of a file rather than of a folder.
FILES = (".csv", ".tsv", ".json", ".jsonl", ".ndjson", ".parquet", ".gz", ".xlsx")

Progress = Callable[[int, int, bool], AbstractContextManager[Callable[[], None]]]


def score_on_ray(
    paths: Sequence[Path],
    out: Path | None,
    address: str,
    workers: int,
    options: ScoreOptions,
    progress: Progress,
) -> None:
    """Score masks into a folder of Parquet files; the arguments are those of the command.

    Raises:
        typer.BadParameter: there is no folder to write to, or no mask.
        typer.Exit: some masks failed (1), or all had to end (2).
    """
    if out is None or is_standard_output(out) or out.suffix.lower() in FILES or out.is_file():
        raise typer.BadParameter(
            f"--ray writes a folder of Parquet files; got {out}. Pass for example --out scores/", param_hint="--out"
        )
    passed_over: Counter[str] = Counter()
    shards = find_shards(paths, passed_over=passed_over)
    tell_passed_over(passed_over)
    if not shards:
        raise typer.BadParameter(f"no masks found in {', '.join(map(str, paths))}")
    parts: list[Part] = []
    chosen = {**asdict(options.reading), **options.measuring, "members": options.members}
    try:
        with _quiet(), connected(address, workers=workers), progress(0, len(shards), True) as advance:
            for part in score_shards(shards, out, **chosen):
                parts.append(part)
                advance()
    except KeyboardInterrupt:
        say("Stopped; the same command goes on with the parts that are missing.")
        raise typer.Exit(INTERRUPTED) from None
    except ConnectionError as error:
        fail(f"Ray cannot be reached at {address} ({_first_line(error)}).")
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else _first_line(error)
        fail(f"The table cannot be written ({why}); it has {len(parts)} of {len(shards)} parts.")
    except (ImportError, ValueError) as error:
        fail(_first_line(error))
    if before := sum(part.seconds == 0.0 for part in parts):
        say(f"{before} of {len(parts)} parts were in {out} already.")
    end_if_failed(sum(part.failed for part in parts), sum(part.masks for part in parts))


@contextmanager
def _quiet() -> Iterator[None]:
    """Ray's loggers, which it makes as it goes, report its own steps and where it keeps more of them."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)
