"""The command `torchlinf`: one file a subcommand."""

from torchlinf.cli.app import app, main

__all__ = ["app", "main"]
