"""Partial orders of shapes against definitions that try everything."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations, permutations

import networkx as nx
import numpy as np
import pytest
import torch
from problems import random_order
from scipy import stats

from torchlinf import ComplexityProfile, Measure, complexity_profile, shapes
from torchlinf.order import (
    WINDOWS,
    chains,
    dominance,
    hasse_diagram,
    incomparable_pairs,
    kendall_tau,
    largest_antichain,
    longest_chain,
)
from torchlinf.order.indicators import means_over, ranks, values_at_all_scales


def profile(mask: torch.Tensor) -> ComplexityProfile:
    return complexity_profile(mask, spatial_ndim=2)


@pytest.fixture(scope="module")
def profiles() -> dict[str, ComplexityProfile]:
    """Shapes that share values, and shapes that contradict each other between scales."""
    faces = [shapes.Appendage(face, 8, 8) for face in ("right", "top", "left")]
    masks = {
        "square": shapes.square(32),
        "box": shapes.box(20, 50),
        "disc": shapes.disc(20),
        "small disc": shapes.disc(9),
        "turned disc": shapes.disc(20).flip(0),
        "one": shapes.with_appendages((32, 32), faces[:1]),
        "two": shapes.with_appendages((32, 32), faces[:2]),
        "three": shapes.with_appendages((32, 32), faces),
    }
    return {name: profile(mask) for name, mask in masks.items()}


@pytest.mark.parametrize("windows", [WINDOWS, {"low": (0.0, 0.5)}, None])
@pytest.mark.parametrize("every_scale", [False, True])
def test_dominance_is_the_definition(
    profiles: dict[str, ComplexityProfile], windows: dict[str, tuple[float, float]] | None, every_scale: bool
) -> None:
    """Pair by pair, with values that differ by less than 1e-7 taken as equal: nothing here differs by so little."""
    scales = torch.arange(1, 4001, dtype=torch.float64) / 4000

    def indicators(name: str) -> np.ndarray:
        found = profiles[name]
        if not every_scale:
            pairs = [(0.0, 1.0)] if windows is None else windows.values()
            return np.array([float(found.mean(low, high)) for low, high in pairs])
        levels = found.level_values.numpy()
        return levels[np.ceil(scales.numpy() * len(levels) - 1e-9).astype(int) - 1]

    graph = dominance(profiles, windows=windows, every_scale=every_scale)
    node = {name: names for names in graph for name in names}
    assert sorted(node) == sorted(profiles)
    for a, b in permutations(profiles, 2):
        apart = indicators(a) - indicators(b)
        same = bool((np.abs(apart) < 1e-7).all())
        assert (node[a] == node[b]) == same
        assert graph.has_edge(node[a], node[b]) == (not same and bool((apart < 1e-7).all()))


def test_windows_and_all_scales_differ_and_shapes_contradict(profiles: dict[str, ComplexityProfile]) -> None:
    graph = dominance(profiles)
    assert ("square", "box") in graph
    assert ("disc", "turned disc") in graph
    assert longest_chain(graph)[0] == ("square", "box")
    assert incomparable_pairs(dominance(profiles, every_scale=True))
    line = dominance(profiles, windows=None)  # one number orders all
    assert not incomparable_pairs(line)


@pytest.mark.parametrize("seed", range(12))
def test_chains_and_antichains_are_largest_and_fewest(seed: int) -> None:
    graph = random_order(seed)

    def is_antichain(nodes: tuple[int, ...]) -> bool:
        return not any(graph.has_edge(a, b) or graph.has_edge(b, a) for a, b in combinations(nodes, 2))

    def is_chain(nodes: Sequence[int]) -> bool:
        return all(graph.has_edge(a, b) for a, b in combinations(nodes, 2))

    subsets = [nodes for size in range(1, 8) for nodes in combinations(graph, size)]
    antichain = largest_antichain(graph)
    assert is_antichain(tuple(antichain))
    assert len(antichain) == max(len(nodes) for nodes in subsets if is_antichain(nodes))
    longest = longest_chain(graph)
    assert is_chain(longest)
    assert len(longest) == max(len(nodes) for nodes in subsets if any(map(is_chain, permutations(nodes))))
    found = chains(graph)
    assert sorted(node for chain in found for node in chain) == list(range(7))
    assert all(is_chain(chain) for chain in found)
    assert len(found) == len(antichain)
    assert set(incomparable_pairs(graph)) == {pair for pair in combinations(graph, 2) if is_antichain(pair)}


@pytest.mark.parametrize("seed", range(4))
def test_hasse_diagram_has_the_steps_and_nothing_that_follows(seed: int) -> None:
    graph = random_order(seed)
    steps = hasse_diagram(graph)
    assert set(nx.transitive_closure(steps).edges) == set(graph.edges)
    for a, b in steps.edges:
        assert not any(graph.has_edge(a, c) and graph.has_edge(c, b) for c in graph)


def test_steps_come_in_the_order_of_the_graph() -> None:
    """A random order of names, whose hashes change from run to run."""
    graph = nx.relabel_nodes(random_order(0, size=20), str)
    steps = hasse_diagram(graph)
    assert list(steps) == list(graph)
    kept = set(steps.edges)
    assert list(steps.edges) == [edge for edge in graph.edges if edge in kept]


def test_attributes_are_kept(profiles: dict[str, ComplexityProfile]) -> None:
    steps = hasse_diagram(dominance(profiles))
    assert steps.nodes["square", "box"]["indicators"] == (0.0, 0.0)
    assert steps.graph == {"windows": {"complexity_low": (0.0, 0.25), "complexity": (0.0, 1.0)}, "unit": "bits"}
    everywhere = dominance(profiles, windows=None, every_scale=True)
    assert everywhere.graph == {"windows": {"complexity": (0.0, 1.0)}, "unit": "bits"}
    assert everywhere.nodes[("three",)]["indicators"] == (float(profiles["three"].mean()),)


def test_an_order_of_nothing_and_of_one() -> None:
    assert len(dominance({})) == len(chains(dominance({}))) == len(longest_chain(dominance({}))) == 0
    alone = dominance({"disc": profile(shapes.disc(5))}, every_scale=True)
    assert list(alone) == longest_chain(alone) == largest_antichain(alone) == [("disc",)]


def with_values(*rows: list[float], error_bound: float = 0.0) -> list[ComplexityProfile]:
    """Profiles of one shape each that hold the numbers given."""
    scales = torch.arange(1, len(rows[0]) + 1, dtype=torch.float64) / len(rows[0])
    values = [torch.tensor(row, dtype=torch.float64) for row in rows]
    return [
        ComplexityProfile(
            scales=scales,
            values=row,
            radius=torch.tensor(len(row)),
            field_error_bound=torch.tensor(1e-9, dtype=torch.float64),
            level_values=row,
            level_error_bound=torch.full_like(row, error_bound),
            measure=Measure(),
            seconds=torch.zeros(()),
        )
        for row in values
    ]


@pytest.mark.parametrize("size", [2, 3, 6])
def test_tau_counts_pairs(size: int) -> None:
    """Against the definition pair by pair, on integers, among which equal ones are the rule."""
    drawn = np.random.default_rng(size).integers(0, 4, (size, 40)).astype(float)
    expected = []
    for column in drawn.T:
        votes = [1 if a <= b else -1 for a, b in combinations(column, 2)]
        expected.append(sum(votes) / len(votes))
    found = kendall_tau(with_values(*drawn.tolist()))
    assert found.tolist() == pytest.approx(expected, abs=1e-15)
    assert min(expected) < 0 < max(expected)


def test_without_equal_values_tau_is_that_of_scipy() -> None:
    drawn = np.random.default_rng(0).random((7, 30))
    expected = [stats.kendalltau(range(7), column).statistic for column in drawn.T]
    assert kendall_tau(with_values(*drawn.tolist())).tolist() == pytest.approx(expected, abs=1e-12)
    # Equal values: agreement here, left out there, and without a value where all are equal.
    assert kendall_tau(with_values([1.0, 1.0], [1.0, 1.0], [1.0, 2.0])).tolist() == [1.0, 1.0]
    assert np.isnan(stats.kendalltau(range(3), [1.0, 1.0, 1.0]).statistic)
    assert stats.kendalltau(range(3), [1.0, 1.0, 2.0]).statistic == pytest.approx(2 / np.sqrt(6))


def test_tau_takes_values_whose_intervals_meet_as_equal() -> None:
    first, later = [1.0, 1.0], [1.0 - 1.5e-6, 1.0 - 2.5e-6]
    assert kendall_tau(with_values(first, later, error_bound=1e-6)).tolist() == [1.0, -1.0]
    assert kendall_tau(with_values(later, first, error_bound=1e-6)).tolist() == [1.0, 1.0]


def test_tau_has_the_bound_of_the_level_that_a_scale_belongs_to() -> None:
    later, first = with_values([1.0, 1.0, 1.0], [2.0, 2.0, 2.0])
    unsure = replace(later, level_error_bound=torch.tensor([0.0, 1.5, 0.0], dtype=torch.float64))
    assert kendall_tau([first, unsure]).tolist() == [-1.0, 1.0, -1.0]


@pytest.mark.parametrize("every_scale", [False, True])
def test_an_order_is_proven(every_scale: bool) -> None:
    """Of shapes that are solved roughly, what counts as less is less in the exact fields too."""
    masks = [shapes.superellipse(size, power) for size in (9, 12, 16) for power in (1.0, 2.0, 5.0)]
    indicators = values_at_all_scales if every_scale else partial(means_over, windows=WINDOWS)
    exact = indicators([profile(mask) for mask in masks])[0]
    told_apart = []
    for tol in (0.3, 0.1, 1e-2, 1e-4, 1e-9):
        rough = [
            complexity_profile(mask, tol=tol, tol_bits=math.inf, method="accelerated", spatial_ndim=2) for mask in masks
        ]
        rank = ranks(*indicators(rough))
        less = rank[:, None] < rank[None, :]
        assert (exact[:, None] < exact[None, :])[less].all()
        told_apart.append(int(less.sum()))
    assert told_apart == sorted(told_apart)
    assert told_apart[3] > 0
    assert told_apart[-1] == (exact[:, None] < exact[None, :] - 1e-9).sum()


def test_tau_of_shapes(profiles: dict[str, ComplexityProfile]) -> None:
    """Squares and mirror images are equal, more appendages are more complex up to their width, and nothing above."""
    up_to_a_quarter = torch.arange(1, 101) <= 25
    grown = [profiles[name] for name in ("square", "box", "one", "two", "three")]
    assert bool((kendall_tau(grown) == 1).all())
    assert bool((kendall_tau(grown[1:][::-1])[up_to_a_quarter] == -1).all())
    assert bool((kendall_tau(grown[::-1])[~up_to_a_quarter] == 1).all())
    assert bool((kendall_tau([profiles["turned disc"], profiles["disc"]]) == 1).all())


def test_bad_input_says_what_to_do(profiles: dict[str, ComplexityProfile]) -> None:
    with pytest.raises(TypeError, match="must map names to profiles; got Tensor"):
        dominance(torch.ones(1, 1, 3, 4))
    with pytest.raises(TypeError, match="must hold a ComplexityProfile for each shape; got float"):
        dominance({"square": 1.0})  # type: ignore[dict-item]
    with pytest.raises(ValueError, match="must be of one shape each; got 2"):
        dominance({"both": profile(torch.ones(2, 5, 5))})
    with pytest.raises(ValueError, match=r"got an empty one for 'none'\. Leave it out"):
        dominance({"none": profile(torch.zeros(4, 4))})
    with pytest.raises(ValueError, match="windows must name at least one window; got none"):
        dominance(profiles, windows={})
    with pytest.raises(TypeError, match="windows must map names to pairs"):
        dominance(profiles, windows=((0.0, 0.25),))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="low"):
        dominance(profiles, windows={"wrong": (0.5, 0.25)})
    other = {"disc": profiles["disc"], "other": complexity_profile(shapes.disc(5), spatial_ndim=2, bins=64)}
    with pytest.raises(ValueError, match="got estimator='entropy', bins=64, levels='distance' for 'other'"):
        dominance(other)
    with pytest.raises(ValueError, match="got estimator='entropy', bins=64, levels='distance' for 1"):
        kendall_tau(list(other.values()))
    rims = {"disc": profiles["disc"], "other": complexity_profile(shapes.disc(5), spatial_ndim=2, levels="rim")}
    with pytest.raises(
        ValueError, match="in the same frames; got estimator='entropy', bins=1024, levels='rim' for 'other'"
    ):
        dominance(rims)
    with pytest.raises(TypeError, match="must be a sequence in the expected order; got dict"):
        kendall_tau(other)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="empty one for 1"):
        kendall_tau([profiles["disc"], profile(torch.zeros(4, 4))])
    cycle = nx.DiGraph([("a", "b"), ("b", "a")])
    for function in (hasse_diagram, longest_chain, chains, largest_antichain, incomparable_pairs):
        with pytest.raises(TypeError, match=r"graph must be a networkx\.DiGraph; got dict"):
            function(profiles)  # type: ignore[arg-type]
        with pytest.raises(ValueError, match="got a graph with a cycle"):
            function(cycle)
    with pytest.raises(TypeError, match="for each shape; got Tensor for 1"):
        kendall_tau([profiles["disc"], torch.ones(2)])  # type: ignore[list-item]
    with pytest.raises(ValueError, match="two or more; got 1"):
        kendall_tau([profiles["disc"]])
    with pytest.raises(ValueError, match="on the same scales"):
        kendall_tau([profiles["disc"], complexity_profile(torch.ones(5, 5), scales=[0.5], spatial_ndim=2)])


def test_profiles_in_a_short_dtype_are_ordered_by_all_their_digits() -> None:
    masks = {f"disc {r}": shapes.disc(r) for r in (4, 6, 8, 16)} | {"square": shapes.square(9)}
    found = []
    for dtype in (torch.float64, torch.float32, torch.bfloat16, torch.float16):
        profiles = {name: complexity_profile(m, dtype=dtype, spatial_ndim=2) for name, m in masks.items()}
        found.append(set(dominance(profiles, windows=None).nodes))
    assert len(found[0]) == 5
    assert all(nodes == found[0] for nodes in found)
