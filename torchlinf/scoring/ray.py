"""Masks by the million on Ray: a class for pipelines of Ray Data, and a job from shards to a folder of Parquet files.

Needs the extra `ray` (Ray Data). What a worker does with a shard is in `shards`, which knows nothing of Ray.
"""

import logging
import os
import pickle
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack
from uuid import uuid4

from numpy.typing import NDArray

from torchlinf._helpers.extras import require
from torchlinf.measure import MeasureOptions, takes
from torchlinf.scoring import parquet
from torchlinf.scoring.in_memory import InMemory
from torchlinf.scoring.mask_rules import MAX_PIXELS
from torchlinf.scoring.options import ScoreOptions, score_measure
from torchlinf.scoring.rows import WINDOWS, Score
from torchlinf.scoring.score import score_rows
from torchlinf.scoring.shards import Part, Shard, find_shards, open_folder, read_part, score_shard, tidy
from torchlinf.scoring.sources import Source

if TYPE_CHECKING:
    import pyarrow

__all__ = ["Part", "ScoreMasks", "Shard", "connected", "find_shards", "score_shards"]

FEATURE = "torchlinf.scoring.ray"
STORE = 2**27  # bytes of shared memory of a local Ray: masks never go through it


@takes(MeasureOptions, windows=WINDOWS)
class ScoreMasks:
    """Scores batches of masks: for `Dataset.map_batches` of Ray Data, or alone.

    Give `map_batches` an instance, or the class itself with `fn_constructor_kwargs`, with `batch_format` "numpy" or
    "pyarrow". Of a mask that cannot be read or scored the row says why. A mask that ends its worker does so as often as
    Ray Data tries it again, which is without end; `score_shards` is safe from that.

    Args:
        column: of the batches, where the masks are. Bytes are the content of a file, text is a path, arrays are masks
            as in .npy files.
        name: of the column with what to call each mask, the `path` in the results.
        threshold: inside is what is greater, in each mask's own units.
        label: inside is what has this label.
        nonzero: inside is what is not 0: all labels as one shape. Without these three,
            `torchlinf.scoring.RULE` says what is inside.
        ignore: values that are outside of everything, such as 255, the void of PASCAL VOC; also with `invert`.
        invert: swap inside and outside.
        max_pixels: larger masks are refused.
        volume: arrays of three axes, and TIFFs of several pages, are volumes (D, H, W).
        labels: a row for each label of a map but 0, named with the label behind: "map.png#15".
        stack: arrays of three axes, and TIFFs of several pages, are masks (N, H, W), each with a row: "stack.npy[0]".
        spacing: size of a pixel along each axis, depth first, or "header" for what the file says, or "pixels" for none;
            None takes that of NIfTI and no other. A mask of oblong pixels is brought to cubes before it is measured:
            see `torchlinf.equal_spacing`.
        voxel: size of the cubes, in the same unit; None takes the finest of the spacing.
        spatial_ndim: dimensions of an array, 2 or 3, but for axes of length 1 before and behind them. Images with
            colours, (H, W, 3), are so told from volumes.
        {measure options}

    Returns:
        For a batch: a pyarrow.Table with the columns of `torchlinf.scoring.Score`, a row for each mask. If `low` or
        `high` is given, or `windows` is None, the one window is called "complexity".

    Raises:
        ImportError: pyarrow is not installed.
        KeyError: a batch lacks a column.
        TypeError: an option is of the wrong type; `rho` must be None or one number.
        ValueError: `spatial_ndim` is neither 2 nor 3, or an option has a wrong value.

    Example:
        >>> import numpy as np
        >>> batch = {"id": np.array(["box", "tri"]), "mask": np.stack([np.ones((6, 6)), np.tri(6)])}
        >>> rows = ScoreMasks("mask", name="id")(batch)
        >>> rows["path"].to_pylist(), rows["complexity"].to_pylist()
        (['box', 'tri'], [0.0, 0.612...])
    """

    def __init__(
        self,
        column: str,
        *,
        name: str = "path",
        threshold: float | None = None,
        label: int | None = None,
        nonzero: bool = False,
        ignore: int | Collection[int] = (),
        invert: bool = False,
        max_pixels: int = MAX_PIXELS,
        volume: bool = False,
        labels: bool = False,
        stack: bool = False,
        spacing: str | Sequence[float] | None = None,
        voxel: float | None = None,
        spatial_ndim: int = 2,
        **options: Unpack[MeasureOptions],
    ) -> None:
        if spatial_ndim not in (2, 3):
            raise ValueError(f"spatial_ndim must be 2 or 3; got {spatial_ndim!r}. Pass 3 for volumes (D, H, W).")
        self.column, self.name, self.spatial_ndim = column, name, spatial_ndim
        self.options = ScoreOptions(
            threshold, invert, max_pixels, None, score_measure(options), label, nonzero, ignore, volume, labels, stack,
            spacing, voxel,
        )  # fmt: skip

    def __call__(self, batch: "Mapping[str, NDArray[Any]] | pyarrow.Table") -> "pyarrow.Table":
        """Score a batch; see the class."""
        parquet.require_pyarrow()
        names, values = self._column(batch, self.name), self._column(batch, self.column)
        rows = (row for name, value in zip(names, values, strict=True) for row in self._score(str(name), value))
        return parquet.table(rows, self.options.columns)

    def _score(self, name: str, value: Any) -> list[Score]:
        source = (
            Source(Path(value))
            if isinstance(value, str)
            else Source(Path(name), data=InMemory(value, self.spatial_ndim))
        )
        rows = score_rows(source, self.options)
        return [replace(row, path=name + row.path.removeprefix(source.name)) for row in rows]

    def _column(self, batch: Any, name: str) -> Sequence[Any]:
        known = batch.column_names if hasattr(batch, "column_names") else list(batch)
        if name not in known:
            raise KeyError(f"batches must hold the column {name!r}; got {', '.join(known)}. Pass column= and name=.")
        column = batch[name]
        if not hasattr(column, "chunks"):
            return column
        # A column of tensors becomes arrays, by Ray's own rule; all else plain values.
        is_tensor = hasattr(column.type, "extension_name")
        return [row for chunk in column.chunks for row in (chunk.to_numpy() if is_tensor else chunk.to_pylist())]


@takes(MeasureOptions, windows=WINDOWS)
def score_shards(
    shards: Sequence[Shard],
    out: str | os.PathLike[str],
    *,
    threshold: float | None = None,
    label: int | None = None,
    nonzero: bool = False,
    ignore: int | Collection[int] = (),
    invert: bool = False,
    max_pixels: int = MAX_PIXELS,
    volume: bool = False,
    labels: bool = False,
    stack: bool = False,
    spacing: str | Sequence[float] | None = None,
    voxel: float | None = None,
    members: str | None = None,
    map_options: Mapping[str, Any] | None = None,
    **options: Unpack[MeasureOptions],
) -> Iterator[Part]:
    """Score shards on Ray, each into a Parquet file of its own.

    A part that is in the folder already is not done again, so that a job that was killed is continued by the same
    call. A shard whose worker was lost is tried again, then with its masks in a process of their own: one that ends
    that process gives a row with an error. A shard that costs five workers in one call is given up, and the rows of its
    files say so.

    Args:
        shards: what `find_shards` found. Workers read the files under the same names, and write to the same `out`, so
            both must be on a file system that all machines share.
        out: the folder of the parts; made if it is not there. `torchlinf.scoring.read_table` reads it.
        threshold: inside is what is greater, in each file's own units.
        label: inside is what has this label.
        nonzero: inside is what is not 0: all labels as one shape. Without these three,
            `torchlinf.scoring.RULE` says what is inside.
        ignore: values that are outside of everything, such as 255, the void of PASCAL VOC; also with `invert`.
        invert: swap inside and outside.
        max_pixels: larger masks are refused.
        volume: arrays of three axes, and TIFFs of several pages, are volumes (D, H, W).
        labels: a row for each label of a map but 0, named with the label behind: "map.png#15".
        stack: arrays of three axes, and TIFFs of several pages, are masks (N, H, W), each with a row: "stack.npy[0]".
        spacing: size of a pixel along each axis, depth first, or "header" for what the file says, or "pixels" for none;
            None takes that of NIfTI and no other. A mask of oblong pixels is brought to cubes before it is measured:
            see `torchlinf.equal_spacing`.
        voxel: size of the cubes, in the same unit; None takes the finest of the spacing.
        members: which members of tar archives are masks, as a pattern such as `*.mask.png`; None takes all with a
            suffix of a mask.
        map_options: keywords for `Dataset.map` of Ray Data, such as `num_cpus` (1), `memory` (bytes) or `concurrency`.
        {measure options}

    Returns:
        An iterator of one `Part` a shard: first those that were in the folder, then the others, each when it is done.
        The rows are those of `score_masks`, apart from the seconds.

    Raises:
        ImportError: Ray Data is not installed.
        TypeError: an option is of the wrong type; `rho` must be None or one number.
        ValueError: an option has a wrong value, or `out` holds parts of other settings or of another list of files.
        OSError: a part cannot be written.
    """
    ray_data = _require_ray().data
    folder, measure = Path(out).absolute(), score_measure(options)
    chosen = ScoreOptions(
        threshold, invert, max_pixels, members, measure, label, nonzero, ignore, volume, labels, stack, spacing, voxel
    )
    open_folder(folder, shards, chosen)
    missing = []
    for shard in shards:
        if (part := read_part(folder / shard.part, chosen.columns)) is None:
            missing.append(shard)
        else:
            yield part
    if missing:
        # A block a shard: a block is what is tried again. Names may be no text, so that they travel pickled.
        rows = [{"shard": pickle.dumps(shard)} for shard in missing]
        data = ray_data.from_items(rows, override_num_blocks=len(rows))
        done = data.map(_Work(folder, chosen), **{"num_cpus": 1, **(map_options or {})})
        done.context.enable_progress_bars = done.context.print_on_execution_start = False
        done.context.execution_no_progress_timeout_s = -1  # a shard takes what it takes
        for row in done.iter_rows():
            answer = pickle.loads(row["answer"])
            if isinstance(answer, Exception):
                raise answer
            yield answer
    tidy(folder, shards)


@contextmanager
def connected(address: str = "local", *, workers: int | None = None) -> Iterator[None]:
    """Connect to a cluster, or start Ray on this machine, and part from it at the end.

    Args:
        address: "local" starts one here, without usage statistics; "auto" takes the cluster that this machine belongs
            to; all else goes to `ray.init`, such as "host:6379" or "ray://host:10001".
        workers: cores to use where it is "local"; None takes all.

    Raises:
        ImportError: Ray Data is not installed.
        ConnectionError: there is no cluster at that address.
    """
    ray = _require_ray()
    local: dict[str, Any] = {"num_cpus": workers, "include_dashboard": False, "object_store_memory": STORE}
    with _no_usage_statistics() if address == "local" else nullcontext():
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR, **(local if address == "local" else {}))
    try:
        yield
    finally:
        ray.shutdown()


def _require_ray() -> Any:
    ray = require("ray", FEATURE, "ray")
    require("ray.data", FEATURE, "ray")
    return ray


@contextmanager
def _no_usage_statistics() -> Iterator[None]:
    """Ray reads this wish from the environment alone, when it starts; afterwards the environment is as it was."""
    name = "RAY_USAGE_STATS_ENABLED"
    if name in os.environ:
        yield
        return
    os.environ[name] = "0"
    try:
        yield
    finally:
        del os.environ[name]


class _Work:
    """What a worker does with a row of the dataset."""

    def __init__(self, out: Path, options: ScoreOptions) -> None:
        self.out, self.options, self.run = out, options, uuid4().hex

    def __call__(self, row: Mapping[str, Any]) -> dict[str, bytes]:
        """The part of the row's shard, or why there is none, which Ray would wrap in errors of its own."""
        try:
            answer: Part | Exception = score_shard(pickle.loads(row["shard"]), self.out, self.options, self.run)
        except Exception as error:
            answer = error
        return {"answer": pickle.dumps(answer)}
