"""Masks in files to simpler masks in files of the same kind, and a row of numbers for each."""

import json
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
from torchlinf.losses import simplify
from torchlinf.scoring.cells import number_value, text_value
from torchlinf.scoring.last_read import read_once
from torchlinf.scoring.mask_rules import Found, Reading, read_all
from torchlinf.scoring.score import EMPTY, error_text
from torchlinf.scoring.sources import Source
from torchlinf.scoring.values import UnreadableMaskError, Values
from torchlinf.scoring.workers import in_order
from torchlinf.scoring.written_masks import PixelFile

HALF = 0.5


@dataclass(frozen=True)
class Simplified:
    """One row of the table of simplified masks.

    Attributes:
        path: the file, and behind it the label, as in "map.png#15".
        label: the label; None where the mask is not one of a map.
        before: complexity of the mask as it was, in bits (share of the field's maximum for the estimator "std").
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
        probability: whether 8-bit and 16-bit grey images hold probabilities, 0 for black and 1 for white.
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
        found = list(read_all(source, options.reading, keep=True))
        file = PixelFile(source.path)
        pixels = file.pixels.reshape(*found[0].shape, -1).copy()
        if (probability := _probability(values, options)) is not None:
            rows, inside = _of_probability(probability, found[0], values, options)
            top = np.ones((), pixels.dtype) if pixels.dtype.kind == "f" else np.iinfo(pixels.dtype).max
            pixels[...] = np.where(inside, top, np.zeros((), pixels.dtype))[..., None]
        else:
            rows = _of_masks(found, pixels, values, options)
        if not any(row.error for row in rows):
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


def _probability(values: Values, options: Simplifying) -> NDArray[np.float64] | None:
    """The probabilities that a file holds; None if it is a mask or a label map."""
    array, reading = values.array, options.reading
    if reading.labels or reading.label is not None or reading.nonzero:
        if options.probability:
            raise UnreadableMaskError("labels are no probabilities; leave out --probability or the option of labels")
        return None
    if options.probability:
        if values.coloured or values.lossy or array.dtype not in (np.uint8, np.uint16):
            raise UnreadableMaskError("probabilities must be a grey image of 8 or 16 bits without loss, or an array")
        return array / float(np.iinfo(array.dtype).max)
    if array.dtype.kind != "f" or not np.isfinite(array).all() or array.min() < 0 or array.max() > 1:
        return None
    return array.astype(np.float64) if ((array > 0) & (array < 1)).any() else None


def _of_probability(
    probability: NDArray[np.float64], found: Found, values: Values, options: Simplifying
) -> tuple[list[Simplified], NDArray[np.bool_]]:
    threshold = options.reading.threshold
    if threshold is None:
        threshold, rule = HALF, f"> {HALF:g}"
    else:
        rule = found.rule
        threshold = threshold / float(np.iinfo(values.array.dtype).max) if options.probability else threshold
    if options.reading.invert:
        probability, threshold, rule = 1 - probability, 1 - threshold, f"not > {threshold:g}"
    if not (probability > threshold).any():
        return [Simplified("", inside=rule, error=EMPTY)], found.inside
    row, mask = _simplified(torch.from_numpy(probability), {**options.rule, "threshold": threshold})
    return [replace(row, inside=rule)], ~mask if options.reading.invert else mask


def _of_masks(found: Sequence[Found], pixels: NDArray[Any], values: Values, options: Simplifying) -> list[Simplified]:
    """Simplify the masks of a file in its pixels. What is lost becomes background, and only background is gained."""
    if options.reading.labels or options.reading.label is not None:
        free = (values.array if values.ids is None else values.ids) == 0  # what no other label has
        outside = _commonest(pixels, free)
    else:
        free = np.ones(found[0].shape, np.bool_)
        outside = _commonest(pixels, ~found[0].inside)
    rows = []
    for one in found:
        if not one.inside.any():
            rows.append(Simplified(one.suffix, label=one.label, inside=one.rule, error=EMPTY))
            continue
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
        before=float(found.before),
        after=float(found.after),
        flips=int(found.num_flips),
        changed=int((before ^ after).sum()),
        cost=float(found.cost),
    )
    return row, after


def _commonest(pixels: NDArray[Any], where: NDArray[np.bool_]) -> NDArray[Any]:
    """The stored pixel (channels,) that most of some pixels have; zeros if there are none."""
    chosen = pixels[where]
    if not len(chosen):
        return np.zeros(pixels.shape[2:], pixels.dtype)
    kinds, counts = np.unique(chosen, axis=0, return_counts=True)
    most: NDArray[Any] = kinds[np.argmax(counts)]
    return most
