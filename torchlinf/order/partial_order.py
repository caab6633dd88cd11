"""Partial orders of shapes: a shape is simpler than another if it is so in every respect.

One number puts all shapes in a line; several numbers do not. A shape is simpler than another if none of the numbers is
larger and at least one is smaller. The numbers are means of the complexity over windows of scales, or its values at
every scale. The orders are networkx graphs, so that all of networkx works on them.
"""

from collections.abc import Mapping
from itertools import combinations
from typing import TYPE_CHECKING, TypeAlias, cast

from torchlinf.measure import ComplexityProfile, Measure
from torchlinf.order.indicators import means_over, ranks, require_comparable, values_at_all_scales

if TYPE_CHECKING:
    from networkx import DiGraph

# Shapes that are equal in every indicator, by name.
Node: TypeAlias = tuple[str, ...]

# The paper's pair of windows: near the boundary, and all of the shape.
WINDOWS = {"complexity_low": (0.0, 0.25), "complexity": (0.0, 1.0)}


def dominance(
    profiles: Mapping[str, ComplexityProfile],
    *,
    windows: Mapping[str, tuple[float, float]] | None = WINDOWS,
    every_scale: bool = False,
) -> "DiGraph":
    """Order shapes by several numbers of their complexity at once, the indicators.

    The profiles are computed already; nothing is solved here.

    Two values count as equal if their intervals meet: each value plus or minus its proven error bound (`error_bound` of
    the profile for a mean, `level_error_bound` at every scale) and the rounding of its sum. Values that a chain of such
    intervals connects count as equal too, since equality has to be transitive. So where one value counts as less than
    another, it is proven that this holds in the exact fields.

    Args:
        profiles: the shapes by name, each the profile of one shape that is not empty, all of one estimator, number
            of bins and kind of levels.
        windows: windows of scales, a mapping of names to (low, high) with 0 <= low < high <= 1; the mean over each
            window is an indicator. None means one window over all scales, named "complexity".
        every_scale: if True, the values at every scale t in (0, 1] are the indicators instead: all steps of all
            profiles are compared, not samples on a grid. `windows` then only says which means the nodes carry.

    Returns:
        A networkx.DiGraph, transitively closed. Its nodes are tuples of names, several where shapes are equal in every
        indicator. It has an edge from each node to every node that is more complex. Node attribute `indicators`: the
        means over the windows of the first shape of the node, in bits (share of the field's maximum for "std"), in the
        order of the windows. Graph attributes: `windows`, the mapping of names to (low, high), and `unit`, that of the
        means. No shapes give a graph without nodes.

    Raises:
        TypeError: `profiles` or `windows` is no mapping, or a value is no `ComplexityProfile`.
        ValueError: a profile holds several shapes or an empty one, profiles differ in estimator, bins or levels, there
            are no windows, or one is no window.

    Source: Arslan and Tari (2020) compare by the two windows of the default.

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
    require_comparable(profiles.items())
    named = Measure(windows=windows).named_windows()
    solved = list(profiles.values())
    means, bounds = means_over(solved, named)
    rank = ranks(*(values_at_all_scales(solved) if every_scale else (means, bounds)))  # (shapes, indicators)
    members: dict[tuple[int, ...], list[int]] = {}
    for i, row in enumerate(rank.tolist()):
        members.setdefault(tuple(row), []).append(i)
    names, first = list(profiles), [same[0] for same in members.values()]
    nodes = [tuple(names[i] for i in same) for same in members.values()]
    graph = nx.DiGraph(windows=named, unit=solved[0].measure.unit if solved else Measure().unit)
    for node, i in zip(nodes, first, strict=True):
        graph.add_node(node, indicators=tuple(means[i].tolist()))
    for node, i in zip(nodes, first, strict=True):
        above = (rank[i] <= rank[first]).all(axis=1)
        graph.add_edges_from((node, other) for other, is_above in zip(nodes, above, strict=True) if is_above)
    graph.remove_edges_from([(node, node) for node in nodes])
    return graph


def hasse_diagram(graph: "DiGraph") -> "DiGraph":
    """The steps of an order: its edges without those that follow from other edges.

    Args:
        graph: an order, as `dominance` returns it. Any networkx.DiGraph without a cycle will do.

    Returns:
        A networkx.DiGraph of the same nodes and attributes, the transitive reduction; its edges are in the order of
        those of the graph.

    Raises:
        TypeError: `graph` is no networkx.DiGraph.
        ValueError: it has a cycle.

    Example:
        >>> import networkx as nx
        >>> list(hasse_diagram(nx.DiGraph([("a", "b"), ("b", "c"), ("a", "c")])).edges)
        [('a', 'b'), ('b', 'c')]
    """
    import networkx as nx

    _require_order(graph)
    kept = nx.transitive_reduction(graph)
    reduced = nx.DiGraph(**graph.graph)
    reduced.add_nodes_from(graph.nodes(data=True))
    # Its edges come out of sets, whose order changes from run to run; those of the graph do not.
    reduced.add_edges_from(edge for edge in graph.edges if kept.has_edge(*edge))
    return reduced


def longest_chain(graph: "DiGraph") -> list[Node]:
    """The longest list of nodes of which each is simpler than the next.

    Args:
        graph: an order, as `dominance` returns it.

    Returns:
        The nodes from the simplest on; one such chain where there are several, and none for a graph without nodes.

    Raises:
        TypeError: `graph` is no networkx.DiGraph.
        ValueError: it has a cycle.

    Example:
        >>> import networkx as nx
        >>> longest_chain(nx.DiGraph([("a", "b"), ("b", "c"), ("a", "c"), ("a", "d")]))
        ['a', 'b', 'c']
    """
    import networkx as nx

    _require_order(graph)
    return cast("list[Node]", nx.dag_longest_path(graph))


def chains(graph: "DiGraph") -> list[list[Node]]:
    """The fewest chains that hold every node once.

    By Dilworth's theorem there are as many of them as the largest antichain has nodes.

    Args:
        graph: an order, as `dominance` returns it: transitively closed.

    Returns:
        Chains, each from the simplest node on, in the order of their first nodes in the graph.

    Raises:
        TypeError: `graph` is no networkx.DiGraph.
        ValueError: it has a cycle.

    Example:
        >>> import networkx as nx
        >>> chains(nx.DiGraph([("a", "b"), ("b", "c"), ("a", "c"), ("a", "d")]))
        [['a', 'b', 'c'], ['d']]
    """
    after, _ = _matched(graph)
    nodes = list(graph)
    cover = []
    for start in sorted(set(range(len(nodes))) - set(after.values())):
        chain = [start]
        while chain[-1] in after:
            chain.append(after[chain[-1]])
        cover.append([nodes[i] for i in chain])
    return cover


def largest_antichain(graph: "DiGraph") -> list[Node]:
    """The largest set of nodes of which no two can be compared.

    Args:
        graph: an order, as `dominance` returns it: transitively closed.

    Returns:
        The nodes in the order of the graph; one such antichain where there are several.

    Raises:
        TypeError: `graph` is no networkx.DiGraph.
        ValueError: it has a cycle.

    Example:
        >>> import networkx as nx
        >>> largest_antichain(nx.DiGraph([("a", "b"), ("a", "c")]))
        ['b', 'c']
    """
    _, cover = _matched(graph)
    # König: what no edge of the smallest cover touches on either side is independent, and as large as can be.
    return [node for i, node in enumerate(graph) if i not in cover and i + len(graph) not in cover]


def incomparable_pairs(graph: "DiGraph") -> list[tuple[Node, Node]]:
    """Pairs of nodes of which neither is simpler: one indicator is larger for the one, another for the other.

    Args:
        graph: an order, as `dominance` returns it: transitively closed.

    Returns:
        Every pair once, in the order of the graph.

    Raises:
        TypeError: `graph` is no networkx.DiGraph.
        ValueError: it has a cycle.

    Example:
        >>> import networkx as nx
        >>> incomparable_pairs(nx.DiGraph([("a", "b"), ("a", "c")]))
        [('b', 'c')]
    """
    _require_order(graph)
    return [(a, b) for a, b in combinations(graph, 2) if not graph.has_edge(a, b) and not graph.has_edge(b, a)]


def _require_order(graph: "DiGraph") -> None:
    """Raise unless it is a directed graph without a cycle."""
    import networkx as nx

    if not isinstance(graph, nx.DiGraph):
        raise TypeError(f"graph must be a networkx.DiGraph; got {type(graph).__name__}. Pass dominance(profiles).")
    if not nx.is_directed_acyclic_graph(graph):
        raise ValueError("graph must be an order; got a graph with a cycle. Pass dominance(profiles).")


def _matched(graph: "DiGraph") -> tuple[dict[int, int], set[int]]:
    """A largest set of edges of which no two start, or end, at one node, {start: end} by number; and a smallest cover.

    Node i stands on the left as i, where edges start, and on the right as i + n, where they end.
    """
    import networkx as nx

    _require_order(graph)
    number = {node: i for i, node in enumerate(graph)}
    left, n = range(len(number)), len(number)
    pairs = nx.Graph()
    pairs.add_nodes_from(range(2 * n))
    pairs.add_edges_from((number[a], number[b] + n) for a, b in graph.edges)
    # Numbers, and not the names themselves, whose order in a set changes from run to run.
    matching = nx.bipartite.hopcroft_karp_matching(pairs, left)
    cover = nx.bipartite.to_vertex_cover(pairs, matching, left)
    return {i: matching[i] - n for i in left if i in matching}, cover
