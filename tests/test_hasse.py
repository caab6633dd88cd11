"""Figures of Hasse diagrams against the order that they draw, and equality where intervals meet."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import networkx as nx
import numpy as np
import pytest
import torch
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.image import AxesImage
from problems import random_order

from torchlinf import ComplexityProfile, complexity_profile, plot, shapes
from torchlinf.order import dominance, hasse_diagram, longest_chain

FACES = [shapes.Appendage(face, 8, 8) for face in ("right", "top", "left")]
MASKS = {
    "square": shapes.square(32),
    "disc": shapes.disc(20),
    "small disc": shapes.disc(9),
    "one": shapes.with_appendages((32, 32), FACES[:1]),
    "two": shapes.with_appendages((32, 32), FACES[:2], margin=3),
    "three": shapes.with_appendages((32, 32), FACES),
    "bow": shapes.superellipse(17, 0.7),
    "diamond": shapes.superellipse(17, 1.0),
    "wide box": shapes.box(9, 40),
    "a disc with a name too long to print": shapes.disc(13),
}


@pytest.fixture(autouse=True)
def _close_figures() -> Iterator[None]:
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def profiles() -> dict[str, ComplexityProfile]:
    return {name: complexity_profile(mask, spatial_ndim=2) for name, mask in MASKS.items()}


def images(ax: Axes) -> dict[str, AxesImage]:
    """The image of each shape, by the name below it, which may be cut at the front."""
    middles = {image: np.mean(image.get_extent()[:2]) for image in ax.images}
    found = {}
    for text in ax.texts:
        x, y = text.get_position()
        (image,) = [i for i in ax.images if abs(middles[i] - x) < 1e-6 and 0 < i.get_extent()[2] - y < 0.1]
        shown = text.get_text().split("\n")[0].removeprefix("…")
        found[next(name for name in MASKS if name.endswith(shown) and (name == shown or len(shown) > 9))] = image
    return found


@pytest.mark.parametrize(
    ("how", "in_words"),
    [
        ({}, "(0, 0.25] and (0, 1]"),
        ({"windows": {"coarse": (0.25, 1.0)}}, "(0.25, 1]"),
        ({"windows": None}, "(0, 1]"),
        ({"windows": None, "every_scale": True}, "(0, 1]"),
    ],
)
def test_the_figure_holds_the_order(profiles: dict[str, ComplexityProfile], how: dict[str, Any], in_words: str) -> None:
    steps = hasse_diagram(dominance(profiles, **how))
    ax = plot.hasse(MASKS, **how)
    assert len(ax.images) == len(ax.texts) == len(MASKS)
    assert len(ax.patches) == sum(len(node) > 1 for node in steps)
    at = images(ax)
    for name, mask in MASKS.items():
        left, right, bottom, top = at[name].get_extent()
        pixels = at[name].get_array()
        assert pixels.shape[1] / pixels.shape[0] == pytest.approx((right - left) / (top - bottom))
        assert max(right - left, top - bottom) == pytest.approx(1.0)
        assert pixels.sum() == mask.sum()
    assert len(ax.lines) == len(steps.edges)
    for (low, high), line in zip(steps.edges, ax.lines, strict=True):
        x, y = line.get_data()
        assert (np.diff(y) > 0).all()
        assert y[0] > at[low[0]].get_extent()[3]
        assert y[-1] < at[high[0]].get_extent()[2]
        for node, end in ((low, x[0]), (high, x[-1])):
            edges = [at[name].get_extent()[:2] for name in node]
            assert np.min(edges) < end < np.max(edges)
    assert ax.get_xlabel() == f"below each name: mean complexity over t in {in_words}, bits"
    assert ax.get_ylabel() == "more complex →"


@pytest.mark.parametrize("seed", range(6))
def test_lines_keep_clear_of_the_shapes_between(seed: int) -> None:
    names = list(MASKS)
    order = nx.relabel_nodes(random_order(seed, size=9), lambda i: (names[i],))
    ax = plot.hasse(MASKS, order=order)
    inside = [np.array(image.get_extent()) for image in ax.images]
    for line in ax.lines:
        x, y = (np.concatenate([np.linspace(*ends, 50) for ends in pairwise(values)]) for values in line.get_data())
        for left, right, bottom, top in inside:
            assert not ((left < x) & (x < right) & (bottom < y) & (y < top)).any()


def test_numbers_stand_below_the_names(profiles: dict[str, ComplexityProfile]) -> None:
    texts = dict(text.get_text().split("\n") for text in plot.hasse(MASKS).texts)
    found = profiles["bow"]
    assert texts["bow"] == f"{float(found.mean(0.0, 0.25)):.2f}, {float(found.mean()):.2f}"
    assert texts["square"] == "0.00, 0.00"


@pytest.mark.parametrize("every_scale", [False, True])
def test_ten_shapes_fit_the_page(every_scale: bool) -> None:
    antichain = nx.DiGraph()
    antichain.add_nodes_from((name,) for name in MASKS)
    for ax in (plot.hasse(MASKS, every_scale=every_scale), plot.hasse(MASKS, order=antichain)):
        figure = ax.figure
        figure.canvas.draw()
        width, height = figure.bbox.size
        assert width <= 800
        texts = [text.get_window_extent() for text in [*ax.texts, ax.xaxis.label, ax.yaxis.label] if text.get_text()]
        for i, box in enumerate(texts):
            assert -1 <= box.x0 < box.x1 <= width + 1
            assert -1 <= box.y0 < box.y1 <= height + 1
            assert not any(box.padded(-0.5).overlaps(other) for other in texts[:i])
        for box in texts:
            assert not any(image.get_window_extent().padded(-0.5).overlaps(box) for image in ax.images)


def shaken(profile: ComplexityProfile, share: float, error: float) -> ComplexityProfile:
    """The profile with all its levels moved by a share, and another error bound of each."""
    return replace(
        profile,
        level_values=profile.level_values + share,
        level_error_bound=torch.full_like(profile.level_error_bound, error),
    )


@pytest.mark.parametrize(("error", "frames"), [(1e-9, 1), (1e-11, 0)])
def test_shapes_whose_intervals_meet_are_one_node(error: float, frames: int) -> None:
    disc, square = (complexity_profile(mask, spatial_ndim=2) for mask in (shapes.disc(9), shapes.square(9)))
    solved = {"disc": shaken(disc, 0.0, error), "twin": shaken(disc, 1e-10, error), "square": square}
    ax = plot.hasse({"disc": shapes.disc(9), "twin": shapes.disc(9), "square": shapes.square(9)}, profiles=solved)
    assert len(ax.patches) == frames
    # The three are one above another unless two of them share a node.
    assert len(ax.lines) == 2 - frames
    heights = {image.get_extent()[2] for image in ax.images}
    assert len(heights) == 3 - frames


def test_many_equal_shapes_stand_in_a_square() -> None:
    ax = plot.hasse({f"box {n}": shapes.box(n, 2 * n) for n in range(3, 8)})
    assert sorted({round(image.get_extent()[0], 6) for image in ax.images}) == [0.0, 1.42, 2.84]
    assert len({image.get_extent()[2] for image in ax.images}) == 2
    assert len(ax.patches) == 1
    frame = ax.patches[0].get_window_extent()
    assert all(frame.contains(*corner) for text in ax.texts for corner in text.get_window_extent().corners())


def test_a_chain_is_drawn_in_another_colour(profiles: dict[str, ComplexityProfile]) -> None:
    order = dominance(profiles)
    chain = longest_chain(order)
    ax = plot.hasse(MASKS, order=order, highlight=chain)
    assert sum(to_hex(line.get_color()) == plot.COLOURS[1].lower() for line in ax.lines) == len(chain) - 1 > 1
    lit = {name for name, image in images(ax).items() if to_hex(image.get_cmap()(1.0)) == plot.COLOURS[1].lower()}
    assert lit == {name for node in chain for name in node}


def test_axes_may_be_given() -> None:
    _, (left, right) = plt.subplots(1, 2, figsize=(8, 4))
    assert plot.hasse(MASKS, ax=right) is right
    assert right.images
    assert not left.images


def test_of_a_volume_the_deepest_slice_is_drawn() -> None:
    volume = torch.zeros(9, 12, 15, dtype=torch.bool)
    volume[0:3, 2:5, 2:5] = True
    volume[2:9, 4:11, 6:14] = True
    (image,) = plot.hasse({"volume": volume}).images
    np.testing.assert_array_equal(image.get_array(), np.ones((7, 8)))


def test_bad_input_is_refused_before_a_figure_is_opened(profiles: dict[str, ComplexityProfile]) -> None:
    wrong = [
        ({}, {}, ValueError, "at least one mask"),
        ({"a": torch.zeros(3, 4)}, {}, ValueError, r"masks\['a'\] must have at least one pixel inside"),
        ({"a": torch.ones(1, 1, 3, 4)}, {}, ValueError, r"\(H, W\) or \(D, H, W\)"),
        ({"a": np.ones((3, 4))}, {}, TypeError, "from_numpy"),
        (MASKS, {"windows": {"wrong": (0.5, 0.25)}}, ValueError, "low"),
        (list(MASKS.values()), {}, TypeError, "masks must map names to masks; got list"),
        (MASKS, {"order": "disc"}, TypeError, "order must be a networkx.DiGraph; got str"),
        (MASKS, {"profiles": profiles, "bins": 9}, ValueError, "bins must be left out beside a computed profile"),
        (MASKS, {"profiles": profiles, "ax": "left"}, TypeError, "ax must be matplotlib axes; got str"),
        ({"disc": MASKS["disc"]}, {"order": dominance(profiles)}, ValueError, "got 'square'. Pass its mask"),
        (MASKS, {"highlight": ["disc"]}, ValueError, "got 'disc'. Pass tuples"),
        (MASKS, {"order": nx.DiGraph()}, ValueError, "at least one shape"),
    ]
    for masks, options, error, words in wrong:
        with pytest.raises(error, match=words):
            plot.hasse(masks, **options)
    assert plt.get_fignums() == []


def test_without_matplotlib_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(ImportError, match=r"pip install 'torchlinf\[plot\]'"):
        plot.hasse(MASKS)


def test_what_is_solved_is_not_solved_again(
    profiles: dict[str, ComplexityProfile], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("solved again")

    monkeypatch.setattr("torchlinf.plot.solved_shape.complexity_profile", refuse)
    assert len(plot.hasse(MASKS, profiles=profiles).images) == len(MASKS)
    assert len(plot.hasse(MASKS, order=dominance(profiles, every_scale=True)).images) == len(MASKS)
    with pytest.raises(AssertionError, match="solved again"):
        plot.hasse(MASKS)


def test_the_unit_is_that_of_the_estimator() -> None:
    ax = plot.hasse({"disc": shapes.disc(9), "square": shapes.square(9)}, estimator="std")
    assert ax.get_xlabel().endswith(", share of max f")
