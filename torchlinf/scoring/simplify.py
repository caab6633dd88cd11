"""Masks in files to simpler masks in files of the same kind, and a row of numbers for each."""

import json
import math
import time
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from torchlinf import __version__
from torchlinf._helpers.inside import above
from torchlinf.losses import simplify
from torchlinf.scoring.cells import number_value, text_value
from torchlinf.scoring.last_read import read_once
from torchlinf.scoring.mask_rules import Found, Reading, excepted, is_ignored, read_all
from torchlinf.scoring.score import error_text
from torchlinf.scoring.sources import Source
from torchlinf.scoring.values import UnreadableMaskError, Values
from torchlinf.scoring.workers import in_order
from torchlinf.scoring.written_masks import PixelFile

HALF = 0.5
ADVISED = ("--labels", "--label", "--threshold")  # options of the command that say what is inside


@dataclass(frozen=True)
class Simplified:
    """One row of the table of simplified masks.

    Attributes:
        path: the file, and behind it the label, as in "map.png#15".
        label: the label; None where the mask is not one of a map.
        before: complexity of the mask as it was, in bits (share of the field's maximum for the estimator "std"); None
            for an empty one.
        after: the same of the mask that was written.
        flips: how many regions were flipped.
        changed: how many pixels are different in the end.
        cost: the log-odds of what was changed; its pixels, where the file holds no probabilities.
        seconds: time taken to read and simplify it.
        inside: which rule says what is inside, as in the table of scores.
        error: what went wrong, in words; None if nothing did.
        version: the version of torchlinf.
        options: how it was simplified, all options as JSON.
    """

    path: str
    label: int | None = None
    before: float | None = None
    after: float | None = None
    flips: int | None = None
    changed: int | None = None
    cost: float | None = None
    seconds: float | None = None
    inside: str | None = None
    error: str | None = None
    version: str | None = None
    options: str | None = None

    values: ClassVar[Mapping[str, float]] = {}  # it has no columns but these

    def cells(self) -> dict[str, Any]:
        """The values of all columns by name."""
        return asdict(self)

    @classmethod
    def of(cls, cells: Mapping[str, Any]) -> "Simplified":
        """The row of cells, which may be texts.

        Raises:
            ValueError: a column is missing, or a cell is not of its kind.
        """
        if missing := [name for name in SIMPLIFIED if name not in cells]:
            raise ValueError(f"there is no column {missing[0]}")
        values: dict[str, Any] = {
            name: text_value(name, cells[name]) if kind is str else number_value(name, kind, cells[name])
            for name, kind in KINDS.items()
        }
        return cls(**values)


SIMPLIFIED = tuple(one.name for one in fields(Simplified))
WHOLE, REAL = ("label", "flips", "changed"), ("before", "after", "cost", "seconds")
KINDS: Mapping[str, Any] = {name: int if name in WHOLE else float if name in REAL else str for name in SIMPLIFIED}


@dataclass(frozen=True)
class Simplifying:
    """How masks are read and simplified.

    Attributes:
        reading: what is inside.
        probability: whether 8-bit and 16-bit grey images hold probabilities, 0 for black and 1 for white, and arrays of
            floating-point numbers too, whatever they hold.
        rule: the keywords of `torchlinf.simplify`.
    """

    reading: Reading = field(default_factory=Reading)
    probability: bool = False
    rule: Mapping[str, Any] = field(default_factory=dict)

    def settings(self) -> str:
        """All options as one line of JSON."""
        return json.dumps(asdict(self))


def simplify_groups(
    sources: Iterable[tuple[Source, Path]], options: Simplifying, *, workers: int = 1
) -> Generator[list[Simplified]]:
    """Simplify masks, in the order of the sources.

    Args:
        sources: what `find_masks` found, each with the file to write. A mask that fails writes no file.
        options: how.
        workers: how many masks are worked on at a time, as in `score_masks`.

    Yields:
        The rows of each source: one, or with `labels` one for each label.
    """
    return in_order(
        partial(simplify_source, options=options),
        sources,
        workers=workers,
        seconds=lambda rows: sum(row.seconds or 0.0 for row in rows),
        died=partial(_died, options=options),
    )


def _died(source: tuple[Source, Path], options: Simplifying) -> list[Simplified]:
    error = "the process that simplified it was killed or crashed; it may need more memory"
    return [replace(_blank(source[0], options), error=error)]


def _blank(source: Source, options: Simplifying) -> Simplified:
    return Simplified(source.name, version=__version__, options=options.settings())


def simplify_source(task: tuple[Source, Path], options: Simplifying) -> list[Simplified]:
    """Simplify the mask, or all labels, of a file, and write the file; whatever is wrong is the `error` of its row."""
    source, target = task
    blank, start = _blank(source, options), time.perf_counter()
    try:
        if source.member is not None or source.data is not None:
            raise UnreadableMaskError("a mask within another file is not written; unpack it")
        if source.error is not None:
            raise UnreadableMaskError(source.error)
        values = read_once(source.path, None, options.reading.max_pixels)
        if values.array.ndim != 2:
            raise UnreadableMaskError(f"an image must have two axes; got {values.array.shape}")
        file = PixelFile(source.path)
        pixels = file.pixels.reshape(*values.array.shape, -1).copy()
        left_out = _left_out(values, options.reading)
        if (probability := _probability(values, left_out, options)) is not None:
            rows = [_of_probability(probability, left_out, pixels, values, options)]
        else:
            found = list(read_all(source, options.reading, keep=True, advised=ADVISED))
            rows = _of_masks(found, left_out, pixels, values, options)
        target.parent.mkdir(parents=True, exist_ok=True)
        file.write(target, pixels.reshape(file.pixels.shape))
    except Exception as error:  # the others go on, whatever this one met
        return [replace(blank, error=error_text(error), seconds=round(time.perf_counter() - start, 6))]
    share = round((time.perf_counter() - start) / len(rows), 6)
    return [
        replace(
            blank,
            **{name: cell for name, cell in row.cells().items() if cell is not None and name != "path"},
            path=blank.path + row.path,
            seconds=share,
        )
        for row in rows
    ]


def _left_out(values: Values, reading: Reading) -> NDArray[np.bool_]:
    """The pixels that are never changed: what --ignore names, and what has no data, by the file itself."""
    left_out = is_ignored(values, reading)
    if values.valid is not None:
        left_out |= ~values.valid & (values.labels != 0)  # 0 is the outside, whatever else a file calls it
    return left_out


def _white(values: Values) -> float:
    """The number that stands for a probability of 1."""
    return 1.0 if values.array.dtype.kind == "f" else float(np.iinfo(values.array.dtype).max)


def _probability(values: Values, left_out: NDArray[np.bool_], options: Simplifying) -> NDArray[np.float64] | None:
    """The probabilities that a file holds; None if it is a mask or a label map."""
    array, reading = values.array, options.reading
    if reading.labels or reading.label is not None:
        if options.probability:
            raise UnreadableMaskError("labels are no probabilities; leave out --probability or the option of labels")
        return None
    if array.dtype.kind != "f":
        if not options.probability:
            return None
        if values.coloured or values.lossy or array.dtype not in (np.uint8, np.uint16):
            raise UnreadableMaskError(
                "probabilities must be floating-point numbers, or a grey image of 8 or 16 bits without loss"
            )
    probability = array / np.float64(_white(values))
    counted = probability[~left_out]
    if not options.probability:
        if not ((counted > 0) & (counted < 1)).any():
            return None
        threshold = reading.threshold
        if threshold is not None and (
            (threshold > 1 and (counted > threshold).any()) or (threshold < 0 and (counted < threshold).any())
        ):
            return None  # numbers on both sides of what no probability can be
    _require_probabilities(counted)
    return probability


def _require_probabilities(numbers: NDArray[np.float64]) -> None:
    """Raise if some numbers are none, and say how many."""
    low, high = numbers[numbers < 0], numbers[numbers > 1]
    counts = {
        "NaN": np.count_nonzero(np.isnan(numbers)),
        f"less than 0 (down to {low.min(initial=0)!s})": len(low),
        f"greater than 1 (up to {high.max(initial=1)!s})": len(high),
    }
    if wrong := [f"{count} {what}" for what, count in counts.items() if count]:
        example = int(low.min()) if len(low) and np.isfinite(low.min()) and low.min() == int(low.min()) else -9999
        raise UnreadableMaskError(
            f"numbers between 0 and 1 are probabilities, which must lie in [0, 1]; got pixels beside them: "
            f"{', '.join(wrong)}. Pass --ignore {example} if it stands for no data (save NaN as such a number), clip "
            "what is off by rounding, save the sigmoid of logits, or save the mask if these are no probabilities"
        )


def _of_probability(
    probability: NDArray[np.float64],
    left_out: NDArray[np.bool_],
    pixels: NDArray[Any],
    values: Values,
    options: Simplifying,
) -> Simplified:
    """Write 0 and white into the pixels of a file, but for those that are left out."""
    reading, white = options.reading, _white(values)
    threshold = HALF if reading.threshold is None else reading.threshold / white
    rule = above(HALF if reading.threshold is None else reading.threshold) + excepted(reading)
    if not 0 < threshold < 1:
        raise UnreadableMaskError(
            f"the threshold of probabilities must lie between 0 and {white:g}; got {reading.threshold:g}. Pass "
            f"--threshold {HALF * white:g}"
        )
    if taken := set(np.unique(values.array[left_out]).tolist()) & {0, white}:
        raise UnreadableMaskError(
            f"0 and {white:g} are written for outside and inside; got pixels without data that are {taken.pop():g}. "
            "Save them as another number, and pass --ignore with that"
        )
    if reading.invert:
        probability, threshold, rule = 1 - probability, 1 - threshold, f"not {rule}"
    probability = np.where(left_out, 0.0, probability)
    row, inside = _simplified(
        torch.from_numpy(probability), {**options.rule, "threshold": threshold}, torch.from_numpy(~left_out)
    )
    written = np.where(inside ^ reading.invert, white, 0).astype(pixels.dtype)
    pixels[~left_out] = written[~left_out][:, None]
    return replace(row, inside=rule)


def _of_masks(
    found: Sequence[Found],
    left_out: NDArray[np.bool_],
    pixels: NDArray[Any],
    values: Values,
    options: Simplifying,
) -> list[Simplified]:
    """Simplify the masks of a file in its pixels. What is lost becomes background, and only background is gained."""
    unknown = np.isnan(values.array) if values.array.dtype.kind == "f" else False
    free = ~(left_out | unknown)
    if options.reading.labels or options.reading.label is not None:
        free &= values.labels == 0  # what no other label has
        outside = _commonest(pixels, free)
    else:
        outside = _commonest(pixels, free & ~found[0].inside)
    rows = []
    for one in found:
        before = np.zeros(one.shape, np.bool_)
        before[tuple(slice(a, a + size) for a, size in zip(one.origin or (0, 0), one.inside.shape, strict=True))] = (
            one.inside
        )
        row, after = _simplified(torch.from_numpy(before), options.rule, torch.from_numpy(free))
        inside = _commonest(pixels, before)
        pixels[before & ~after] = outside
        pixels[after & ~before] = inside
        free &= ~after
        rows.append(replace(row, path=one.suffix, label=one.label, inside=one.rule))
    return rows


def _simplified(
    prediction: torch.Tensor, rule: Mapping[str, Any], allowed: torch.Tensor | None = None
) -> tuple[Simplified, NDArray[np.bool_]]:
    found = simplify(prediction, allowed=allowed, spatial_ndim=2, **rule)
    before = (prediction if prediction.dtype == torch.bool else prediction > rule["threshold"]).numpy()
    after = found.mask.numpy()
    row = Simplified(
        "",
        before=_known(found.before),
        after=_known(found.after),
        flips=int(found.num_flips),
        changed=int((before ^ after).sum()),
        cost=float(found.cost),
    )
    return row, after


def _known(value: torch.Tensor) -> float | None:
    """A number, None for NaN."""
    return None if math.isnan(value) else float(value)


def _commonest(pixels: NDArray[Any], where: NDArray[np.bool_]) -> NDArray[Any]:
    """The stored pixel (channels,) that most of some pixels have; zeros if there are none."""
    chosen = pixels[where]
    if not len(chosen):
        return np.zeros(pixels.shape[2:], pixels.dtype)
    kinds, counts = np.unique(chosen, axis=0, return_counts=True)
    most: NDArray[Any] = kinds[np.argmax(counts)]
    return most
