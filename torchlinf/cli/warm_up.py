"""`torchlinf warm-up`: the compiled kernels, made before they are needed."""

import time

import typer

from torchlinf.cli.outputs import endings


def warm_up() -> None:
    """Compile the kernels and keep them, for images of containers: the first score then starts at once."""
    with endings(None):
        from torchlinf import kernels

        start = time.perf_counter()
        kernels.warm_up()
        typer.echo(f"The kernels are compiled ({time.perf_counter() - start:.1f} s).")
