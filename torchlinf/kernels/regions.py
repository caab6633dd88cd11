"""Connected regions of binary maps: by a compiled kernel, or by SciPy's graphs where numba is not installed."""

from math import prod

import numpy as np

from torchlinf.kernels import has_compiler
from torchlinf.kernels.grid import interior, row_strides

SMALL = 1 << 12  # sizes below this are counted


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
        # The map as a whole and its regions: no more than twice what is looked at. What is not used is never touched.
        capacity = 2 * budget * len(limit)
        self._pixels, self._owner = np.empty((2, capacity), np.int32)
        self._begin, self._code = np.zeros(capacity + 1, np.int64), np.empty(capacity, np.uint64)
        self._tally, self._marked = np.zeros(SMALL, np.int64), np.empty(prod(padded), np.int32)
        self._count = 0

    def empty_maps(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """So many maps of no pixels, (number, N, *padded) bool, and the view of them without the ring, to be marked."""
        maps = np.zeros((number, len(self._limit), *self._padded), np.bool_)
        return maps, maps[(slice(None), slice(None), *interior(len(self._padded)))]

    def gather(self, maps: np.ndarray, offsets: np.ndarray, whole: bool) -> None:
        """Add the regions of a group of maps, which are overwritten.

        Args:
            maps: (G, N, *padded) bool, with a ring of False.
            offsets: (G, K) flat, on the padded grid; two pixels of a map are joined if they differ by one of its
                offsets, which hold their negatives too; 0 for none.
            whole: whether a map as a whole is a region too.
        """
        flat = maps.reshape(*maps.shape[:2], -1).view(np.uint8)
        if has_compiler():
            from torchlinf.kernels.region_flood import gather_maps

            self._count = gather_maps(
                flat, offsets, whole, self._within, self._limit, self._left, self._most, self._tally, self._pixels,
                self._begin, self._owner, self._code, self._count, self._marked,
            )  # fmt: skip
            return
        total = flat.sum(axis=(0, 2), dtype=np.int64)
        for n in np.flatnonzero(total <= self._left):
            self._left[n] -= total[n]
            for marked, steps in zip(flat[:, n], offsets, strict=True):
                regions = regions_by_graph(marked, steps)
                chosen = [np.concatenate(regions)] if whole and regions else []
                counted = np.zeros(SMALL, np.int64)
                for region in regions:
                    kind = len(region) if len(region) < SMALL else 0
                    counted[kind] += 1
                    if kind == 0 or counted[kind] <= self._most + 1:
                        chosen.append(region)
                for region in chosen:
                    if len(region) <= self._limit[n]:
                        self._add(int(n), self._within[region])

    def _add(self, shape: int, region: np.ndarray) -> None:
        first, number = self._begin[self._count], self._count
        self._pixels[first : first + len(region)] = region
        self._owner[number], self._begin[number + 1] = shape, first + len(region)
        self._code[number] = code_of_pixels(region)
        self._count += 1

    def found(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The regions: pixels, begin, owner and code.

        Pixels region by region, flat on the array itself; where each region begins, and the last one ends; the shape
        that each is of; and 64 bits that are the same for the same pixels, and else different as good as always.
        """
        count = self._count
        begin = self._begin[: count + 1].copy()
        return self._pixels[: begin[-1]].copy(), begin, self._owner[:count].copy(), self._code[:count].copy()


def code_of_pixels(region: np.ndarray) -> np.uint64:
    """64 bits that are the same for the same pixels in any order, and for different ones as good as never."""
    pixels = region.astype(np.int32)
    if has_compiler():
        from torchlinf.kernels.region_flood import code_of

        return np.uint64(code_of(pixels))
    return np.uint64(hash(np.sort(pixels).tobytes()) & (2**64 - 1))


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
