"""The layout of Hasse diagrams against its definition, and against every order where there are few."""

from collections.abc import Iterator
from itertools import combinations, pairwise, permutations

import networkx as nx
import numpy as np
import pytest
from problems import random_order

from torchlinf.order import hasse_diagram
from torchlinf.plot.layered_layout import Bend, crossings, layers


@pytest.mark.parametrize("seed", range(6))
def test_ranks_are_longest_chains_and_edges_climb_rank_by_rank(seed: int) -> None:
    graph = hasse_diagram(random_order(seed, size=9))
    found = layers(graph, {}, 1.0)
    rank = {vertex: i for i, vertices in enumerate(found.ranks) for vertex in vertices}
    assert len(rank) == sum(map(len, found.ranks)) == len(found.x)
    for node in graph:
        chains = [len(path) - 1 for low in graph for path in nx.all_simple_paths(graph, low, node)]
        assert rank[node] == max(chains, default=0)
    paths = [[a, *(Bend((a, b), i) for i in range(rank[a] + 1, rank[b])), b] for a, b in graph.edges]
    expected = {frozenset(step) for path in paths for step in pairwise(path)}
    assert {frozenset(step) for step in found.steps.edges} == expected
    assert all(rank[vertex] == vertex.rank for vertex in rank if isinstance(vertex, Bend))


@pytest.mark.parametrize("seed", range(6))
def test_neighbours_keep_their_order_and_their_distance(seed: int) -> None:
    graph = hasse_diagram(random_order(seed, size=9))
    widths = {node: 1.0 + node % 3 for node in graph}
    found = layers(graph, widths, 0.25)
    for rank in found.ranks:
        for a, b in pairwise(rank):
            room = (widths.get(a, 0.0) + widths.get(b, 0.0)) / 2 + 0.25
            assert found.x[b] - found.x[a] >= room - 1e-9
    assert min(found.x[vertex] - widths.get(vertex, 0.0) / 2 for vertex in found.x) == pytest.approx(0.0)


@pytest.mark.parametrize("seed", range(6))
def test_crossings_are_pairs_of_lines_that_cross(seed: int) -> None:
    """Lines cross if the product of their distances at the two ends is negative."""
    generator = np.random.default_rng(seed)
    lower, upper = [[("low", i) for i in range(5)], [("high", i) for i in range(6)]]
    edges = [(a, b) for a in lower for b in upper if generator.random() < 0.4]
    expected = sum((a[1] - c[1]) * (b[1] - d[1]) < 0 for (a, b), (c, d) in combinations(edges, 2))
    graph = nx.Graph(edges)
    graph.add_nodes_from([*lower, *upper])
    assert crossings([lower, upper], graph) == expected > 0


def test_what_can_be_drawn_without_crossings_is() -> None:
    generator = np.random.default_rng(0)
    tree = nx.bfs_tree(nx.balanced_tree(2, 3), 0)
    pairs = nx.DiGraph((f"low {i}", f"high {j}") for i, j in enumerate(generator.permutation(8)))
    ladders = nx.DiGraph([(i, i + 1) for i in range(5)] + [(0, "side"), ("side", 5), (1, "other"), ("other", 4)])
    for graph in (tree, tree.reverse(), pairs, ladders):
        shuffled = nx.DiGraph()
        shuffled.add_nodes_from(generator.permutation(np.array([*graph], dtype=object)).tolist())
        shuffled.add_edges_from(graph.edges)
        found = layers(shuffled, {}, 1.0)
        assert crossings(found.ranks, found.steps) == 0


def test_few_lines_cross_in_general() -> None:
    """Compared with every order of every rank, over graphs small enough for that."""

    def product(ranks: list[list[object]]) -> Iterator[list[list[object]]]:
        if not ranks:
            yield []
            return
        for rest in product(ranks[1:]):
            for first in permutations(ranks[0]):
                yield [list(first), *rest]

    surplus = []
    for seed in range(40):
        found = layers(hasse_diagram(random_order(seed, size=6)), {}, 1.0)
        if np.prod([len(list(permutations(rank))) for rank in found.ranks]) < 3000:
            least = min(crossings(ranks, found.steps) for ranks in product(found.ranks))
            surplus.append(crossings(found.ranks, found.steps) - least)
    assert len(surplus) > 20
    assert sum(surplus) == 0


def test_networkx_layout_has_more_than_three_times_the_crossings() -> None:
    """Why there is a layout of our own: networkx does not arrange the nodes within a rank."""
    ours, theirs = 0, 0
    for seed in range(10):
        found = layers(hasse_diagram(random_order(seed, size=12)), {}, 1.0)
        steps = found.steps.copy()
        for i, rank in enumerate(found.ranks):
            for vertex in rank:
                steps.nodes[vertex]["subset"] = i
        x = {vertex: place[0] for vertex, place in nx.multipartite_layout(steps, align="horizontal").items()}
        ours += crossings(found.ranks, found.steps)
        theirs += crossings([sorted(rank, key=x.__getitem__) for rank in found.ranks], found.steps)
    assert theirs > 3 * ours > 0


@pytest.mark.parametrize("seed", range(3))
def test_no_swap_of_neighbours_saves_a_crossing(seed: int) -> None:
    found = layers(hasse_diagram(random_order(seed, size=16)), {}, 1.0)
    least = crossings(found.ranks, found.steps)
    assert least > 0
    for i, rank in enumerate(found.ranks):
        for j in range(len(rank) - 1):
            swapped = [*rank[:j], rank[j + 1], rank[j], *rank[j + 2 :]]
            assert crossings([*found.ranks[:i], swapped, *found.ranks[i + 1 :]], found.steps) >= least


def test_lines_run_straight_where_they_can_and_strangers_stand_by() -> None:
    graph = nx.DiGraph([("a", "b"), ("b", "c"), ("a", "d"), ("d", "c")])
    graph.add_node("alone")
    x = layers(graph, dict.fromkeys(graph, 1.0), 0.5).x
    assert x["a"] == pytest.approx(x["c"]) == pytest.approx((x["b"] + x["d"]) / 2)
    assert abs(x["alone"] - x["a"]) == pytest.approx(1.5)
