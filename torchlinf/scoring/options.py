"""How masks are read and measured, as the functions that score files take it."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from torchlinf.measure import Measure, MeasureOptions
from torchlinf.scoring.mask_rules import MAX_PIXELS, Reading
from torchlinf.scoring.rows import KINDS, WINDOWS, columns


def score_measure(
    options: Mapping[str, Any], *, windows: Mapping[str, tuple[float, float]] | None = WINDOWS
) -> Measure:
    """The measure of the keywords that a function was given.

    Args:
        options: the keywords.
        windows: those of the measure where the keywords have none. If `low` or `high` is given, or `windows` is None,
            it has the one window (low, high], whose column is "complexity".

    Raises:
        TypeError: an option is of the wrong type; `rho` must be None or one number.
        ValueError: an option has a wrong value, or a window has the name of another column.

    >>> list(score_measure({}).named_windows()), list(score_measure({"high": 0.5}).named_windows())
    (['complexity', 'complexity_low', 'complexity_high'], ['complexity'])
    """
    if not {"windows", "low", "high"} & set(options):
        options = {**options, "windows": windows}
    measure = Measure.of(options, MeasureOptions)
    measure.scalar_rho()
    for name in measure.named_windows():
        if not name or name in (*KINDS, "values"):
            raise ValueError(
                f"windows must have names that no other column has; got {name!r}. Pass another name, such as 'fine'."
            )
        if not name.isprintable():  # it is the title of a column
            raise ValueError(f"windows must have printable names; got {name!r}. Pass another name, such as 'fine'.")
    return measure


@dataclass(frozen=True)
class ScoreOptions:
    """How masks are read and measured.

    Attributes:
        threshold, label, nonzero, ignore, invert, max_pixels, volume, labels, stack, spacing, voxel: as in
            `mask_rules.Reading`.
        members: which members of tar archives are masks, as a pattern; None takes all with a suffix of a mask.
        measure: how complexity is measured.
        reading: the first eleven as one object.
    """

    threshold: float | None = None
    invert: bool = False
    max_pixels: int = MAX_PIXELS
    members: str | None = None
    measure: Measure = field(default_factory=lambda: score_measure({}))
    label: int | None = None
    nonzero: bool = False
    ignore: int | Collection[int] = ()
    volume: bool = False
    labels: bool = False
    stack: bool = False
    spacing: str | Sequence[float] | None = None
    voxel: float | None = None

    def __post_init__(self) -> None:
        """Check what is not checked by `Measure`."""
        for name in ("ignore", "spacing", "voxel"):
            object.__setattr__(self, name, getattr(self.reading, name))

    def settings(self) -> str:
        """All options as one line of JSON."""
        return json.dumps(asdict(self) | {"measure": json.loads(self.measure.settings())})

    @property
    def reading(self) -> Reading:
        """What is inside, and what is refused."""
        return Reading(**{one.name: getattr(self, one.name) for one in fields(Reading)})

    @property
    def measuring(self) -> dict[str, Any]:
        """The measure as keywords."""
        return {"windows": None, **self.measure.options()}

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of the table."""
        return columns(self.measure.named_windows())
