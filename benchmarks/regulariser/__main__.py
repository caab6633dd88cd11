"""Compare the designs: `python -m benchmarks.regulariser [--shapes 200] [--only NAME ...]`; prints Markdown tables."""

import argparse

import torch

from benchmarks.regulariser.designs import DESIGNS, Design
from benchmarks.regulariser.families import families, other_families, random_shapes
from benchmarks.regulariser.measures import Descent, descent, rank_correlation, sign_agreement

WEIGHTS = (0.05, 0.5, 5.0)
SQUARES = ((25, 0), (60, 0), (60, 1))  # additions, seed


def main() -> None:
    """Print one row of each table per design."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.regulariser", description=__doc__)
    parser.add_argument("--shapes", type=int, default=200, help="random shapes for the rank correlation")
    parser.add_argument("--steps", type=int, default=40, help="steps of each descent")
    parser.add_argument("--only", nargs="*", choices=DESIGNS, default=list(DESIGNS), help="designs")
    options = parser.parse_args()
    torch.set_num_threads(1)
    shapes = random_shapes(options.shapes)
    for name in options.only:
        design = DESIGNS[name]
        for kind in (families, other_families):
            agreement = sign_agreement(design, kind())
            right, number = (sum(column) for column in zip(*agreement.values(), strict=True))
            parts = ", ".join(f"{family} {good}/{of}" for family, (good, of) in agreement.items())
            print(f"| {name} | {right} of {number}, {right / number:.0%} | {parts} |", flush=True)
        print(f"| {name} | rank correlation {rank_correlation(design, shapes):.3f} |", flush=True)
        for additions, seed in SQUARES:
            weight, best = _best(design, additions, seed, options.steps)
            print(
                f"| {name} | {additions} additions, seed {seed} | weight {weight} | "
                f"complexity {best.complexity[0]:.3f} -> {best.complexity[1]:.3f} | "
                f"IoU {best.iou[0]:.3f} -> {best.iou[1]:.3f} | {best.seconds / options.steps:.3f} s a step |",
                flush=True,
            )


def _best(design: Design, additions: int, seed: int, steps: int) -> tuple[float, Descent]:
    """The weight with the lowest hard complexity among those that do not lower the IoU, else the highest IoU."""
    runs = [(weight, descent(design, weight, additions, seed, steps)) for weight in WEIGHTS]
    kept = [run for run in runs if run[1].iou[1] >= run[1].iou[0]]
    if kept:
        return min(kept, key=lambda run: run[1].complexity[1])
    return max(runs, key=lambda run: run[1].iou[1])


if __name__ == "__main__":
    main()
