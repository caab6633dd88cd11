"""The entry point of the command `torchlinf` and of `python -m torchlinf`."""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from torchlinf._helpers.extras import require


def main() -> None:
    """Run the command, or say which extra it needs: `torchlinf.cli` cannot be imported without it."""
    with _ended_by_interrupts():
        try:
            require("typer", "The command torchlinf", "cli")
            require("rich", "The command torchlinf", "cli")
        except ImportError as error:
            sys.exit(f"torchlinf: {error}")
        from torchlinf.cli import main

        main()


@contextmanager
def _ended_by_interrupts() -> Iterator[None]:
    """Ctrl-C ends the process at once while modules are loaded, when nothing can be lost.

    An exception there may arise within compiled code of other packages, such as torch, which makes a SystemError of it
    or aborts. `torchlinf.cli.outputs.endings` takes Ctrl-C as an exception again, for the work itself.
    """
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler:  # the shell has switched Ctrl-C off, or a program wants it otherwise
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


if __name__ == "__main__":
    main()
