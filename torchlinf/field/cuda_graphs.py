"""Many steps of a method at a time: one by one, or on CUDA as a captured graph that the host launches once."""

from collections.abc import Callable
from typing import Protocol

import torch
from torch import Tensor

GRAPH_SWEEPS = 16  # sweeps in a graph; after these a method's buffers are back in their places


class Stepping(Protocol):
    """What takes steps in place, on buffers that are back in their places after `GRAPH_SWEEPS` sweeps."""

    line: Tensor
    step_sweeps: int

    def step(self) -> None:
        """Go on by `step_sweeps` sweeps."""


class Replay:
    """Takes the steps of one method until its buffers change, as they do when shapes leave the batch."""

    def __init__(self, method: Stepping) -> None:
        self._method = method
        self._graph: Callable[[], None] | None = None

    def run(self, sweeps: int) -> int:
        """Take as many whole steps as fit into `sweeps`; the number of sweeps taken."""
        per_step = self._method.step_sweeps
        left = sweeps
        while uses_graphs(self._method.line) and left >= GRAPH_SWEEPS:
            left -= self._replay_graph()
        for _ in range(left // per_step):
            self._method.step()
        return sweeps - left % per_step

    def _replay_graph(self) -> int:
        if self._graph is None:
            self._graph = captured(self._steps)  # which also takes them once
        else:
            self._graph()
        return GRAPH_SWEEPS

    def _steps(self) -> None:
        for _ in range(GRAPH_SWEEPS // self._method.step_sweeps):
            self._method.step()


def uses_graphs(line: Tensor) -> bool:
    """Whether the device of a method's buffers captures graphs."""
    return line.is_cuda


def captured(steps: Callable[[], None]) -> Callable[[], None]:
    """Run `steps` once, on a stream of its own as capturing asks for, then capture it; the function that replays it."""
    stream = torch.cuda.Stream()
    stream.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(stream):
        steps()
    torch.cuda.current_stream().wait_stream(stream)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        steps()
    return graph.replay
