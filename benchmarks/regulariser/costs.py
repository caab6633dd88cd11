"""What gradients and `simplify` cost: `python -m benchmarks.regulariser.costs [--rounds 7]`; prints Markdown tables."""

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import torch
from torch import Tensor

import torchlinf
from benchmarks.probes import peak_of
from benchmarks.regulariser.families import random_shapes
from torchlinf.losses import ShapeComplexityLoss
from torchlinf.losses.region_flips import candidates, select
from torchlinf.measure import Measure, SolvedShape

Function = Callable[[Tensor], Tensor]


def batch(side: int, count: int = 16) -> Tensor:
    """(count, 1, side, side) bool: the random shapes, enlarged by a whole factor."""
    shapes, factor = random_shapes(count), side // random_shapes(1).shape[-1]
    return shapes.repeat_interleave(factor, 1).repeat_interleave(factor, 2)[:, None]


def grey(masks: Tensor) -> Tensor:
    """The masks with an edge that is grey for some five pixels."""
    return torch.nn.functional.avg_pool2d(masks.double(), 5, 1, 2)


def ratio(function: Function, leaf: Tensor, rounds: int) -> tuple[float, float, float]:
    """Medians of processor seconds forward and backward, and of their quotient; the first round does not count."""
    found = []
    slope = None
    for _ in range(rounds + 1):
        leaf = leaf.detach().requires_grad_()
        began = time.process_time()
        value = function(leaf)
        between = time.process_time()
        if slope is None:
            slope = torch.randn(value.shape, generator=torch.Generator().manual_seed(0), dtype=value.dtype)
            continue
        value.backward(slope)
        found.append((between - began, time.process_time() - between))
    forward, backward = (statistics.median(column) for column in zip(*found, strict=True))
    return forward, backward, statistics.median(b / f for f, b in found)


def fields(side: int) -> Iterator[tuple[str, Function, Tensor]]:
    """Fields, and what they are differentiated by."""
    masks = batch(side)
    radius = torchlinf.chessboard_distance(masks).flatten(1).amax(dim=1).double()[:, None]
    yield "`linf_field`, by rho", lambda rho: torchlinf.linf_field(masks, rho=rho), radius
    soft: Function = lambda p: torchlinf.soft_linf_field(p, slices=1)  # noqa: E731
    yield "`soft_linf_field`, by a binary probability", soft, masks.double()
    yield "`soft_linf_field`, by a blurred one", soft, grey(masks)
    yield "the same, 4 slices", torchlinf.soft_linf_field, grey(masks)


def peak(name: str, side: int = 256) -> float:
    """Most memory during forward and backward beyond what was there, in float32 copies of 16 x 1 x side x side."""
    torch.set_num_threads(1)
    for size in (64, side):  # the first only loads what is loaded once
        leaf = grey(batch(size)).float().requires_grad_()
        most, _ = peak_of(lambda: MEMORY[name](leaf).sum().backward())  # noqa: B023
    return most / (leaf.numel() * 4)


def field_by_rho(probability: Tensor) -> Tensor:
    """`linf_field` of the masks above 1/2, differentiable by rho; the probability adds nothing but its size."""
    rho = torch.full((len(probability), 1), 20.0, dtype=torch.float64, requires_grad=True)
    return torchlinf.linf_field(probability > 0.5, rho=rho)


MEMORY: dict[str, Function] = {
    "`linf_field`, by rho": field_by_rho,
    "`soft_linf_field`, 1 slice": lambda p: torchlinf.soft_linf_field(p, slices=1),
    "`soft_complexity`": torchlinf.soft_complexity,
    "`soft_complexity`, 4 slices": lambda p: torchlinf.soft_complexity(p, slices=4),
    "`ShapeComplexityLoss`": ShapeComplexityLoss(),
}


def step(max_flips: int, rounds: int) -> tuple[float, float]:
    """One loss and its gradient, 16 x 1 x 128 x 128: median processor seconds, and least seconds on the clock.

    The least, since what else runs on the machine can only add to the clock.
    """
    regulariser = ShapeComplexityLoss(activation="sigmoid", max_flips=max_flips)
    found = []
    for _ in range(rounds + 1):
        logits = (8 * grey(batch(128)) - 4).float().requires_grad_()
        began = time.process_time(), time.perf_counter()
        regulariser(logits).backward()
        found.append((time.process_time() - began[0], time.perf_counter() - began[1]))
    processor, clock = zip(*found[1:], strict=True)
    return statistics.median(processor), min(clock)


def doubtful(count: int = 4, side: int = 128) -> Tensor:
    """(count, side, side) probabilities: smooth random blobs, in doubt along their edges."""
    noise = torch.randn(count, 1, side, side, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    for _ in range(6):
        noise = torch.nn.functional.avg_pool2d(noise, 5, 1, 2)
    return torch.sigmoid(4 * noise / noise.std())[:, 0]


def simplified(tries: int) -> tuple[float, float]:
    """`simplify` to its end: processor seconds a shape, and the mean of what it lowers, complexity and price."""
    probability, weight = doubtful(), 10.0
    began = time.process_time()
    found = torchlinf.simplify(probability, weight=weight, tries=tries, per="mask", keep_topology=False, spatial_ndim=2)
    seconds = (time.process_time() - began) / len(probability)
    area = (probability > 0.5).flatten(1).sum(dim=1)
    return seconds, float((found.after + weight * found.cost / area).mean())


def flip_against_solve(rounds: int) -> Iterator[float]:
    """Processor time of a flip in parts of that of a complete solve, for the flips of the loss."""
    inside = doubtful() > 0.5
    proposed = candidates(inside.double(), 0.5, 16)
    for mask, regions in zip(inside.numpy(), select(inside, proposed, 16), strict=True):
        shape, solves = SolvedShape(mask, Measure()), []
        for _ in range(rounds):
            began = time.process_time()
            SolvedShape(mask, Measure())
            solves.append(time.process_time() - began)
        for region in regions:
            began = time.process_time()
            shape.after(region)
            yield (time.process_time() - began) / statistics.median(solves)


def main() -> None:
    """Memory in processes of their own: freed memory that is used again does not show."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.regulariser.costs", description=__doc__)
    parser.add_argument("--rounds", type=int, default=7, help="rounds of each measurement")
    rounds = parser.parse_args().rounds
    print("| forward and backward of 16 x 1 x 256 x 256 | peak memory, float32 copies |\n|---|---|")
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as pool:
        for name, copies in zip(MEMORY, pool.map(peak, MEMORY), strict=True):
            print(f"| {name} | {copies:.0f} |", flush=True)
    print("\n| step on 16 x 1 x 128 x 128 | threads | processor s | least clock s |\n|---|---|---|---|")
    for threads in (torch.get_num_threads(), 1):
        torch.set_num_threads(threads)
        for flips in (16, 8):
            processor, clock = step(flips, rounds)
            print(f"| {flips} region flips | {threads} | {processor:.2f} | {clock:.2f} |", flush=True)
    print("\n| 16 fields, one thread | side | forward s | backward s | backward / forward |\n|---|---|---|---|---|")
    for side in (64, 128, 256):
        for name, function, leaf in fields(side):
            forward, backward, quotient = ratio(function, leaf, rounds)
            print(f"| {name} | {side} | {forward:.3f} | {backward:.3f} | {quotient:.2f} |", flush=True)
    print("\n| `simplify`, 128 x 128, one thread | processor ms a shape | complexity and price |\n|---|---|---|")
    simplified(1)  # loads the kernels
    for tries in (4, 8, 16, 32):
        seconds, objective = simplified(tries)
        print(f"| tries={tries} | {1000 * seconds:.0f} | {objective:.3f} |", flush=True)
    print(f"\nA flip takes {statistics.median(flip_against_solve(rounds)):.2f} times a complete solve (median).")


if __name__ == "__main__":
    main()
