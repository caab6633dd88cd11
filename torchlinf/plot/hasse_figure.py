"""Figure of a partial order as a Hasse diagram: shapes in ranks, names below them, lines upwards."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from itertools import pairwise
from math import ceil, sqrt
from typing import TYPE_CHECKING, NamedTuple, Unpack, cast

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchlinf.measure import ComplexityProfile, ProfileOptions, takes
from torchlinf.order import WINDOWS, Node, dominance, hasse_diagram
from torchlinf.plot.drawing import COLOURS, pyplot, require_axes, shorten
from torchlinf.plot.layered_layout import Bend, Layers, layers
from torchlinf.plot.solved_shape import profile_of, refuse_beside, require_masks, silhouette

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from networkx import DiGraph

# In units of the longer side of a shape: between neighbours, from rank to rank, and around what is drawn.
GAP, RISE, PAD = 0.42, 0.6, 0.08

# In inches: the width that a figure keeps to, the unit at most and at least, a line of text and one of its letters.
WIDTH, LARGEST, SMALLEST, TEXT, LETTER = 7.2, 0.85, 0.45, 0.125, 0.068
FONT = 8

LINE, LIT = "#999999", COLOURS[1]


class Box(NamedTuple):
    """Where the shapes of a node are: left and bottom edge, size, columns of shapes."""

    left: float
    bottom: float
    width: float
    height: float
    columns: int


class Diagram(NamedTuple):
    """A diagram before it is drawn.

    Attributes:
        steps: the order without the edges that follow from others.
        layout: ranks, and places from left to right.
        boxes: of each node.
        bottoms: of each rank, and of one more above the last.
        cell: height of a shape with its lines of text.
        letters: how many letters fit below a shape.
    """

    steps: "DiGraph"
    layout: Layers
    boxes: dict[Node, Box]
    bottoms: list[float]
    cell: float
    letters: int


@takes(ProfileOptions)
def hasse(
    masks: Mapping[str, Tensor],
    *,
    profiles: Mapping[str, ComplexityProfile] | None = None,
    order: "DiGraph | None" = None,
    windows: Mapping[str, tuple[float, float]] | None = WINDOWS,
    every_scale: bool = False,
    highlight: Sequence[Node] = (),
    ax: "Axes | None" = None,
    **options: Unpack[ProfileOptions],
) -> "Axes":
    """Draw the Hasse diagram of a partial order of shapes: each line leads up to a shape that is more complex.

    A shape is more complex than another if a path of lines leads up to it; without such a path the two cannot be
    compared. Steps that follow from other steps are left out. Shapes that count as equal, since their proven
    intervals meet, stand together in a frame; see `torchlinf.order.dominance`.

    Args:
        masks: the shapes by name, each (H, W) or (D, H, W), values 0 or 1, not empty. Of a volume the slice through its
            deepest voxel is drawn. Up to about twenty shapes stay readable.
        profiles: their profiles by name, if these are computed already; then nothing is solved, and the options of the
            measure are left out.
        order: the order, as `torchlinf.order.dominance` returns it, if there is one already; then `profiles`,
            `windows`, `every_scale` and the options of the measure are not used.
        windows: the windows of scales by which shapes are compared, a mapping of names to (low, high); None means one
            window over all scales.
        every_scale: if True, shapes are compared at every scale instead; the means over the windows are still shown.
        highlight: nodes to be drawn in another colour, with the lines from each to the next; a chain, for example.
        ax: where to draw; None makes a new figure of a size that suits.
        {measure options}

    Returns:
        The axes. Shapes are drawn with the longer side at 1, whatever their size in pixels; below are their names
        and the means over the windows, in bits (for "std" as shares of the field's maximum).

    Raises:
        ImportError: matplotlib is not installed.
        TypeError: an argument is of the wrong type.
        ValueError: there is no mask, or one is empty, not binary, or neither 2-D nor 3-D; `order`, `profiles` or
            `highlight` has names that are not in `masks` or `order`; or a window or an option has a wrong value.
        RuntimeError: a field could not be solved to `tol`.

    Example:
        >>> from torchlinf import plot, shapes
        >>> ax = plot.hasse({"disc": shapes.disc(16), "square": shapes.square(32), "box": shapes.box(9, 20)})
        >>> len(ax.images), len(ax.lines)
        (3, 1)
    """
    require_masks(masks)
    drawn = {name: silhouette(mask, f"masks[{name!r}]") for name, mask in masks.items()}
    if order is None:
        if profiles is None:
            profiles = {name: profile_of(mask, options, f"masks[{name!r}]") for name, mask in masks.items()}
        else:
            refuse_beside(options, "profile")
        order = dominance(profiles, windows=windows, every_scale=every_scale)
    _check_names(order, masks, highlight)
    if ax is not None:
        require_axes(ax)
    return _draw_order(ax, order, drawn, highlight)


def _draw_order(
    ax: "Axes | None", order: "DiGraph", drawn: Mapping[str, NDArray[np.bool_]], highlight: Sequence[Node]
) -> "Axes":
    """Draw the diagram, in a figure of its own if there are no axes."""
    room = WIDTH if ax is None else ax.get_window_extent().width / ax.figure.dpi
    diagram, unit = _lay_out(hasse_diagram(order), room)
    width, height = _size(diagram)
    if ax is None:
        # Words at the left and below take half an inch, and those below some width.
        size = max(unit * (width + GAP) + 0.4, 4.4), unit * height + 0.5
        ax = pyplot().subplots(figsize=size, layout="constrained")[1]
    for edge in diagram.steps.edges:
        _draw_line(ax, diagram, drawn, edge, edge in set(pairwise(highlight)))
    for node in diagram.boxes:
        _draw_node(ax, diagram, drawn, node, LIT if node in set(highlight) else COLOURS[0])
    ax.set(xlim=(-PAD - GAP / 2, width + PAD + GAP / 2), ylim=(-2 * PAD, height + 2 * PAD), aspect="equal")
    ax.set(xticks=[], yticks=[], ylabel="more complex →")
    ax.spines[:].set_visible(False)
    if "windows" in order.graph:
        unit_of_means = order.graph.get("unit", "bits")
        windows = in_words(order.graph["windows"].values())
        ax.set_xlabel(f"below each name: mean complexity over {windows}, {unit_of_means}", fontsize=FONT)
    return ax


def _check_names(order: "DiGraph", masks: Mapping[str, Tensor], highlight: Sequence[Node]) -> None:
    import networkx as nx

    if not isinstance(order, nx.DiGraph):
        raise TypeError(f"order must be a networkx.DiGraph; got {type(order).__name__}. Pass dominance(profiles).")
    if not order:
        raise ValueError("order must hold at least one shape; got none. Pass the order of at least one mask.")
    for name in (name for node in order for name in node):
        if name not in masks:
            raise ValueError(f"order must hold names of masks; got {name!r}. Pass its mask, or leave it out.")
    for node in highlight:
        if node not in order:
            raise ValueError(
                f"highlight must hold nodes of the order; got {node!r}. Pass tuples of all names that are equal."
            )


def in_words(windows: Iterable[tuple[float, float]]) -> str:
    """Windows of scales as text.

    >>> in_words([(0.0, 0.25), (0.0, 1.0)])
    't in (0, 0.25] and (0, 1]'
    """
    return "t in " + " and ".join(f"({low:g}, {high:g}]" for low, high in windows)


def _lay_out(steps: "DiGraph", room: float) -> tuple[Diagram, float]:
    """Place the nodes; equal shapes stand side by side, more than three in a square. Also the unit in inches."""
    columns = {node: len(node) if len(node) <= 3 else ceil(sqrt(len(node))) for node in steps}
    widths: dict[Hashable, float] = {node: count * (1 + GAP) - GAP for node, count in columns.items()}
    layout = layers(steps, widths, GAP)
    width = max(layout.x[node] + widths[node] / 2 for node in steps)
    unit = min(max(room / (width + GAP), SMALLEST), LARGEST)
    lines = 2 if any(steps.nodes[node].get("indicators") for node in steps) else 1
    cell = 1 + (TEXT * lines + 0.06) / unit
    boxes: dict[Node, Box] = {}
    bottoms = [0.0]
    for rank in layout.ranks:
        nodes = cast("list[Node]", [node for node in rank if not isinstance(node, Bend)])
        for node in nodes:
            height = ceil(len(node) / columns[node]) * cell
            boxes[node] = Box(layout.x[node] - widths[node] / 2, bottoms[-1], widths[node], height, columns[node])
        bottoms.append(bottoms[-1] + max(boxes[node].height for node in nodes) + RISE)
    return Diagram(steps, layout, boxes, bottoms, cell, int((1 + GAP) * unit / LETTER)), unit


def _size(diagram: Diagram) -> tuple[float, float]:
    return max(box.left + box.width for box in diagram.boxes.values()), diagram.bottoms[-1] - RISE


def _draw_line(
    ax: "Axes", diagram: Diagram, drawn: Mapping[str, NDArray[np.bool_]], edge: tuple[Node, Node], is_lit: bool
) -> None:
    """From above a shape, or the frame of several, along the bends to below another."""
    (start, end), x, bottoms = edge, diagram.layout.x, diagram.bottoms
    box = diagram.boxes[start]
    spare = 1 - _extent(drawn[start[0]])[1] if len(start) == 1 else 0.0
    points = [(x[start], box.bottom + box.height - spare + PAD)]
    for i, rank in enumerate(diagram.layout.ranks):
        bend = Bend(edge, i)
        if bend in rank:
            points += [(x[bend], bottoms[i]), (x[bend], bottoms[i + 1] - RISE)]
    points.append((x[end], diagram.boxes[end].bottom - PAD))
    ax.plot(*zip(*points, strict=True), color=LIT if is_lit else LINE, linewidth=1.8 if is_lit else 0.9, zorder=1)


def _draw_node(ax: "Axes", diagram: Diagram, drawn: Mapping[str, NDArray[np.bool_]], node: Node, color: str) -> None:
    from matplotlib.colors import LinearSegmentedColormap, to_rgb
    from matplotlib.patches import FancyBboxPatch

    ink = LinearSegmentedColormap.from_list("ink", [(*to_rgb(color), 0.0), (*to_rgb(color), 1.0)])
    box, numbers = diagram.boxes[node], diagram.steps.nodes[node].get("indicators", ())
    if len(node) > 1:
        style = f"round,pad={PAD}"
        ax.add_patch(FancyBboxPatch(box[:2], box.width, box.height, boxstyle=style, fill=False, edgecolor=LINE))
    for i, name in enumerate(node):
        row, column = divmod(i, box.columns)
        middle = box.left + column * (1 + GAP) + 0.5
        foot = box.bottom + box.height - row * diagram.cell - 1
        width, height = _extent(drawn[name])
        extent = (middle - width / 2, middle + width / 2, foot, foot + height)
        ax.imshow(drawn[name].astype(float), cmap=ink, vmin=0, vmax=1, extent=extent, zorder=2)
        text = [shorten(name, diagram.letters), *([", ".join(f"{value:.2f}" for value in numbers)] if numbers else [])]
        ax.text(middle, foot - 0.03, "\n".join(text), fontsize=FONT, ha="center", va="top", linespacing=1.1)


def _extent(mask: NDArray[np.bool_]) -> tuple[float, float]:
    """Width and height on the page: the longer one is 1."""
    height, width = mask.shape
    return width / max(mask.shape), height / max(mask.shape)
