"""The runs of an outline, and the cheapest chain of them, against plain loops over everything."""

import numpy as np
import pytest

from torchlinf.kernels import straight_sides
from torchlinf.kernels.straight_sides import ALL, LAST, cheapest, runs
from torchlinf.polygons.straight_outline import FREE, _candidates, _sums

FRAME = 0.2


def ring(name: str) -> np.ndarray:
    """Outlines in units of the tolerance, counter-clockwise, as candidates."""
    if name == "slanted":  # long stairs, whose longest runs end where the wall does
        x, y = np.arange(150), np.round(0.3 * np.arange(150))
        low = np.stack([np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]], axis=1)
        return _candidates(np.concatenate([low, np.add(low[::-1], [0, 40])]) * 1.2)
    if name == "circle":  # of which they end long before the directions have run out
        angle = np.linspace(0, 2 * np.pi, 500, endpoint=False)
        return _candidates(300 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    rng = np.random.default_rng(int(name))
    angle = np.sort(rng.uniform(0, 2 * np.pi, 24))
    return _candidates((rng.uniform(4, 12, 24) * np.stack([np.cos(angle), np.sin(angle)])).T)


def lines_of(points: np.ndarray, i: int, j: int, frame: float | None) -> list[tuple[tuple[float, ...], float, float]]:
    """The line of the outline from point i to point j, and in the frame; how far from 1 its width is; its price."""
    part = np.take(points, np.arange(i, j + 1), axis=0, mode="wrap")
    step = np.diff(part, axis=0)
    length = np.hypot(*step.T)
    middle = np.average((part[1:] + part[:-1]) / 2, axis=0, weights=length)
    ends = np.stack([part[:-1], part[1:]]) - middle
    # Over a straight piece, the mean of a square is that of its ends and of four times its middle, by Simpson's rule.
    square = [np.einsum("ni,nj->nij", one, one) for one in (*ends, ends.mean(axis=0))]
    spread = np.average((square[0] + square[1] + 4 * square[2]) / 6, axis=0, weights=length)
    along = np.linalg.eigh(spread)[1][:, 1]
    along = along if along @ (part[-1] - part[0]) >= 0 else -along
    directions = [(along, 1.0 if frame is None else 1.0 + FREE)]
    if frame is not None:
        quarter = np.round((np.arctan2(along[1], along[0]) - frame) / (np.pi / 2)) * np.pi / 2 + frame
        framed = np.array([np.cos(quarter), np.sin(quarter)])
        if abs(framed[0] * along[1] - framed[1] * along[0]) <= 0.35:
            directions.append((framed, 1.0))
    found = []
    around = np.hypot(*(np.roll(points, -1, axis=0) - points).T).sum()
    for along, price in directions:
        across = np.array([-along[1], along[0]])
        off, far = part @ across, part @ along
        slack = min(2.0 - np.ptp(off), far[-1] - far.max() + 1.0, far.min() + 1.0 - far[0])
        offset = min(max(middle @ across, off.max() - 1.0), off.min() + 1.0)
        error = (across @ spread @ across + (offset - middle @ across) ** 2) * length.sum() / around
        found.append(((*along, offset), slack, price + error))
    return found


@pytest.mark.parametrize("name", ["slanted", "circle", "0", "1"])
@pytest.mark.parametrize("frame", [None, FRAME])
def test_runs_are_all_that_have_a_line_within_the_tolerance(name: str, frame: float | None) -> None:
    points = ring(name)
    number = len(points)
    ends, lines, prices = runs(points, _sums(points), frame or 0.0, 0.0 if frame is None else FREE)
    found = {}
    for (i, j), line, price in zip(ends.tolist(), lines, prices, strict=True):
        found.setdefault((i, j), []).append((*line, price))
    for i in range(0, number, 1 + number // 5):
        tried = {j: lines_of(points, i, j, frame) for j in range(i + 1, i + number)}
        assert min(abs(slack) for each in tried.values() for _, slack, _ in each) > 1e-9  # none is in doubt
        fitting = {j: [one for one in each if one[1] > 0] for j, each in tried.items()}
        farthest = max(j for j, each in fitting.items() if each)
        for j, each in fitting.items():
            expected = [(*line, price) for line, _, price in each] if j - i <= ALL or j > farthest - LAST else []
            # Its direction is none where a run is as wide as long.
            np.testing.assert_allclose(np.array(found.get((i, j), [])), np.array(expected), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_the_cheapest_chain_is_that_of_a_search_without_a_limit(seed: int) -> None:
    points = ring(str(seed))
    number = len(points)
    ends, lines, prices = runs(points, _sums(points), FRAME, FREE)
    rng = np.random.default_rng(seed)
    lengths = set()
    for anchor in rng.choice(len(ends), 12, replace=False).tolist():
        start = ends[anchor, 0]
        best, corner, before = {anchor: prices[anchor]}, {}, {}
        begin = (ends[:, 0] - start) % number
        last = begin + ends[:, 1] - ends[:, 0]
        whole, chain = np.inf, []
        for step in range(1, number + 1):
            into = sorted((r for r in np.flatnonzero(last == step).tolist() if r in best), key=best.__getitem__)
            closes = step == number
            for q in [anchor] if closes else np.flatnonzero((begin == step) & (last <= number)).tolist():
                for r in into:
                    fits, x, y = straight_sides._joined(points, ends, lines, r, q)
                    if fits and (r == anchor or lines[r, :2] @ (np.array([x, y]) - corner[r]) > 0):
                        if closes:
                            whole, chain = best[r], [r]
                        else:
                            best[q], corner[q], before[q] = best[r] + prices[q], np.array([x, y]), r
                        break
        while chain and chain[0] in before:
            chain.insert(0, before[chain[0]])
        found, _, price = cheapest(points, ends, lines, prices, anchor)
        assert found.tolist() == chain
        if chain:
            assert price == pytest.approx(whole)
        lengths.add(len(chain))
    assert max(lengths) >= 3
