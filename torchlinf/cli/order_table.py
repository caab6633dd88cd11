"""A partial order as a table, one row a shape, for programs and for people."""

import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

from torchlinf import __version__
from torchlinf._helpers.terminal import names_table, printable
from torchlinf.measure import ComplexityProfile
from torchlinf.order import Node, chains, hasse_diagram, incomparable_pairs, largest_antichain, longest_chain
from torchlinf.scoring import csv_line

if TYPE_CHECKING:
    from networkx import DiGraph

Row: TypeAlias = dict[str, Any]
Profiles: TypeAlias = Mapping[str, ComplexityProfile]


def order_rows(order: "DiGraph", profiles: Profiles) -> Iterator[Row]:
    """Rows of an order, from the lowest rank up, which is the order of the nodes within a rank.

    Args:
        order: as `dominance` returns it.
        profiles: those that it was made of, each of one shape; their measure names the windows.

    Yields:
        By the names of the columns: `path`, a name; `rank`, how many shapes the longest chain below has; the mean over
        each window; `equal`, `above` (one step, without what follows) and `incomparable`, lists of names; and how the
        shape was measured.

    >>> from torchlinf import complexity_profile, shapes
    >>> from torchlinf.order import dominance
    >>> masks = {"box": shapes.box(4, 6), "square": shapes.square(4), "disc": shapes.disc(6)}
    >>> profiles = {name: complexity_profile(mask, spatial_ndim=2) for name, mask in masks.items()}
    >>> list(next(order_rows(dominance(profiles), profiles)).items())[:5]
    [('path', 'box'), ('rank', 0), ('complexity', 0.0), ('equal', ['square']), ('above', ['disc'])]
    """
    import networkx as nx

    steps = hasse_diagram(order)
    apart: dict[Node, list[str]] = {node: [] for node in order}
    for a, b in incomparable_pairs(order):
        apart[a] += b
        apart[b] += a
    place = {node: i for i, node in enumerate(order)}
    for rank, nodes in enumerate(nx.topological_generations(steps)):
        for node in sorted(nodes, key=place.__getitem__):
            above = [name for other in steps.successors(node) for name in other]
            for name in node:
                profile = profiles[name]
                windows = profile.measure.named_windows()
                yield {
                    "path": name,
                    "rank": rank,
                    **{window: profile.mean(*ends).item() for window, ends in windows.items()},
                    "equal": [other for other in node if other != name],
                    "above": above,
                    "incomparable": apart[node],
                    "radius": profile.radius.item(),
                    "error_bound": max(profile.error_bound(*ends).item() for ends in windows.values()),
                    "field_error_bound": profile.field_error_bound.item(),
                    "seconds": round(profile.seconds.item(), 6),
                    "version": __version__,
                    "measure": profile.measure.settings(),
                }


def as_csv(order: "DiGraph", profiles: Profiles) -> str:
    """The table as CSV; names in one cell stand apart by a semicolon and a space."""
    rows = [
        {key: "; ".join(x) if isinstance(x, list) else x for key, x in row.items()}
        for row in order_rows(order, profiles)
    ]
    return "".join(csv_line(cells) for cells in (rows[0], *(row.values() for row in rows)))


def as_json_lines(order: "DiGraph", profiles: Profiles) -> str:
    """The table as JSON objects, one a line; names in lists."""
    return "".join(json.dumps(row) + "\n" for row in order_rows(order, profiles))


def print_order(order: "DiGraph", profiles: Profiles) -> None:
    """Print the table for people, and below it chains and what cannot be compared."""
    from rich.console import Console

    console = Console(highlight=False, markup=False)
    rows = list(order_rows(order, profiles))
    measure = next(iter(profiles.values())).measure

    def shown(text: str) -> str:
        return printable(text, console.encoding)

    means = {
        f"t in ({low:g}, {high:g}]": [f"{row[window]:.3f}" for row in rows]
        for window, (low, high) in measure.named_windows().items()
    }
    table = names_table(
        [shown(row["path"]) for row in rows],
        {"rank": [str(row["rank"]) for row in rows], **means},
        width=console.width,
        texts={
            "equal to": [shown(", ".join(row["equal"])) for row in rows],
            "next above": [shown(", ".join(row["above"])) for row in rows],
        },
        important=["rank", *means],
        caption=f"Mean complexity in {measure.unit}.",
    )
    console.print(table)
    for line in summary(order):
        console.print(shown(line), soft_wrap=True)


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
