"""The tables that a command reads and writes: what is refused, before the work if it can be, and in which words."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import typer

from torchlinf.scoring import JOURNAL, SUFFIXES, TAR_SUFFIXES, NoTableError, Score, Source

# 128 + the number of the signal, as a shell reports a program that SIGINT (Ctrl-C) or SIGPIPE (`| head`) ended.
WRONG, INTERRUPTED, PIPE_CLOSED = 2, 130, 141

STATUS = (
    "Exit status: 0 all fine, 1 some masks failed, 2 wrong usage or an output that cannot be written, 130 stopped by "
    "Ctrl-C."
)


@contextmanager
def endings(out: Path | None) -> Iterator[None]:
    """What ends a run, as a message and an exit status."""
    try:
        yield
    except KeyboardInterrupt:
        if out is not None:
            typer.echo("Stopped; the same command goes on where this one was.", err=True)
        raise typer.Exit(INTERRUPTED) from None
    except BrokenPipeError:
        raise typer.Exit(PIPE_CLOSED) from None
    except ImportError as error:
        fail(str(error))
    except RuntimeError as error:
        from torchlinf.scoring import NoWorkersError

        if not isinstance(error, NoWorkersError):
            raise
        fail(str(error))
    except NoTableError as error:
        fail(f"{out} cannot be continued: {error}. It is as it was. Pass another --out, or --overwrite to replace it.")
    except OSError as error:
        begun = out is not None and any(Path(f"{out}{end}").is_file() for end in ("", JOURNAL))
        advice = " What is scored is kept, and the same command goes on from there." if begun else ""
        fail(f"The table cannot be written ({error.strerror or error}).{advice}")


def fail(message: str) -> NoReturn:
    """End the command with a message."""
    typer.echo(message, err=True)
    raise typer.Exit(WRONG) from None


def end_if_failed(failed: int, total: int, advice: str = "") -> None:
    """End the command with status 1 if there are masks whose rows say why they have no numbers."""
    if failed:
        typer.echo(f"{failed} of {total} masks failed; the column 'error' says why.{advice}", err=True)
        raise typer.Exit(1)


def load_table(path: Path) -> list[Score]:
    """Read a table, or end the command with the reason why it cannot be read."""
    from torchlinf.scoring import read_table

    try:
        return list(read_table(path))
    except OSError as error:
        fail(f"{path} cannot be read ({error.strerror or error}).")
    except NoTableError as error:
        fail(f"{path} is not a table of `torchlinf score`: {error}.")
    except ImportError as error:
        fail(str(error))


def folder_problem(out: Path) -> str | None:
    """Why no file of this name can be written, as far as its folder says it."""
    if out.is_dir():
        return f"{out} is a folder; pass the name of a file"
    if out.exists():
        return None
    if not out.parent.is_dir():
        return f"the folder {out.parent} does not exist; make it, or pass another"
    return None if os.access(out.parent, os.W_OK) else f"the folder {out.parent} cannot be written to"


def check_out(out: Path | None, as_json: bool, overwrite: bool, retry: bool) -> None:
    """Refuse names and options that contradict each other."""
    suffix = "" if out is None else out.suffix.lower()
    problem = None if out is None else folder_problem(out)
    if out is not None and out.name.lower().endswith((*SUFFIXES, *TAR_SUFFIXES)):
        problem = f"{out} has the name of a mask; pass for example scores.csv"
    elif suffix == ".json" and not as_json:
        problem = f"{out} would hold CSV; pass for example scores.jsonl"
    elif suffix in (".csv", ".parquet") and as_json:
        problem = f"{out} has not the name of JSON lines; leave --json out, or pass for example scores.jsonl"
    elif overwrite and retry:
        problem = "--retry keeps what --overwrite drops; pass one of them"
    elif out is None and (overwrite or retry):
        problem = "--overwrite and --retry need a table to work on; pass --out"
    if problem:
        raise typer.BadParameter(problem, param_hint="--out")


def refuse_source(out: Path | None, sources: list[Source]) -> None:
    """Refuse to write over a mask or an archive."""
    if out is not None and out.exists():
        same_name = {source.path for source in sources if source.path.name == out.name}
        if any(path.exists() and out.samefile(path) for path in same_name):
            raise typer.BadParameter(f"{out} is one of the files to score", param_hint="--out")
