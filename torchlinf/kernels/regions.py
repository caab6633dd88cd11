"""Connected regions of binary maps: by a compiled kernel, or by SciPy's graphs where numba is not installed."""

from math import prod

import numpy as np

from torchlinf.kernels import has_compiler
from torchlinf.kernels.grid import interior, row_strides

SMALL = 1 << 12  # sizes below this are counted
FAR = 9999  # a size beyond all sides


class Maps:
    """Maps of the pixels whose size is below a side, for several sides.

    Args:
        sizes: (G, N, *spatial) of int16 or int32, G sizes of each pixel of N shapes.
        sides: ascending.

    Attributes:
        order: (G, N, pixels) int32, flat, those of smaller sizes first.
        ends: (G, N, sides) int64, how many of these are smaller than each side.

    >>> maps = Maps(np.array([[[3, 1, 9, 2]]]), (2, 4))
    >>> maps.order[0, 0, :3].tolist(), maps.ends.tolist()
    ([1, 0, 3], [[[1, 3]]])
    """

    def __init__(self, sizes: np.ndarray, sides: tuple[int, ...]) -> None:
        flat = sizes.reshape(*sizes.shape[:2], -1)
        if has_compiler():
            from torchlinf.kernels.region_flood import sort_by_size

            self.order, self.ends = np.empty(flat.shape, np.int32), np.empty((*flat.shape[:2], len(sides)), np.int64)
            kind = np.searchsorted(sides, np.arange(sides[-1]), side="right")
            rows = flat.shape[0] * flat.shape[1]
            sort_by_size(flat.reshape(rows, -1), kind, self.order.reshape(rows, -1), self.ends.reshape(rows, -1))
        else:
            kinds = np.searchsorted(sides, flat, side="right")
            self.order = kinds.argsort(axis=-1, kind="stable").astype(np.int32)
            self.ends = np.stack([(flat < side).sum(axis=-1) for side in sides], axis=-1)


class RegionList:
    """Regions of N shapes of one size, gathered from maps of marked pixels, within a budget.

    Args:
        sizes: of the array of each shape.
        limit: (N,) how many pixels a region may have.
        budget: how many pixels of each shape may be looked at; a group of maps that would need more is passed over.
        most: of regions of one size of a shape that a map holds, only `most` + 1 are kept.
    """

    def __init__(self, sizes: tuple[int, ...], limit: np.ndarray, budget: int, most: int) -> None:
        padded = tuple(size + 2 for size in sizes)
        self.strides = np.array(row_strides(padded))
        self._padded, self._limit, self._most = padded, limit.astype(np.int64), most
        self._left = np.where(limit > 0, budget, 0)
        within = np.full(padded, -1, np.int32)
        within[interior(len(sizes))] = np.arange(prod(sizes)).reshape(sizes)
        self._within = within.reshape(-1)
        self._place = np.flatnonzero(self._within >= 0).astype(np.int32)
        # The map as a whole and its regions: no more than twice what is looked at. What is not used is never touched.
        capacity = 2 * budget * len(limit)
        self._pixels, self._owner = np.empty((2, capacity), np.int32)
        self._begin, self._code = np.zeros(capacity + 1, np.int64), np.empty(capacity, np.uint64)
        self._tally, self._row = np.zeros(SMALL, np.int64), np.zeros(prod(padded), np.uint8)
        self._count = 0

    def gather(self, maps: "Maps", kind: int, offsets: np.ndarray, whole: bool) -> None:
        """Add the regions of the maps of one side, none of them if the map is the one of the side before.

        Args:
            maps: G maps of each of the shapes.
            kind: which of the sides.
            offsets: (G, K) flat, on the padded grid; two pixels of a map are joined if they differ by one of its
                offsets, which hold their negatives too; 0 for none.
            whole: whether a map as a whole is a region too.
        """
        if has_compiler():
            from torchlinf.kernels.region_flood import gather_maps

            self._count = gather_maps(
                maps.order, maps.ends, kind, offsets, whole, self._place, self._within, self._limit, self._left,
                self._most, self._tally, self._pixels, self._begin, self._owner, self._code, self._count, self._row,
            )  # fmt: skip
            return
        total = maps.ends[..., kind] * (maps.ends[..., kind] != (maps.ends[..., kind - 1] if kind else -1))
        for n in np.flatnonzero(total.sum(axis=0) <= self._left):
            self._left[n] -= total[:, n].sum()
            for g, steps in enumerate(offsets):
                self._row[self._place[maps.order[g, n, : total[g, n]]]] = 1
                regions = regions_by_graph(self._row, steps)
                self._row[:] = 0
                chosen = [np.concatenate(regions)] if whole and regions else []
                counted = np.zeros(SMALL, np.int64)
                for region in regions:
                    same = len(region) if len(region) < SMALL else 0
                    counted[same] += 1
                    if same == 0 or counted[same] <= self._most + 1:
                        chosen.append(region)
                for region in chosen:
                    if len(region) <= self._limit[n]:
                        self._add(int(n), self._within[region])

    def _add(self, shape: int, region: np.ndarray) -> None:
        first, number = self._begin[self._count], self._count
        self._pixels[first : first + len(region)] = region
        self._owner[number], self._begin[number + 1] = shape, first + len(region)
        self._code[number] = _code_of(region)
        self._count += 1

    def found(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The regions: pixels, begin, owner and code.

        Pixels region by region, flat on the array itself; where each region begins, and the last one ends; the shape
        that each is of; and 64 bits that are the same for the same pixels, and else different as good as always.
        """
        count = self._count
        begin = self._begin[: count + 1].copy()
        return self._pixels[: begin[-1]].copy(), begin, self._owner[:count].copy(), self._code[:count].copy()


def _code_of(region: np.ndarray) -> np.uint64:
    return np.uint64(hash(np.sort(region.astype(np.int32)).tobytes()) & (2**64 - 1))


def regions_by_graph(marked: np.ndarray, offsets: np.ndarray) -> list[np.ndarray]:
    """The regions of one flat map by the connected components of a sparse graph, in the order of their first pixels."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pixels = np.flatnonzero(marked)
    number = np.zeros(marked.size, np.int64)
    number[pixels] = np.arange(pixels.size)
    edges = [(pixels[there], offset) for offset in offsets[offsets > 0] for there in (marked[pixels + offset] > 0,)]
    one = np.concatenate([number[near] for near, _ in edges] or [pixels[:0]])
    other = np.concatenate([number[near + offset] for near, offset in edges] or [pixels[:0]])
    graph = coo_array((np.ones(one.size, np.int8), (one, other)), shape=(pixels.size, pixels.size))
    count, label = connected_components(graph, directed=False)
    if not count:
        return []
    order = np.argsort(label, kind="stable")
    return sorted(np.split(pixels[order], np.bincount(label).cumsum()[:-1]), key=lambda region: int(region[0]))
