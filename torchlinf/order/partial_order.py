"""Orders of shapes: partial ones, in which a simpler shape is so in every respect, and agreement with a given one.

One number orders all shapes in a line; several do not. A shape is simpler than another if no indicator says the
contrary and one says so. Indicators are means of the complexity over windows of scales, or its values at all scales.
The orders are networkx graphs, so that all of networkx works on them.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, TypeAlias, cast

import torch
from torch import Tensor

from torchlinf.measure import ComplexityProfile
from torchlinf.order.indicators import means_over, ranks, require_one_shape, slack_of, values_at_all_scales

if TYPE_CHECKING:
    from networkx import DiGraph

# Shapes that are equal in every indicator, by name.
Node: TypeAlias = tuple[str, ...]

# The paper's pair: detail near the boundary, and all of the shape.
WINDOWS = ((0.0, 0.25), (0.0, 1.0))


def dominance(
    profiles: Mapping[str, ComplexityProfile], *, windows: Sequence[tuple[float, float]] | None = WINDOWS
) -> "DiGraph":
    """Order shapes by several indicators of their complexity at once.

    Two values count as equal if their intervals overlap, each value give or take twice the certified relative error of
    its field; so do values that overlaps connect, for equality has to be transitive. For the entropy, whose values
    jump when a pixel passes the edge of a bin, that is what the edges are made for (`torchlinf.entropy`).

    Args:
        profiles: the shapes by name, each a profile of one shape that is not empty, all of one estimator.
        windows: windows of scales (low, high] with 0 <= low < high <= 1; each mean is an indicator. None compares at
            all scales: the value of a shape's level at every t in (0, 1] is an indicator, exactly, not on a grid.

    Returns:
        A networkx.DiGraph. Its nodes are tuples of names, several where shapes are equal in every indicator. It has an
        edge from each node to all that are more complex, and is transitively closed. Node attribute `indicators`: the
        means over the windows (over all scales for None) of the first shape of the node, in bits for the entropy.
        Attribute `windows` of the graph: those windows.

    Raises:
        TypeError: a value is no `ComplexityProfile`.
        ValueError: a profile holds several shapes or an empty one, there are no windows, or one is no window.

    Example:
        >>> from torchlinf import complexity_profile, shapes
        >>> masks = {"square": shapes.square(16), "box": shapes.box(9, 20), "disc": shapes.disc(8)}
        >>> graph = dominance({name: complexity_profile(mask, spatial_ndim=2) for name, mask in masks.items()})
        >>> list(graph.edges)
        [(('square', 'box'), ('disc',))]
    """
    import networkx as nx

    if not isinstance(profiles, Mapping):
        got = type(profiles).__name__
        raise TypeError(f"profiles must map names to profiles; got {got}. Pass {{'a': complexity_profile(mask), ...}}.")
    for name, profile in profiles.items():
        require_one_shape(name, profile)
    solved = list(profiles.values())
    averaged = ((0.0, 1.0),) if windows is None else tuple(windows)
    means = means_over(solved, averaged)
    rank = ranks(values_at_all_scales(solved) if windows is None else means, slack_of(solved))  # (shapes, indicators)
    members: dict[tuple[int, ...], list[int]] = {}
    for i, row in enumerate(rank.tolist()):
        members.setdefault(tuple(row), []).append(i)
    names, first = list(profiles), [same[0] for same in members.values()]
    nodes = [tuple(names[i] for i in same) for same in members.values()]
    graph = nx.DiGraph(windows=averaged)
    for node, i in zip(nodes, first, strict=True):
        graph.add_node(node, indicators=tuple(means[i].tolist()))
    for node, i in zip(nodes, first, strict=True):
        above = (rank[i] <= rank[first]).all(axis=1)
        graph.add_edges_from((node, other) for other, is_above in zip(nodes, above, strict=True) if is_above)
    graph.remove_edges_from([(node, node) for node in nodes])
    return graph


def hasse_diagram(graph: "DiGraph") -> "DiGraph":
    """The steps of an order: its edges without those that follow from others.

    Args:
        graph: an order, as `dominance` returns it; any acyclic graph will do.

    Returns:
        A networkx.DiGraph of the same nodes and attributes, the transitive reduction.

    Raises:
        networkx.NetworkXError: the graph has a cycle.

    Example:
        >>> import networkx as nx
        >>> list(hasse_diagram(nx.DiGraph([("a", "b"), ("b", "c"), ("a", "c")])).edges)
        [('a', 'b'), ('b', 'c')]
    """
    import networkx as nx

    kept = nx.transitive_reduction(graph)
    reduced = nx.DiGraph(**graph.graph)
    reduced.add_nodes_from(graph.nodes(data=True))
    # Its edges come out of sets, whose order changes from run to run; those of the graph do not.
    reduced.add_edges_from(edge for edge in graph.edges if kept.has_edge(*edge))
    return reduced


def longest_chain(graph: "DiGraph") -> list[Node]:
    """The most nodes of which each is simpler than the next.

    Args:
        graph: an order, as `dominance` returns it.

    Returns:
        The nodes from the simplest on; the first such chain where there are several.

    Example:
        >>> import networkx as nx
        >>> longest_chain(nx.DiGraph([("a", "b"), ("b", "c"), ("a", "c"), ("a", "d")]))
        ['a', 'b', 'c']
    """
    import networkx as nx

    return cast("list[Node]", nx.dag_longest_path(graph))


def chains(graph: "DiGraph") -> list[list[Node]]:
    """The fewest chains that hold every node once; as many as the largest antichain has nodes (Dilworth).

    Args:
        graph: an order, as `dominance` returns it.

    Returns:
        Chains from the simplest on, in the order of their first nodes in the graph.

    Example:
        >>> import networkx as nx
        >>> chains(nx.DiGraph([("a", "b"), ("b", "c"), ("a", "c"), ("a", "d")]))
        [['a', 'b', 'c'], ['d']]
    """
    nodes = list(graph)
    after, _ = _matched(graph)
    found = []
    for start in sorted(set(range(len(nodes))) - set(after.values())):
        chain = [start]
        while chain[-1] in after:
            chain.append(after[chain[-1]])
        found.append([nodes[i] for i in chain])
    return found


def largest_antichain(graph: "DiGraph") -> list[Node]:
    """The most nodes of which no two can be compared.

    Args:
        graph: an order, as `dominance` returns it.

    Returns:
        The nodes in the order of the graph; one such antichain where there are several.

    Example:
        >>> import networkx as nx
        >>> largest_antichain(nx.DiGraph([("a", "b"), ("a", "c")]))
        ['b', 'c']
    """
    _, cover = _matched(graph)
    # König: what no edge of the smallest cover touches on either side is independent, and as large as can be.
    return [node for i, node in enumerate(graph) if i not in cover and i + len(graph) not in cover]


def incomparable_pairs(graph: "DiGraph") -> list[tuple[Node, Node]]:
    """Pairs of nodes of which neither is simpler: one indicator says so of the one, another of the other.

    Args:
        graph: an order, as `dominance` returns it.

    Returns:
        Every pair once, in the order of the graph.

    Example:
        >>> import networkx as nx
        >>> incomparable_pairs(nx.DiGraph([("a", "b"), ("a", "c")]))
        [('b', 'c')]
    """
    return [(a, b) for a, b in combinations(graph, 2) if not graph.has_edge(a, b) and not graph.has_edge(b, a)]


def kendall_tau(profiles: Sequence[ComplexityProfile]) -> Tensor:
    """Agreement of a given order of shapes with that of their complexity, at each scale.

    Of all pairs, the share in which the later shape is not the simpler one less the share in which it is: Kendall's
    tau, except that two equal values count as agreement. Equal are values whose intervals overlap, each value give or
    take twice the certified relative error of its field.

    Args:
        profiles: two or more, in the order in which the complexity is expected to grow, each of one shape that is not
            empty, all of one estimator and on the same scales.

    Returns:
        (L,) float64 in [-1, 1], one for each of the profiles' scales; 1 if no pair contradicts the order.

    Raises:
        TypeError: an entry is no `ComplexityProfile`.
        ValueError: fewer than two profiles, one of several shapes or of an empty one, or scales that differ.

    Source: the modified Kendall tau of Arslan and Tari (2020).

    Example:
        >>> from torchlinf import complexity_profile, shapes
        >>> masks = shapes.square(20), shapes.disc(20), shapes.disc(10)
        >>> kendall_tau([complexity_profile(mask, scales=[0.5, 1.0], spatial_ndim=2) for mask in masks])
        tensor([0.3333, 1.0000], dtype=torch.float64)
    """
    for i, profile in enumerate(profiles):
        require_one_shape(i, profile)
    if len(profiles) < 2:
        raise ValueError(f"profiles must be two or more; got {len(profiles)}. An order is one of pairs.")
    if any(profile.scales.tolist() != profiles[0].scales.tolist() for profile in profiles):
        raise ValueError("profiles must be on the same scales; got several grids. Pass the same scales= for each.")
    values = torch.stack([profile.values.flatten().cpu() for profile in profiles]).double()  # (N, L)
    slack = torch.from_numpy(slack_of(profiles))[:, None]
    first, later = torch.triu_indices(len(values), len(values), offset=1)
    simpler = values[later] + slack[later] < values[first] - slack[first]  # (pairs, L)
    return 1 - 2 * simpler.double().mean(dim=0)


def _matched(graph: "DiGraph") -> tuple[dict[int, int], set[int]]:
    """The most edges no two of which start, or end, at one node: {start: end} by number, and a smallest cover.

    Node i stands on the left as i, where edges start, and on the right as i + n, where they end.
    """
    import networkx as nx

    number = {node: i for i, node in enumerate(graph)}
    left, n = range(len(number)), len(number)
    pairs = nx.Graph()
    pairs.add_nodes_from(range(2 * n))
    pairs.add_edges_from((number[a], number[b] + n) for a, b in graph.edges)
    # Numbers, and not the names themselves, whose order in a set changes from run to run.
    matching = nx.bipartite.hopcroft_karp_matching(pairs, left)
    cover = nx.bipartite.to_vertex_cover(pairs, matching, left)
    return {i: matching[i] - n for i in left if i in matching}, cover
