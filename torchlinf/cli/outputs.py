"""The tables that a command reads and writes: what is refused, before the work if it can be, and in which words."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import typer

from torchlinf._helpers.terminal import printable
from torchlinf.scoring import (
    JOURNAL,
    STANDARD_OUTPUT,
    SUFFIXES,
    TAR_SUFFIXES,
    NoTableError,
    Score,
    Source,
    table_format,
)  # fmt: skip

# 128 + the number of the signal, as a shell reports a program that SIGINT (Ctrl-C) or SIGPIPE (`| head`) ended.
WRONG, INTERRUPTED, PIPE_CLOSED = 2, 130, 141

GOES_ON = "the same command goes on where this one was"
BEGINS_ANEW = "nothing was written, and the same command begins anew"

STATUS = (
    "Exit status: 0 all fine, 1 some masks failed, 2 wrong usage or an output that cannot be written, 130 stopped by "
    "Ctrl-C."
)


@contextmanager
def endings(out: Path | None, *, resumes: bool = True) -> Iterator[None]:
    """What ends a run, as a message and an exit status.

    Args:
        out: what is written.
        resumes: whether the same command goes on with it; if not, it is written in one piece at the end.
    """
    try:
        with _interrupts():
            yield
    except KeyboardInterrupt:
        if not is_standard_output(out):
            say(f"Stopped; {GOES_ON if resumes else BEGINS_ANEW}.")
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
        if not resumes:
            fail(f"{out} cannot be written ({error.strerror or error}).")
        begun = not is_standard_output(out) and any(Path(f"{out}{end}").is_file() for end in ("", JOURNAL))
        advice = " What is scored is kept, and the same command goes on from there." if begun else ""
        fail(f"The table cannot be written ({error.strerror or error}).{advice}")


@contextmanager
def _interrupts() -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt within this context, and nothing else, if it ends the process without it."""
    import torch  # noqa: F401 - loaded before Ctrl-C is an exception, which torch does not stand while it is loaded

    ends = signal.getsignal(signal.SIGINT) is signal.SIG_DFL
    try:
        if ends:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        yield
    except typer.Exit:
        raise
    except Exception as error:
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, KeyboardInterrupt):
            cause = cause.__cause__ or cause.__context__
        if cause is None:
            raise
        # Compiled code, in which Ctrl-C came, has made another exception of it.
        raise KeyboardInterrupt from error
    finally:
        if ends:
            signal.signal(signal.SIGINT, signal.SIG_DFL)


def say(message: str) -> None:
    """A line on standard error. No name in it steers the terminal."""
    typer.echo(printable(message, sys.stderr.encoding), err=True)


def fail(message: str) -> NoReturn:
    """End the command with a message."""
    say(message)
    raise typer.Exit(WRONG) from None


def end_if_failed(failed: int, total: int, advice: str = "") -> None:
    """End the command with status 1 if there are masks whose rows say why they have no numbers."""
    if failed:
        say(f"{failed} of {total} masks failed; the column 'error' says why.{advice}")
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


def is_standard_output(out: Path | None) -> bool:
    """Whether a table goes to standard output."""
    return out is None or str(out) == STANDARD_OUTPUT


def check_out(out: Path | None, as_json: bool, overwrite: bool, retry: bool) -> None:
    """Refuse names and options that contradict each other."""
    problem = None
    if overwrite and retry:
        problem = "--retry keeps what --overwrite drops; pass one of them"
    elif out is None or is_standard_output(out):
        problem = "--overwrite and --retry need a table to work on; pass --out" if overwrite or retry else None
    elif out.name.lower().endswith((*SUFFIXES, *TAR_SUFFIXES)):
        problem = f"{out} has the name of a mask; pass for example scores.csv"
    else:
        problem = _format_problem(out, as_json) or folder_problem(out)
    if problem:
        raise typer.BadParameter(problem, param_hint="--out")


def _format_problem(out: Path, as_json: bool) -> str | None:
    """Why no table is written to a file of this name."""
    if out.exists() and not out.is_file():
        return None  # a pipe or a device, whose name says nothing
    if out.suffix.lower() == ".json" and not as_json:
        return f"{out} would hold CSV; pass for example scores.jsonl"
    try:
        kind = table_format(out).kind if not (as_json and out.suffix.lower() == ".json") else "jsonl"
    except ValueError as error:
        return str(error)
    if as_json and kind != "jsonl" and out.suffix:
        return f"{out} has not the name of JSON lines; leave --json out, or pass for example scores.jsonl"
    return None


def refuse_source(out: Path | None, sources: list[Source]) -> None:
    """Refuse to write over a mask or an archive."""
    if out is not None and not is_standard_output(out) and out.exists():
        same_name = {source.path for source in sources if source.path.name == out.name}
        if any(path.exists() and out.samefile(path) for path in same_name):
            raise typer.BadParameter(f"{out} is one of the files to score", param_hint="--out")
