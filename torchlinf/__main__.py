"""The entry point of the command `torchlinf` and of `python -m torchlinf`."""

import sys

from torchlinf._helpers.extras import require


def main() -> None:
    """Run the command, or say which extra it needs: `torchlinf.cli` cannot be imported without it."""
    try:
        require("typer", "The command torchlinf", "cli")
        require("rich", "The command torchlinf", "cli")
    except ImportError as error:
        sys.exit(f"torchlinf: {error}")
    from torchlinf.cli import main

    main()


if __name__ == "__main__":
    main()
