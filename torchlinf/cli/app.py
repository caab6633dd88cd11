"""The command `torchlinf`: scores of masks as a table, two tables compared, orders, and profiles as a picture."""

import logging
import os
import sys
import warnings
from contextlib import suppress
from typing import Annotated

import typer

from torchlinf import __version__
from torchlinf.cli import compare, order, profile, report, score
from torchlinf.cli.outputs import INTERRUPTED, PIPE_CLOSED, WRONG

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
app.command(epilog=score.EPILOG)(score.score)
app.command(epilog=compare.EPILOG)(compare.compare)
app.command(epilog=profile.EPILOG)(profile.profile)
app.command(epilog=order.EPILOG)(order.order)
app.command(epilog=report.EPILOG)(report.report)


def main() -> None:
    """Run the command; the entry point of the package."""
    # What is odd about a file is said in its row, if it matters.
    warnings.filterwarnings("ignore", module=r"PIL\.")
    logging.getLogger("tifffile").disabled = True
    # After a kill, multiprocessing's helper removes what is left of the workers' queues. It need not report that.
    sys.warnoptions.append("ignore::UserWarning:multiprocessing.resource_tracker")
    try:
        app()
    except SystemExit as stop:
        if stop.code in (WRONG, INTERRUPTED, PIPE_CLOSED):
            # An ordinary exit would first wait for the masks that other threads are still solving.
            with suppress(OSError):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(int(stop.code))
        raise


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
    """Multi-scale complexity of shapes, with a certified error."""
