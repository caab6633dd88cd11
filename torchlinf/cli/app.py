"""The command `torchlinf`: scores of masks as a table, two tables compared, orders, and profiles as a picture.

The files of the subcommands import torch, and what needs it, inside their functions only, so that `--help` and
`--version` answer at once.
"""

import logging
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from typing import Annotated, Any

import typer
import typer.core

from torchlinf import __version__
from torchlinf._helpers.terminal import printable
from torchlinf.cli import compare, order, profile, report, score, simplify, warm_up
from torchlinf.cli.outputs import PIPE_CLOSED


class _Group(typer.core.TyperGroup):
    """The command as Typer has it, whose messages about wrong usage hold no control characters."""

    def invoke(self, ctx: Any) -> Any:
        """Run the subcommand."""
        with _harmless_messages():
            return super().invoke(ctx)

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Parse the options before the subcommand."""
        with _harmless_messages():
            return super().make_context(*args, **options)


@contextmanager
def _harmless_messages() -> Iterator[None]:
    try:
        yield
    except Exception as error:
        # Typer has its own copy of click's exceptions, or click's; those of wrong usage have a message to format.
        if hasattr(error, "format_message") and isinstance(message := getattr(error, "message", None), str):
            error.message = printable(message)  # type: ignore[attr-defined]
        raise


app = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
app.command(epilog=score.EPILOG)(score.score)
app.command(epilog=simplify.EPILOG)(simplify.simplify)
app.command(epilog=compare.EPILOG)(compare.compare)
app.command(epilog=profile.EPILOG)(profile.profile)
app.command(epilog=order.EPILOG)(order.order)
app.command(epilog=report.EPILOG)(report.report)
app.command()(warm_up.warm_up)


def main() -> None:
    """Run the command; the entry point of the package."""
    try:
        with _quiet(), _every_character():
            app()
    except SystemExit as stop:
        if stop.code == PIPE_CLOSED:
            # Python flushes standard output once more at its end, and would report that nobody reads it.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what other libraries report off the terminal, in the command's own process and only while it runs.

    What is odd about a file is said in its row, if it matters. Pillow and tifffile have no other switch than these
    global ones. The same holds for the helper process of multiprocessing, which after a kill removes what is left of
    the workers' queues, and would report that.
    """
    tifffile, tracker = logging.getLogger("tifffile"), "ignore::UserWarning:multiprocessing.resource_tracker"
    disabled = tifffile.disabled
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module=r"PIL\.")
        tifffile.disabled = True
        sys.warnoptions.append(tracker)
        try:
            yield
        finally:
            sys.warnoptions.remove(tracker)
            tifffile.disabled = disabled


@contextmanager
def _every_character() -> Iterator[None]:
    """Print what the encoding of standard output does not have as an escape, as standard error does."""
    stream = sys.stdout
    if not isinstance(stream, TextIOWrapper):
        yield
        return
    before = stream.errors
    stream.reconfigure(errors="backslashreplace")
    try:
        yield
    finally:
        with suppress(OSError, ValueError):  # a pipe that nobody reads, a stream that is closed
            stream.reconfigure(errors=before)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"torchlinf {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version and exit.")
    ] = False,
) -> None:
    """Multi-scale complexity of shapes, from fields with a certified error."""
