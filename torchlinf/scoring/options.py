"""How masks are read and measured, as the functions that score files take it."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from torchlinf._checks import count, number_or_none
from torchlinf.measure import Measure, MeasureOptions
from torchlinf.scoring.mask_rules import MAX_PIXELS
from torchlinf.scoring.rows import KINDS, WINDOWS, columns


def score_measure(options: Mapping[str, Any], *, windows: Mapping[str, tuple[float, float]] = WINDOWS) -> Measure:
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
    return measure


@dataclass(frozen=True)
class ScoreOptions:
    """How masks are read and measured.

    Attributes:
        threshold: inside is what is greater, in each file's own units; None chooses by `RULE`.
        invert: swap inside and outside.
        max_pixels: larger masks are refused.
        members: which members of tar archives are masks, as a pattern; None takes all with a suffix of a mask.
        measure: how complexity is measured.
    """

    threshold: float | None = None
    invert: bool = False
    max_pixels: int = MAX_PIXELS
    members: str | None = None
    measure: Measure = field(default_factory=lambda: score_measure({}))

    def __post_init__(self) -> None:
        """Check what is not checked by `Measure`."""
        object.__setattr__(self, "threshold", number_or_none(self.threshold, "threshold", "Pass for example 127."))
        count(self.max_pixels, "max_pixels")

    def settings(self) -> str:
        """All options as one line of JSON."""
        return json.dumps(asdict(self) | {"measure": json.loads(self.measure.settings())})

    @property
    def reading(self) -> dict[str, Any]:
        """The keywords of `read_source`."""
        return {"threshold": self.threshold, "invert": self.invert, "max_pixels": self.max_pixels}

    @property
    def measuring(self) -> dict[str, Any]:
        """The measure as keywords."""
        return {"windows": None, **self.measure.options()}

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of the table."""
        return columns(self.measure.named_windows())
