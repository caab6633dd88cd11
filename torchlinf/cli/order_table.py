"""A partial order as a table, one row a shape, for programs and for people."""

import csv
import io
import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, TypeAlias

from torchlinf.order import Node, chains, hasse_diagram, incomparable_pairs, largest_antichain, longest_chain

if TYPE_CHECKING:
    from networkx import DiGraph

Row: TypeAlias = dict[str, Any]


def order_rows(order: "DiGraph") -> Iterator[Row]:
    """Rows of an order, from the lowest rank up, which is the order of the nodes within a rank.

    Args:
        order: as `dominance` returns it.

    Yields:
        By the names of the columns: `path`, a name; `rank`, how many shapes the longest chain below has; the mean over
        each window in bits; `equal`, `above` (one step, without what follows) and `incomparable`, lists of names.

    >>> import networkx as nx
    >>> order = nx.DiGraph([(("a", "b"), ("c",))], windows={"complexity": (0.0, 1.0)})
    >>> order.add_nodes_from(order, indicators=(0.5,))
    >>> next(order_rows(order))
    {'path': 'a', 'rank': 0, 'complexity': 0.5, 'equal': ['b'], 'above': ['c'], 'incomparable': []}
    """
    import networkx as nx

    steps = hasse_diagram(order)
    apart: dict[Node, list[str]] = {node: [] for node in order}
    for a, b in incomparable_pairs(order):
        apart[a] += b
        apart[b] += a
    columns = list(order.graph["windows"])
    place = {node: i for i, node in enumerate(order)}
    for rank, nodes in enumerate(nx.topological_generations(steps)):
        for node in sorted(nodes, key=place.__getitem__):
            above = [name for other in steps.successors(node) for name in other]
            means = dict(zip(columns, order.nodes[node]["indicators"], strict=True))
            for name in node:
                equal = [other for other in node if other != name]
                related = {"equal": equal, "above": above, "incomparable": apart[node]}
                yield {"path": name, "rank": rank} | means | related


def as_csv(order: "DiGraph") -> str:
    """The table as CSV; names in one cell stand apart by a semicolon and a space."""
    rows = [{key: "; ".join(x) if isinstance(x, list) else x for key, x in row.items()} for row in order_rows(order)]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def as_json_lines(order: "DiGraph") -> str:
    """The table as JSON objects, one a line; names in lists."""
    return "".join(json.dumps(row) + "\n" for row in order_rows(order))


def print_order(order: "DiGraph") -> None:
    """Print the table for people, and below it chains and what cannot be compared."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False)
    means = [f"t in ({low:g}, {high:g}]" for low, high in order.graph["windows"].values()]
    table = Table(caption="Mean complexity in bits.", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("mask", overflow="fold")
    for title in ("rank", *means):
        table.add_column(title, justify="right", no_wrap=True)
    for title in ("equal to", "next above"):
        table.add_column(title, overflow="fold")
    for row in order_rows(order):
        path, rank, *values, equal, above, _ = row.values()
        numbers = (str(rank), *(f"{value:.3f}" for value in values))
        table.add_row(escape(path), *numbers, *(escape(", ".join(names)) for names in (equal, above)))
    console.print(table)
    for line in summary(order):
        console.print(escape(line), soft_wrap=True)


def summary(order: "DiGraph") -> list[str]:
    """What the order is like, in sentences."""
    alone, pairs = largest_antichain(order), incomparable_pairs(order)
    count = len(order) * (len(order) - 1) // 2
    lines = [f"Longest chain: {' < '.join(map(_together, longest_chain(order)))}"]
    if pairs:
        lines += [
            f"Largest antichain: {', '.join(map(_together, alone))}; {len(chains(order))} chains hold all",
            f"Incomparable: {len(pairs)} of {count} pairs: {', '.join(' | '.join(map(_together, p)) for p in pairs)}",
        ]
    return lines


def _together(node: Node) -> str:
    return " = ".join(node)
