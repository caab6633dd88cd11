"""Noise of a turn: `python -m benchmarks.orientation [--half report] [--buildings 300]`; prints Markdown tables.

Buildings come from the folder TORCHLINF_FOOTPRINTS (boulder_13491.gpkg, bubenec_144.gpkg), silhouettes from
TORCHLINF_MPEG7; without one its tables are left out. shapely, and geopandas for the buildings, must be installed.
"""

import argparse
import time
from collections.abc import Sequence

import numpy as np
import torch
from scipy.stats import spearmanr

import torchlinf
from benchmarks.orientation import outlines
from benchmarks.orientation.outlines import Drawn, Mask
from benchmarks.orientation.ways import WAYS, Way
from torchlinf.measure import MeanOptions, Measure, own_angle, ragged_profile, smallest_rectangle, turned

ANGLES = (7.0, 20.0, 33.0, 45.0, 71.0)
SLOW = "majority of 9 x 9 (area)"  # minutes on large masks, and no better than 5 x 5


def bits(mask: Mask) -> tuple[float, float, float]:
    """Complexity over all scales, over (1/4, 1] and over (0.1, 1]."""
    profile = torchlinf.complexity_profile(torch.from_numpy(np.ascontiguousarray(mask)), spatial_ndim=2)
    return float(profile.mean()), float(profile.mean(0.25, 1.0)), float(profile.mean(0.1, 1.0))


def hull_angle(mask: Mask) -> float:
    """The turn of the smallest rectangle around the corners of the pixels themselves."""
    corners = (np.argwhere(mask)[:, None] + np.array([[0, 0], [0, 1], [1, 0], [1, 1]])).reshape(-1, 2)
    found = smallest_rectangle(corners)
    return found.angle if found.saves else 0.0


def as_it_is(mask: Mask, degrees: float) -> Mask:
    """No turn."""
    return mask


def agreement(name: str, found: Sequence[Sequence[float]], true: Sequence[Sequence[float]]) -> None:
    """One row: rank correlation, mean absolute differences, mean difference."""
    x, y = np.array(found), np.array(true)
    apart = np.abs(x - y).mean(axis=0)
    rank = float(spearmanr(x[:, 0], y[:, 0])[0])
    print(f"| {name} | {rank:.3f} | {apart[0]:.3f} | {apart[1]:.3f} | {(x - y)[:, 0].mean():+.3f} |", flush=True)


def buildings(number: int, report: bool) -> None:
    """Outlines of Boulder at random angles, as masks, against the same drawn in their own frame."""
    rng = np.random.default_rng(14 + report)
    all_of_them = outlines.footprints("boulder_13491.gpkg")
    if not all_of_them:
        return
    half = np.random.default_rng(14).permutation(len(all_of_them))[int(report) :: 2]
    shapes = [found for i in half[:number] if (found := outlines.at_random(all_of_them[i], rng)) is not None]
    true = [bits(shape.own) for shape in shapes]
    print(f"\n{len(shapes)} buildings of Boulder\n\n| way | Spearman | (0, 1] | (1/4, 1] | mean difference |")
    print("|---|---|---|---|---|")
    angles = [own_angle(shape.mask) for shape in shapes]
    agreement("not turned", [bits(shape.mask) for shape in shapes], true)
    for name, way in WAYS.items():
        agreement(name, [bits(_turn(way, s.mask, a)) for s, a in zip(shapes, angles, strict=True)], true)
    agreement("outline, angle of the pixels' hull", [bits(turned(s.mask, hull_angle(s.mask))) for s in shapes], true)
    agreement("outline, true angle", [bits(turned(s.mask, s.angle)) for s in shapes], true)
    other = [
        outlines.drawn(outlines.turned_outline(s.outline, s.angle), tuple(rng.uniform(-0.5, 0.5, 2))) for s in shapes
    ]
    agreement("drawn in its own frame, grid anywhere", [bits(mask) for mask in other], true)
    other = [_larger(s, rng.uniform(0.97, 1.03)) for s in shapes]
    agreement("drawn in its own frame, 3 % larger or smaller at most", [bits(mask) for mask in other], true)
    wrong = {"own_angle": angles, "angle of the pixels' hull": [hull_angle(s.mask) for s in shapes]}
    for name, found in wrong.items():
        off = np.abs((np.array(found) - [s.angle for s in shapes] + 45) % 90 - 45)
        print(f"\n{name}: degrees off, quantiles 50, 75, 90, 95 %: {np.quantile(off, [0.5, 0.75, 0.9, 0.95]).round(3)}")


def _turn(way: Way, mask: Mask, degrees: float) -> Mask:
    return way(mask, degrees) if degrees else mask


def _larger(shape: Drawn, factor: float) -> Mask:
    from shapely import affinity

    own = outlines.turned_outline(shape.outline, shape.angle)
    return outlines.drawn(affinity.scale(own, factor, factor, origin=(0, 0)))


def plain_shapes(number: int, report: bool) -> None:
    """Rectangles, L shapes and discs at random angles."""
    rng = np.random.default_rng(140 + report)
    kinds = {
        "rectangles": outlines.rectangles,
        "L shapes": outlines.corners,
        "discs, turned by 20 degrees": outlines.discs,
    }
    for title, kind in kinds.items():
        shapes = [found for one in kind(number, rng) if (found := outlines.at_random(one, rng)) is not None]
        true = np.array([bits(shape.own) for shape in shapes])
        print(f"\n{len(shapes)} {title}: bits over (0.1, 1], and off the same drawn in its own frame\n")
        print("| way | mean | largest | share <= 0.1 | off (0, 1] | off (1/4, 1] |\n|---|---|---|---|---|---|")
        angles = [20.0 if kind is outlines.discs else own_angle(shape.mask) for shape in shapes]
        for name, way in ({"not turned": as_it_is} | WAYS).items():
            found = np.array([bits(_turn(way, s.mask, a)) for s, a in zip(shapes, angles, strict=True)])
            off = np.abs(found - true).mean(axis=0)
            most, simple = found[:, 2], float((found[:, 2] <= 0.1).mean())
            print(f"| {name} | {most.mean():.3f} | {most.max():.2f} | {simple:.1%} | {off[0]:.3f} | {off[1]:.3f} |")


def bubenec() -> None:
    """144 outlines as they lie: rank correlation with the unfilled share of the smallest rectangle, at four places."""
    rng = np.random.default_rng(5)
    all_of_them = outlines.footprints("bubenec_144.gpkg")
    if not all_of_them:
        return
    drawn = [outlines.at_random(outline, rng, most=0.0) for _ in range(4) for outline in all_of_them]
    shapes = [shape for shape in drawn if shape is not None]
    print(
        f"\n{len(all_of_them)} buildings of Bubenec, each at four places of the grid: Spearman with the unfilled share"
    )
    print("\n| way | mean | least | most |\n|---|---|---|---|")
    angles = [own_angle(shape.mask) for shape in shapes]
    for name, way in ({"not turned": as_it_is} | WAYS).items():
        if name == SLOW:
            continue
        _share_row(name, shapes, [_turn(way, s.mask, a) for s, a in zip(shapes, angles, strict=True)])
    _share_row("drawn in its own frame", shapes, [shape.own for shape in shapes])


def _share_row(name: str, shapes: Sequence[Drawn], masks: Sequence[Mask]) -> None:
    values, unfilled = [bits(mask)[0] for mask in masks], [shape.unfilled for shape in shapes]
    size = len(shapes) // 4
    ranks = [spearmanr(values[k : k + size], unfilled[k : k + size])[0] for k in range(0, 4 * size, size)]
    print(f"| {name} | {np.mean(ranks):.3f} | {min(ranks):.3f} | {max(ranks):.3f} |", flush=True)


def detail(side: int, report: bool) -> None:
    """Silhouettes turned: against the large silhouette turned and then shrunk, and turned back against themselves."""
    large = outlines.silhouettes()[int(report) :: 2]
    if not large:
        return
    print(
        f"\n{len(large)} silhouettes of {side} pixels at {len(ANGLES)} angles: bits off the large one, turned and then"
    )
    print("shrunk; and turned there and back, IoU with what it was and bits off that\n")
    print("| way | Spearman | off (0, 1] | off (1/4, 1] | back: IoU | back: off (0, 1] | back: off (1/4, 1] |")
    print("|---|---|---|---|---|---|---|")
    small = [outlines.shrunk(mask, side) for mask in large]
    base = np.array([bits(mask) for mask in small])
    fine = WAYS["linear"]
    true = np.array([bits(_at_scale(fine(mask, a), side / max(mask.shape))) for mask in large for a in ANGLES])
    for name, way in WAYS.items():
        there = [way(mask, angle) for mask in small for angle in ANGLES]
        found = np.array([bits(mask) for mask in there])
        back = [way(mask, -angle) for mask, angle in zip(there, ANGLES * len(small), strict=True)]
        again = np.array([bits(mask) for mask in back])
        same = np.mean([_iou(a, small[i // len(ANGLES)]) for i, a in enumerate(back)])
        off, off_again = np.abs(found - true).mean(axis=0), np.abs(again - base.repeat(len(ANGLES), 0)).mean(axis=0)
        row = [float(spearmanr(found[:, 0], true[:, 0])[0]), *off[:2], same, *off_again[:2]]
        print(f"| {name} | {' | '.join(f'{number:.3f}' for number in row)} |", flush=True)


def _at_scale(mask: Mask, factor: float) -> Mask:
    return outlines.shrunk(mask, round(max(mask.shape) * factor))


def _iou(a: Mask, b: Mask) -> float:
    """Intersection over union where their boxes' middles meet, to a pixel; the best of the places around."""
    size = np.maximum(a.shape, b.shape) + 4
    fixed = _placed(a, size, (0, 0))
    moved = [_placed(b, size, (di, dj)) for di in (-1, 0, 1) for dj in (-1, 0, 1)]
    return max(float((fixed & m).sum() / (fixed | m).sum()) for m in moved)


def _placed(mask: Mask, size: Sequence[int], move: tuple[int, int]) -> Mask:
    out = np.zeros(size, dtype=np.bool_)
    at = [(n - m) // 2 + d for n, m, d in zip(size, mask.shape, move, strict=True)]
    out[at[0] : at[0] + mask.shape[0], at[1] : at[1] + mask.shape[1]] = mask
    return out


def cost(side: int, rounds: int = 5) -> None:
    """Processor time of scores in the own frame over that of plain ones, in turn: a call for each mask, one for all."""
    masks = [outlines.shrunk(mask, side) for mask in outlines.silhouettes()]
    if not masks:
        return
    tensors = [torch.from_numpy(np.ascontiguousarray(mask)) for mask in masks]
    plain, own = Measure(), Measure(orientation="own")

    def one_by_one(measure: Measure) -> None:
        for mask in tensors:
            torchlinf.complexity(mask, spatial_ndim=2, **measure.options(MeanOptions))

    def at_once(measure: Measure) -> None:
        ragged_profile(masks.__getitem__, len(masks), measure)

    for name, score in (("a call for each", one_by_one), ("one call", at_once)):
        ratios, most = [], 0.0
        score(own)
        for _ in range(rounds):
            spent = []
            for measure in (plain, own):
                start = time.process_time()
                score(measure)
                spent.append(time.process_time() - start)
            ratios.append(spent[1] / spent[0])
            most = max(most, (spent[1] - spent[0]) / len(masks) * 1e3)
        print(f"Own frame over plain score, {len(masks)} silhouettes of {side} pixels, {name}: median ")
        print(f"{np.median(ratios):.2f} (least {min(ratios):.2f}, most {max(ratios):.2f}); ")
        print(f"at most {most:.2f} ms a mask more")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.orientation", description=__doc__)
    parser.add_argument("--half", choices=("choose", "report"), default="report", help="which half of the data")
    parser.add_argument("--buildings", type=int, default=300, help="outlines of Boulder")
    parser.add_argument("--shapes", type=int, default=100, help="rectangles, L shapes and discs each")
    parser.add_argument("--side", type=int, default=128, help="longer side of the silhouettes")
    options = parser.parse_args()
    torch.set_num_threads(1)
    report = options.half == "report"
    cost(options.side)
    buildings(options.buildings, report)
    plain_shapes(options.shapes, report)
    bubenec()
    detail(options.side, report)


if __name__ == "__main__":
    main()
