"""How complexity is measured: the options, in one place for every function, loss, metric, table and command.

Users pass the options as keywords. Each entry point builds a `Measure` of them, which checks them, and hands that on.
`takes` writes the options into the signature and the docstring of the entry point, so that `help` shows all of them.
"""

import dataclasses
import inspect
import json
import math
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypedDict, TypeVar

from torch import Tensor

from torchlinf._helpers.checks import choice, count, from_zero, plain, positive, window

Estimator = Literal["entropy", "std"]
LevelSets = Literal["distance", "rim"]
Window = tuple[float, float]

ESTIMATORS = ("entropy", "std")
LEVELS = ("distance", "rim")
MAX_BINS = 2**20  # finer bins would be narrower than the default tolerance can tell apart
ALL_SCALES = (0.0, 1.0)


class LevelOptions(TypedDict, total=False):
    """Options of what is found on every level, before any mean over scales."""

    bins: int
    estimator: Estimator
    levels: LevelSets
    rho: float | Tensor | None
    tol: float
    tol_bits: float


class WindowOptions(LevelOptions, total=False):
    """Options of one number a shape: the mean over one window of scales."""

    low: float
    high: float


class MeasureOptions(WindowOptions, total=False):
    """Options of one or several numbers a shape."""

    windows: Mapping[str, Window] | None


class SoftOptions(TypedDict, total=False):
    """Options of the differentiable complexity, which has a bandwidth instead of bins."""

    low: float
    high: float
    estimator: Estimator
    rho: float | Tensor | None
    tol: float


@dataclass(frozen=True)
class Measure:
    """How complexity is measured. The same options with the same defaults hold in the whole library.

    A `Measure` can be unpacked into keywords: `fine = Measure(high=0.25)`, then `complexity(mask, **fine.options())`.

    Attributes:
        low: lower end of the window of scales, excluded.
        high: upper end of the window, included; 0 <= low < high <= 1.
        windows: several windows by name, or None for the one window (low, high].
        bins: number of equal bins on [0, 1] for "entropy", from 1 to 2^20.
        estimator: "entropy" (bits) or "std" (share of the field's maximum).
        levels: "distance" (level k is {d = k}) or "rim" (the rim of {d >= k}, thinner at corners).
        rho: screening length in pixels; None means each shape's own radius.
        tol: relative error that every field is certified to.
        tol_bits: bits that every level may be off; 0 means none, as far as floating point can tell.

    Raises:
        TypeError: an option is of the wrong type.
        ValueError: an option has a wrong value.

    Example:
        >>> fine = Measure(high=0.25)
        >>> fine.options()
        {'high': 0.25}
        >>> fine.unit, fine.largest
        ('bits', 10.0)
    """

    low: float = 0.0
    high: float = 1.0
    windows: Mapping[str, Window] | None = None
    bins: int = 1024
    estimator: Estimator = "entropy"
    levels: LevelSets = "distance"
    rho: float | Tensor | None = None
    tol: float = 1e-9
    tol_bits: float = 0.0

    def __post_init__(self) -> None:
        """Check every option; numbers become plain floats and ints."""
        plain(self.rho, "rho")
        low, high = window(self.low, self.high)
        checked: dict[str, Any] = {"low": low, "high": high, "windows": _windows(self.windows, (low, high))}
        checked["estimator"] = choice(self.estimator, ESTIMATORS, "estimator")
        checked["levels"] = choice(self.levels, LEVELS, "levels")
        checked["bins"] = count(self.bins, "bins")
        if self.bins > MAX_BINS:
            raise ValueError(f"bins must be at most {MAX_BINS}; got {self.bins}. Pass 1024, the value of the paper.")
        if self.rho is not None and not isinstance(self.rho, Tensor):
            checked["rho"] = positive(self.rho, "rho")
        checked["tol"] = positive(self.tol, "tol")
        checked["tol_bits"] = from_zero(self.tol_bits, "tol_bits")
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, options: Mapping[str, Any], kind: type) -> "Measure":
        """The measure of the keywords that an entry point was given; `kind` is the TypedDict of those it takes.

        >>> Measure.of({"bins": 64}, LevelOptions).bins
        64
        """
        taken = names_of(kind)
        for name in options:
            if name not in taken:
                raise TypeError(f"{name} is not an option here; got {name}={options[name]!r}. Pass {_listed(taken)}.")
        return cls(**options)

    def options(self, kind: type = MeasureOptions) -> dict[str, Any]:
        """The options of `kind` that are not at their defaults, as keywords.

        >>> Measure(high=0.25, bins=64).options(LevelOptions)
        {'bins': 64}
        """
        return {
            field.name: getattr(self, field.name)
            for field in dataclasses.fields(self)
            if field.name in names_of(kind)
            and getattr(self, field.name) is not field.default
            and getattr(self, field.name) != field.default
        }

    def settings(self) -> str:
        """All options as one line of JSON, for a column of a table: what has to be known to compute a number again.

        >>> Measure(high=0.25).settings()
        '{"low": 0.0, "high": 0.25, "windows": null, "bins": 1024, "estimator": "entropy", "levels": "distance",
        "rho": null, "tol": 1e-09, "tol_bits": 0.0}'
        """
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        if isinstance(self.rho, Tensor):
            values["rho"] = "one value a shape"
        if math.isinf(self.tol_bits):
            values["tol_bits"] = "inf"  # JSON has no infinity
        return json.dumps(values)

    def named_windows(self, name: str = "complexity") -> dict[str, Window]:
        """The windows by name; `name` is that of the one window where `windows` is None."""
        return {name: (self.low, self.high)} if self.windows is None else dict(self.windows)

    def scalar_rho(self) -> float | None:
        """`rho` where it has to be one number for all shapes.

        Raises:
            TypeError: it is a tensor.
        """
        if isinstance(self.rho, Tensor):
            raise TypeError(f"rho must be None or one number here; got a tensor {tuple(self.rho.shape)}. Pass a float.")
        return self.rho

    @property
    def unit(self) -> str:
        """The unit of the values, as it stands on an axis of a plot."""
        return "bits" if self.estimator == "entropy" else "share of max f"

    @property
    def largest(self) -> float:
        """The value that no shape exceeds: log2(bins) bits, or a share of 0.5."""
        return math.log2(self.bins) if self.estimator == "entropy" else 0.5


def _windows(windows: Mapping[str, Window] | None, single: Window) -> dict[str, Window] | None:
    """Check named windows, beside which `low` and `high` must be at their defaults."""
    if windows is None:
        return None
    if not isinstance(windows, Mapping) or not all(isinstance(name, str) for name in windows):
        raise TypeError(
            f"windows must map names to pairs (low, high); got {windows!r}. "
            "Pass for example windows={'fine': (0.0, 0.25), 'coarse': (0.25, 1.0)}."
        )
    if not windows:
        raise ValueError("windows must name at least one window; got none. Pass None for one window over all scales.")
    if single != ALL_SCALES:
        raise ValueError(
            f"windows must stand instead of low and high; got both, low={single[0]}, high={single[1]}. "
            "Pass low and high as one of the windows."
        )
    return {name: _pair(name, ends) for name, ends in windows.items()}


def _pair(name: str, ends: Any) -> Window:
    try:
        low, high = ends
    except (TypeError, ValueError):
        raise ValueError(f"windows must hold pairs (low, high); got {ends!r} for {name!r}. Pass (0.0, 0.25).") from None
    return window(low, high)


# The words of every docstring that names the option.
_DOCS = {
    "low": "lower end of the window of scales, excluded.",
    "high": "upper end of the window, included; 0 <= low < high <= 1. A scale is a fraction of the shape's own radius: "
    "an appendage of contact width w on a body of width W counts at scales up to w/W.",
    "windows": "several windows of scales at once, a mapping of names to (low, high); the result has one entry a name. "
    "None means the one window (low, high].",
    "bins": 'number of equal bins on [0, 1], from 1 to 2^20; only "entropy" uses it.',
    "estimator": '"entropy", bits of the histogram of f / max f on a level, in [0, log2(bins)]; or "std", the '
    "population standard deviation of f / max f on a level, in [0, 0.5].",
    "levels": '"distance", level k is every pixel of distance k; or "rim", those of them that touch a pixel of smaller '
    "distance through a face (the 2n-connected rim of {d >= k}), as the paper's numbers have it.",
    "rho": "screening length in pixels, a number or a tensor that broadcasts to the leading shape; None means each "
    "shape's own radius.",
    "tol": "relative error that every field is certified to.",
    "tol_bits": "how far every level's entropy may be off, in bits. 0: where a value may lie in another bin, the field "
    "is solved on, as far as floating point goes. Above 0: it is solved on only until this is reached; then a larger "
    "`tol` saves time. math.inf: it is never solved beyond `tol`. The error bound that remains is reported.",
}

MARK = "{measure options}"
WIDTH = 120

Documented = TypeVar("Documented", bound=Callable[..., Any])


def names_of(kind: type) -> tuple[str, ...]:
    """The options of a TypedDict, in the order of `Measure`."""
    known = {**getattr(kind, "__annotations__", {}), **dict.fromkeys(getattr(kind, "__optional_keys__", ()))}
    return tuple(field.name for field in dataclasses.fields(Measure) if field.name in known)


def takes(kind: type, **changed: Any) -> Callable[[Documented], Documented]:
    """Write the options of `kind` into the signature of a function or class, and into its docstring at `MARK`.

    `changed` are the options whose default is another one there than in `Measure`. Type checkers read the options from
    `**options: Unpack[kind]`; `help` and editors read what is written here.

    >>> @takes(WindowOptions)
    ... def mean(mask, **options):
    ...     '''Mean.
    ...
    ...     Args:
    ...         {measure options}
    ...     '''
    >>> inspect.signature(mean)
    <Signature (mask, *, low=0.0, high=1.0, bins=1024, estimator='entropy', levels='distance', rho=None,\
     tol=1e-09, tol_bits=0.0)>
    """
    defaults = {field.name: field.default for field in dataclasses.fields(Measure)} | changed

    def decorate(target: Documented) -> Documented:
        own = inspect.signature(target).parameters.values()
        plain = [parameter for parameter in own if parameter.kind is not parameter.VAR_KEYWORD]
        # `**options` are the measure's alone; keywords of another name hold more, such as those of every metric.
        rest = [
            parameter for parameter in own if parameter.kind is parameter.VAR_KEYWORD and parameter.name != "options"
        ]
        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=defaults[name]) for name in names_of(kind)
        ]
        signature = inspect.Signature([*plain, *added, *rest])
        if isinstance(target, type):
            # On the class itself it would also be that of every subclass, whatever its own arguments are.
            itself = inspect.Parameter("self", inspect.Parameter.POSITIONAL_OR_KEYWORD)
            target.__init__.__signature__ = signature.replace(parameters=[itself, *signature.parameters.values()])  # type: ignore[misc]
        else:
            target.__signature__ = signature  # type: ignore[attr-defined]
        if target.__doc__ is not None:
            target.__doc__ = "\n".join(_filled(target.__doc__, names_of(kind)))
        return target

    return decorate


def _filled(text: str, names: tuple[str, ...]) -> Iterator[str]:
    """The lines of a docstring with the options in place of the mark."""
    for line in text.split("\n"):
        if line.strip() != MARK:
            yield line
            continue
        indent = line[: len(line) - len(line.lstrip())]
        for name in names:
            yield from textwrap.wrap(
                f"{name}: {_DOCS[name]}", WIDTH, initial_indent=indent, subsequent_indent=indent + "    "
            )


def _listed(names: tuple[str, ...]) -> str:
    return f"{', '.join(names[:-1])} or {names[-1]}"
