"""Masks by the million on Ray: a class for pipelines of Ray Data, and a job from shards to a folder of Parquet files.

Needs the extra `ray` (Ray Data). What a worker does with a shard is in `_shards`, which knows nothing of Ray.
"""

import logging
import os
import pickle
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from numpy.typing import NDArray

from torchlinf.scoring import parquet
from torchlinf.scoring.in_memory import Held
from torchlinf.scoring.mask_rules import MAX_PIXELS
from torchlinf.scoring.rows import Score
from torchlinf.scoring.score import score_source
from torchlinf.scoring.shards import Options, Part, Shard, find_shards, open_folder, read_part, score_shard, tidy
from torchlinf.scoring.sources import Source

if TYPE_CHECKING:
    import pyarrow

__all__ = ["Part", "ScoreMasks", "Shard", "connected", "find_shards", "score_shards"]

STORE = 2**27  # bytes of shared memory of a local Ray: masks never go through it


class ScoreMasks:
    """Scores batches of masks: for `Dataset.map_batches` of Ray Data, or alone.

    Give `map_batches` an instance, or the class itself with `fn_constructor_kwargs`, with `batch_format` "numpy" or
    "pyarrow". Of a mask that cannot be read or scored the row says why. A mask that ends its worker does so as often as
    Ray Data tries it again, which is without end; `score_shards` is safe from that.

    Args:
        column: of the batches, where the masks are. Bytes are the content of a file, text is a path, arrays are masks
            as in .npy files.
        name: of the column with what to call each mask, the `path` in the results.
        threshold: inside is what is greater, in each mask's own units; None chooses by `torchlinf.scoring.RULE`.
        invert: swap inside and outside.
        max_pixels: larger masks are refused.
        spatial_ndim: dimensions of an array, 2 or 3, but for leading axes of length 1. Images with colours, (H, W, 3),
            are so told from volumes.

    Returns:
        For a batch: a pyarrow.Table with the columns of `torchlinf.scoring.Score`, a row for each mask.

    Raises:
        ImportError: pyarrow is not installed.
        KeyError: a batch lacks a column.
        ValueError: `spatial_ndim` is neither 2 nor 3.

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
        invert: bool = False,
        max_pixels: int = MAX_PIXELS,
        spatial_ndim: int = 2,
    ) -> None:
        if spatial_ndim not in (2, 3):
            raise ValueError(f"spatial_ndim must be 2 or 3; got {spatial_ndim!r}. Pass 3 for volumes (D, H, W).")
        self.column, self.name, self.spatial_ndim = column, name, spatial_ndim
        self.options = Options(threshold, invert, max_pixels)

    def __call__(self, batch: "Mapping[str, NDArray[Any]] | pyarrow.Table") -> "pyarrow.Table":
        """Score a batch; see the class."""
        parquet.require_pyarrow()
        names, values = self._column(batch, self.name), self._column(batch, self.column)
        return parquet.table(self._score(str(name), value) for name, value in zip(names, values, strict=True))

    def _score(self, name: str, value: Any) -> Score:
        place = None if isinstance(value, str) else Held(value, self.spatial_ndim)
        row = score_source(Source(Path(value if place is None else name), place=place), **self.options.reading)
        return replace(row, path=name)

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


def score_shards(
    shards: Sequence[Shard],
    out: str | os.PathLike[str],
    *,
    threshold: float | None = None,
    invert: bool = False,
    max_pixels: int = MAX_PIXELS,
    members: str | None = None,
    **map_options: Any,
) -> Iterator[Part]:
    """Score shards on Ray, each into a Parquet file of its own.

    What is there already is not done again, so that a job that was killed is continued by the same call. A shard whose
    worker was lost is tried again, then with its masks in a process of their own: one that ends that process gives a
    row with an error. A shard that costs five workers in one call is given up, and the rows of its files say so.

    Args:
        shards: what `find_shards` found. Workers read the files under the same names, and write to the same `out`, so
            both must be on a file system that all machines share.
        out: the folder of the parts; made if it is not there. `torchlinf.scoring.read_table` reads it.
        threshold: as in `score_masks`.
        invert: as there.
        max_pixels: as there.
        members: as in `find_masks`.
        map_options: named options of `Dataset.map` of Ray Data, such as `num_cpus` (1), `memory` (bytes) or
            `concurrency`.

    Returns:
        An iterator of one `Part` a shard: first those that were there, then the others, each when it is done. The
        rows are those of `score_masks`, apart from the seconds.

    Raises:
        ImportError: Ray Data is not installed.
        ValueError: `out` holds parts of other settings, or of another list of single files.
        OSError: a part cannot be written.
    """
    ray_data = _require_ray().data
    folder, options = Path(out).absolute(), Options(threshold, invert, max_pixels, members)
    open_folder(folder, shards, options)
    missing = []
    for shard in shards:
        if (part := read_part(folder / shard.part)) is None:
            missing.append(shard)
        else:
            yield part
    if missing:
        # A block a shard: a block is what is tried again. Names may be no text, so that they travel pickled.
        rows = [{"shard": pickle.dumps(shard)} for shard in missing]
        data = ray_data.from_items(rows, override_num_blocks=len(rows))
        done = data.map(_Work(folder, options), **{"num_cpus": 1, **map_options})
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
    if address == "local":
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    ray = _require_ray()
    local = {"num_cpus": workers, "include_dashboard": False, "object_store_memory": STORE}
    ray.init(address, log_to_driver=False, logging_level=logging.ERROR, **(local if address == "local" else {}))
    try:
        yield
    finally:
        ray.shutdown()


class _Work:
    """What a worker does with a row of the dataset."""

    def __init__(self, out: Path, options: Options) -> None:
        self.out, self.options, self.run = out, options, uuid4().hex

    def __call__(self, row: Mapping[str, Any]) -> dict[str, bytes]:
        """The part of the row's shard, or why there is none, which Ray would wrap in errors of its own."""
        try:
            answer: Part | Exception = score_shard(pickle.loads(row["shard"]), self.out, self.options, self.run)
        except Exception as error:
            answer = error
        return {"answer": pickle.dumps(answer)}


def _require_ray() -> Any:
    try:
        import ray
        import ray.data
    except ImportError as error:
        raise ImportError(
            "torchlinf.scoring.distributed needs Ray Data, which is not installed. Run: pip install 'torchlinf[ray]'"
        ) from error
    return ray
