"""The options that say how complexity is measured, the same for every command that measures."""

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import Annotated, Any

import typer

# None stands for the default of `Measure`, which the help shows: torch is not loaded to print it.
OPTIONS: Mapping[str, Any] = {
    "low": Annotated[
        float | None,
        typer.Option("--low", metavar="T", show_default="0", help="Lower end of the one window of scales, excluded."),
    ],
    "high": Annotated[
        float | None,
        typer.Option("--high", metavar="T", show_default="1", help="Upper end of the one window of scales, included."),
    ],
    "windows": Annotated[
        list[str] | None,
        typer.Option(
            "--window", metavar="NAME=LOW-HIGH", help="A window of scales with a column of its own; may be repeated."
        ),
    ],
    "bins": Annotated[
        int | None,
        typer.Option("--bins", metavar="N", show_default="1024", help="Bins of the entropy, 1 to 2^20."),
    ],
    "estimator": Annotated[
        str | None,
        typer.Option(
            "--estimator",
            metavar="entropy|std",
            show_default="entropy",
            help="What a level is measured by: entropy (bits) or std (a share).",
        ),
    ],
    "levels": Annotated[
        str | None,
        typer.Option(
            "--levels",
            metavar="distance|rim",
            show_default="distance",
            help="What a level is: all pixels of one distance, or the thinner rim of the paper's numbers.",
        ),
    ],
    "rho": Annotated[
        float | None,
        typer.Option("--rho", metavar="R", show_default="each shape's radius", help="Screening length, pixels."),
    ],
    "tol": Annotated[
        float | None,
        typer.Option("--tol", metavar="E", show_default="1e-09", help="Relative error of every field."),
    ],
    "tol_bits": Annotated[
        float | None,
        typer.Option("--tol-bits", metavar="B", show_default="0", help="Bits that a level may be off; inf for any."),
    ],
    "orientation": Annotated[
        str | None,
        typer.Option(
            "--orientation",
            metavar="own|mean|least|DEGREES",
            show_default="the grid",
            help="The axes that a shape is measured along: those of its smallest rectangle, the mean or the least over "
            "rotations, or the shape turned by degrees first.",
        ),
    ],
    "rotations": Annotated[
        int | None,
        typer.Option("--rotations", metavar="N", show_default="6", help="How many rotations mean and least take."),
    ],
    "per": Annotated[
        str | None,
        typer.Option(
            "--per",
            metavar="mask|object",
            show_default="mask",
            help="What one shape is: all of a mask, or each connected component.",
        ),
    ],
    "connectivity": Annotated[
        int | None,
        typer.Option(
            "--connectivity",
            metavar="N",
            show_default="all that touch",
            help="Along how many axes connected pixels may differ; 1: they share a face.",
        ),
    ],
    "min_pixels": Annotated[
        int | None,
        typer.Option("--min-pixels", metavar="N", show_default="1", help="Objects of fewer pixels are left out."),
    ],
    "pool": Annotated[
        str | None,
        typer.Option(
            "--pool",
            metavar="mean|area",
            show_default="a row an object",
            help="One row a mask, the mean of its objects: each counts the same, or as its pixels.",
        ),
    ],
}
# Of a mask in its own frame, or of its objects, no picture of a whole mask is drawn.
PARTS = ("orientation", "rotations", "per", "connectivity", "min_pixels", "pool")


def takes_measure(
    windows: Mapping[str, tuple[float, float]] | None, *, without: Sequence[str] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options of the measure; it gets a checked `Measure` as its keyword `measure`.

    Args:
        windows: those that the command has without `--window`, `--low` and `--high`; None for one over all scales.
        without: options that it does not take, of `OPTIONS`.
    """
    kinds = {name: kind for name, kind in OPTIONS.items() if name not in without}

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def run(**given: Any) -> None:
            options = {name: value for name in kinds if (value := given.pop(name)) is not None}
            command(**given, measure=_measure(options, windows))

        own = [one for one in inspect.signature(command).parameters.values() if one.name != "measure"]
        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
            for name, kind in kinds.items()
        ]
        run.__signature__ = inspect.Signature([*own, *added])  # type: ignore[attr-defined]
        run.__annotations__ = {name: one.annotation for name, one in run.__signature__.parameters.items()}  # type: ignore[attr-defined]
        return run

    return decorate


def parse_windows(texts: list[str]) -> dict[str, tuple[float, float]]:
    """Windows of scales as they stand on the command line.

    >>> parse_windows(["fine=0-0.25", "coarse=2.5e-1-1"])
    {'fine': (0.0, 0.25), 'coarse': (0.25, 1.0)}
    """
    number = r"\d*\.?\d+(?:[eE][-+]?\d+)?"
    windows: dict[str, tuple[float, float]] = {}
    for text in texts:
        match = re.fullmatch(f"(.+)=({number})-({number})", text)
        if match is None:
            raise typer.BadParameter(
                f"a window must be NAME=LOW-HIGH; got {text}. Pass for example fine=0-0.25", param_hint="--window"
            )
        name, low, high = match.groups()
        if name in windows:
            raise typer.BadParameter(
                f"each window must have a name of its own; got {name} twice. Pass another name", param_hint="--window"
            )
        windows[name] = (float(low), float(high))
    return windows


def parse_orientation(text: str) -> str | float:
    """An orientation as it stands on the command line: a word, or degrees.

    >>> parse_orientation("own"), parse_orientation("-12.5")
    ('own', -12.5)
    """
    try:
        return float(text)
    except ValueError:
        return text


def _measure(options: dict[str, Any], windows: Mapping[str, tuple[float, float]] | None) -> Any:
    if texts := options.pop("windows", None):
        options["windows"] = parse_windows(texts)
    if text := options.pop("orientation", None):
        options["orientation"] = parse_orientation(text)
    from torchlinf.scoring import score_measure

    try:
        return score_measure(options, windows=windows)
    except (TypeError, ValueError) as error:
        raise typer.BadParameter(str(error)) from None
