"""How complexity is measured: the options, in one place for every function, loss, metric, table and command.

Users pass the options as keywords. Each entry point builds a `Measure` of them, which checks them, and hands that on.
`takes` writes the options into the signature and the docstring of the entry point, so that `help` shows all of them.
"""

import dataclasses
import inspect
import json
import math
import textwrap
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal, TypedDict, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from torch import Tensor

from torchlinf._helpers.checks import MAX_SPATIAL_NDIM, choice, count, from_zero, plain, positive, window

Estimator = Literal["entropy", "std"]
LevelSets = Literal["distance", "rim"]
Per = Literal["mask", "object"]
Pool = Literal["mean", "area"]
Window = tuple[float, float]
Rotation = tuple[tuple[float, ...], ...]  # a 3 x 3 rotation matrix, by rows

ESTIMATORS = ("entropy", "std")
LEVELS = ("distance", "rim")
PER = ("mask", "object")
POOLS = ("mean", "area")
FRAMES = ("own", "mean", "least")  # orientations that are found from the shape
SEVERAL = ("mean", "least")  # those of them that try several rotations
MAX_BINS = 2**20  # finer bins would be narrower than the default tolerance can tell apart
ALL_SCALES = (0.0, 1.0)
ROTATIONS = 6  # of "mean" and "least", where nothing else is said


class LevelOptions(TypedDict, total=False):
    """Options of what is found on every level, before any mean over scales; along the axes of the grid."""

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


class FrameOptions(TypedDict, total=False):
    """Options of the axes that a shape is measured along."""

    orientation: float | str | ArrayLike | Tensor | None
    rotations: int


class ObjectOptions(TypedDict, total=False):
    """Options of what is one shape: a mask, or each connected component of it."""

    per: Per
    connectivity: int | None
    min_pixels: int
    pool: Pool | None


class ProfileOptions(LevelOptions, FrameOptions, ObjectOptions, total=False):
    """Options of a profile: of the levels, in which axes, and of what."""


class MeanOptions(WindowOptions, FrameOptions, ObjectOptions, total=False):
    """Options of one number a mask: the mean over one window of scales, in which axes, and of what."""


class MeasureOptions(MeanOptions, total=False):
    """Options of one or several numbers a mask: all there are."""

    windows: Mapping[str, Window] | None


class GridOptions(WindowOptions, total=False):
    """Options of one or several numbers of a mask as it stands, along the axes of the grid."""

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
        orientation: the axes: None (the grid), degrees, "own", "mean", "least", or a 3 x 3 rotation matrix.
        rotations: how many rotations "mean" and "least" try.
        per: what is one shape: "mask", or "object" for each connected component.
        connectivity: which pixels are connected; None means those that touch at all.
        min_pixels: components of fewer pixels are left out.
        pool: how the objects of a mask become one number: "mean" or "area"; None is "mean", and in tables one row an
            object.

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
    orientation: float | str | Rotation | None = None
    rotations: int = ROTATIONS
    per: Per = "mask"
    connectivity: int | None = None
    min_pixels: int = 1
    pool: Pool | None = None

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
        checked["orientation"] = _orientation(self.orientation)
        checked["rotations"] = count(self.rotations, "rotations")
        checked["per"] = choice(self.per, PER, "per")
        checked["connectivity"] = _connectivity(self.connectivity)
        checked["min_pixels"] = count(self.min_pixels, "min_pixels")
        checked["pool"] = None if self.pool is None else choice(self.pool, POOLS, "pool")
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        self._used()

    def _used(self) -> None:
        """Refuse options that would change nothing beside the others: something else was meant."""
        if self.rotations != ROTATIONS and self.orientation not in SEVERAL:
            raise ValueError(
                f'rotations must stand beside orientation="mean" or "least"; got rotations={self.rotations} beside '
                f'orientation={self.orientation!r}. Pass orientation="mean".'
            )
        for name, default in (("connectivity", None), ("min_pixels", 1), ("pool", None)):
            if self.per == "mask" and getattr(self, name) != default:
                raise ValueError(
                    f'{name} must stand beside per="object"; got {name}={getattr(self, name)!r} beside per="mask". '
                    'Pass per="object".'
                )

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
        "rho": null, "tol": 1e-09, "tol_bits": 0.0, "orientation": null, "rotations": 6, "per": "mask",
        "connectivity": null, "min_pixels": 1, "pool": null}'
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

    def windows_beside(self, columns: Collection[str]) -> dict[str, Window]:
        """The windows by name, for a table that has these columns too.

        Raises:
            ValueError: a window bears the name of one of them.
        """
        windows = self.named_windows()
        if taken := windows.keys() & columns:
            raise ValueError(
                f"windows must not bear the names of other columns; got {sorted(taken)}. "
                "Pass for example windows={'fine': (0.0, 0.25)}."
            )
        return windows

    def scalar_rho(self) -> float | None:
        """`rho` where it has to be one number for all shapes.

        Raises:
            TypeError: it is a tensor.
        """
        if isinstance(self.rho, Tensor):
            raise TypeError(f"rho must be None or one number here; got a tensor {tuple(self.rho.shape)}. Pass a float.")
        return self.rho

    @property
    def is_plain(self) -> bool:
        """Whether a mask is measured as it stands: along the axes of the grid, all of it as one shape."""
        return self.orientation is None and self.per == "mask"

    def plain(self) -> "Measure":
        """The measure of a mask as it stands, such as one object that has been cropped and turned already.

        >>> Measure(bins=64, orientation="own", per="object").plain().options()
        {'bins': 64}
        """
        return dataclasses.replace(
            self, orientation=None, rotations=ROTATIONS, per="mask", connectivity=None, min_pixels=1, pool=None
        )

    def of_objects(self) -> "Measure":
        """The measure of one object that has been cropped already: all but its axes is settled."""
        return dataclasses.replace(self, per="mask", connectivity=None, min_pixels=1, pool=None)

    @property
    def unit(self) -> str:
        """The unit of the values, as it stands on an axis of a plot."""
        return "bits" if self.estimator == "entropy" else "share of max f"

    @property
    def largest(self) -> float:
        """The value that no shape exceeds: log2(bins) bits, or a share of 0.5."""
        return math.log2(self.bins) if self.estimator == "entropy" else 0.5


def _orientation(given: Any) -> float | str | Rotation | None:
    """Check an orientation: a matrix becomes a tuple of its rows, which can be compared and hashed."""
    remedy = 'Pass degrees, "own", "mean", "least" or None; in 3-D a 3 x 3 rotation matrix.'
    if given is None:
        return None
    if isinstance(given, str):
        if given not in FRAMES:
            raise ValueError(f'orientation must be "own", "mean" or "least" if it is a word; got {given!r}. {remedy}')
        return given
    if isinstance(given, bool):
        raise TypeError(f"orientation must be a number, a word or a matrix; got {given!r}. {remedy}")
    if isinstance(given, Real):
        if not math.isfinite(given):
            raise ValueError(f"orientation must be finite; got {given!r}. {remedy}")
        return float(given)
    if isinstance(given, Tensor):
        given = given.numpy(force=True)
    matrix = given.as_matrix() if hasattr(given, "as_matrix") else given  # SciPy's Rotation
    try:
        rows = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"orientation must be a number, a word or a matrix; got {given!r}. {remedy}") from None
    if rows.shape != (3, 3):
        raise ValueError(f"orientation must be a 3 x 3 matrix if it is an array; got shape {rows.shape}. {remedy}")
    if not (np.allclose(rows @ rows.T, np.eye(3), rtol=0, atol=1e-6) and np.linalg.det(rows) > 0):
        raise ValueError(
            f"orientation must be a rotation matrix, with orthogonal rows of length 1 and determinant 1; got "
            f"{rows.tolist()}. Pass for example scipy.spatial.transform.Rotation.from_euler('z', 30, degrees=True)."
        )
    return tuple(map(tuple, rows.tolist()))


def _connectivity(given: int | None) -> int | None:
    """Check how many axes two neighbours may differ along; that it is no more than the mask has is checked there."""
    if given is None:
        return None
    if count(given, "connectivity") > MAX_SPATIAL_NDIM:
        raise ValueError(
            f"connectivity must be at most the number of dimensions, {MAX_SPATIAL_NDIM}; got {given}. "
            "Pass None for all pixels that touch, 1 for those that share a face."
        )
    return int(given)


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
    "orientation": "the axes that a shape is measured along: a box is simple along its own sides alone. None: those of "
    'the grid. "own": those of the bounding rectangle of smallest area (2-D); a shape whose upright box is less than '
    "1 % larger is not turned. A number: the shape is turned by that many degrees first, counter-clockwise in an image "
    '(2-D). "mean": the mean over several rotations, "least": the rotation with the smallest complexity (2-D). A '
    "3 x 3 rotation matrix, or a SciPy Rotation: the shape is turned by it first (3-D). What is turned is resampled.",
    "rotations": 'how many rotations "mean" and "least" take: i * 90 / rotations degrees for i = 0, 1 ... '
    "rotations - 1, since 90 degrees change nothing.",
    "per": 'what is one shape: "mask", all that is inside a mask; or "object", each connected component alone, '
    "cropped, with its own radius and its own axes.",
    "connectivity": "which pixels are connected: along how many axes neighbours may differ, 1 for a common face, up to "
    "the number of dimensions; None means that number (8 neighbours in 2-D, 26 in 3-D).",
    "min_pixels": "components of fewer pixels are left out; counted in the mask, before any turn.",
    "pool": 'how the objects of one mask become one number: "mean", each counts the same; or "area", each counts as '
    'its pixels. None means "mean"; but in a table one row an object, in the metric one shape an object.',
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
