"""`torchlinf warm-up`: the compiled kernels, made before they are needed."""

import typer

from torchlinf.cli.outputs import endings


def warm_up() -> None:
    """Compile the kernels and keep them, for images of containers: the first score then starts at once."""
    with endings(None):
        from torchlinf import warming

        typer.echo(f"The kernels are compiled ({warming.warm_up():.1f} s).")
