"""Figures: what is drawn is what the core says, axes are labelled, and bad input is refused."""

import sys
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch
from matplotlib.axes import Axes

import torchlinf
from torchlinf import plot, shapes
from torchlinf.regions import decision_plane, decision_region_complexity

Draw: TypeAlias = Callable[[Any], Any]

DISC = shapes.disc(14, margin=1)
TALL = shapes.box(22, 9)
SHAPES = {"disc": DISC, "box": TALL, "bow": shapes.superellipse(13, 0.7)}


@pytest.fixture(autouse=True)
def _close_figures() -> Iterator[None]:
    yield
    plt.close("all")


def labels(ax: Axes) -> tuple[str, str]:
    return ax.get_xlabel(), ax.get_ylabel()


def test_the_staircase_of_a_profile_is_its_levels() -> None:
    ax = plot.profile(DISC, label="disc")
    values, edges, _ = ax.patches[0].get_data()
    levels = torchlinf.complexity_profile(DISC, spatial_ndim=2).levels()
    np.testing.assert_array_equal(values, levels)
    np.testing.assert_allclose(edges, np.arange(len(levels) + 1) / len(levels))
    assert labels(ax) == ("scale t = d / D (share of the radius)", "complexity (bits)")
    assert ax.get_xlim() == (0, 1)
    assert ax.get_ylim()[0] < 0 < values.max() < ax.get_ylim()[1]


def test_profiles_share_axes_in_colours_of_their_own() -> None:
    ax = plot.profile(TALL)
    for mask in (DISC, shapes.cube_with_appendages(9, 3, ["left"]), torch.ones(12)):
        assert plot.profile(mask, ax=ax) is ax
    assert len({patch.get_edgecolor() for patch in ax.patches}) == 4
    assert ax.get_ylim()[1] > max(patch.get_data().values.max() for patch in ax.patches)


def test_a_profile_of_zero_can_be_seen() -> None:
    bottom, top = plot.profile(TALL).get_ylim()
    assert bottom < 0
    assert top > 1


def test_a_profile_of_standard_deviations() -> None:
    ax = plot.profile(DISC, estimator="std")
    levels = torchlinf.complexity_profile(DISC, estimator="std", spatial_ndim=2).levels()
    np.testing.assert_array_equal(ax.patches[0].get_data().values, levels)
    assert labels(ax)[1] == "standard deviation of f / max f"
    assert ax.get_ylim()[1] < 0.5 < plot.profile(DISC).get_ylim()[1]
    with pytest.raises(ValueError, match="estimator"):
        plot.profile(DISC, estimator="variance")


@pytest.mark.parametrize("of", ["field", "distance"])
def test_level_lines_lie_where_the_values_are(of: str) -> None:
    ax = plot.levels(TALL, of=of)
    assert labels(ax) == ("column (pixels)", "row (pixels)")
    assert ax.get_aspect() == 1
    assert ax.yaxis_inverted()
    (lines,) = ax.collections
    assert list(lines.levels) == pytest.approx([0.1 * k for k in range(1, 10)])
    # The middle line is a box around the centre of the box, whose values depend on the distance alone.
    x, y = lines.get_paths()[4].vertices.T
    assert (x.min() + x.max(), y.min() + y.max()) == pytest.approx((8, 21))
    assert 0 < x.min() < x.max() < 8
    assert x.min() == pytest.approx(y.min())


def test_level_lines_of_another_field() -> None:
    # 2, 4 ... 24 from left to right: half of the maximum is the sixth column, whose index is 5.
    ramp = 2.0 * torch.arange(1, 13).expand(5, 12)
    ax = plot.levels(torch.ones(5, 12), of=ramp, color="#FF0000")
    x, y = ax.collections[0].get_paths()[4].vertices.T
    assert float(x[(y > 0) & (y < 4)].min()) == pytest.approx(5)
    assert ax.get_title() == "field / its maximum"
    assert ax.images[0].cmap(1.0)[:3] == (1.0, 0.5, 0.5)
    with pytest.raises(ValueError, match=r"got \(12, 5\) for \(5, 12\). Pass one value for each pixel."):
        plot.levels(torch.ones(5, 12), of=ramp.T)
    with pytest.raises(ValueError, match=r"field on an image"):
        plot.levels(torch.ones(3, 5, 12), of=torch.ones(3, 5, 12))


def test_lines_of_a_shape_at_the_border_are_closed() -> None:
    ax = plot.levels(torch.ones(7, 12))
    for path in ax.collections[0].get_paths():
        for polygon in path.to_polygons(closed_only=False):
            np.testing.assert_array_equal(polygon[0], polygon[-1])


def test_of_a_volume_the_deepest_slice_is_drawn() -> None:
    volume = torch.zeros(9, 12, 15, dtype=torch.bool)
    volume[0:3, 2:5, 2:5] = True
    volume[2:9, 4:11, 6:14] = True
    image = plot.levels(volume).images[0].get_array()[1:-1, 1:-1]
    np.testing.assert_array_equal(image, volume[5])


def test_the_map_of_the_complexity_is_drawn_with_its_scale() -> None:
    ax = plot.complexity_map(DISC, high=0.5)
    share = torchlinf.complexity_map(DISC, high=0.5, spatial_ndim=2).numpy()
    drawn = ax.images[0].get_array()
    np.testing.assert_array_equal(drawn.mask, ~DISC)
    np.testing.assert_array_equal(drawn.filled(0), share)
    top = ax.images[0].get_clim()[1]
    assert (share > top).sum() == pytest.approx(0.02 * (share > 0).sum(), abs=8)  # pixels come in eights
    assert ax.images[0].colorbar.ax.get_ylabel() == "share (bits per pixel)"
    assert ax.get_title() == f"{torchlinf.complexity(DISC, high=0.5, spatial_ndim=2):.2f} bits"
    assert (labels(ax), ax.get_aspect()) == (("column (pixels)", "row (pixels)"), 1)
    assert plot.complexity_map(DISC, top=0.01).images[0].get_clim() == (0, 0.01)
    assert plot.complexity_map(TALL).get_title() == "0.00 bits"


def test_the_outline_runs_along_the_edges_of_the_pixels() -> None:
    ax = plot.complexity_map(TALL)
    x, y = ax.collections[0].get_paths()[0].vertices.T
    assert (x.min(), x.max(), y.min(), y.max()) == (-0.5, 8.5, -0.5, 21.5)


def test_of_a_volume_the_deepest_slice_of_the_map_is_drawn() -> None:
    volume = shapes.cube_with_appendages(8, 4, ["left", "front"])
    ax = plot.complexity_map(volume)
    share = torchlinf.complexity_map(volume, spatial_ndim=3)
    np.testing.assert_array_equal(ax.images[0].get_array().filled(0), share[7])
    assert ax.get_title() == f"{share.sum():.2f} bits"


def test_shapes_are_sorted_by_complexity() -> None:
    figure = plot.shapes(SHAPES)
    profiles, *panels = figure.axes
    numbers = {name: float(torchlinf.complexity(mask, spatial_ndim=2)) for name, mask in SHAPES.items()}
    order = sorted(SHAPES, key=numbers.__getitem__)
    assert [panel.get_xlabel() for panel in panels] == [f"{name}\n{numbers[name]:.2f} bits" for name in order]
    assert [patch.get_label() for patch in profiles.patches] == order
    assert len(profiles.get_legend().texts) == 3
    assert labels(profiles)[1] == "complexity (bits)"


def test_overview_draws_every_mask_twice() -> None:
    figure = plot.overview(SHAPES)
    profiles, *panels = figure.axes
    assert [panel.get_title() for panel in panels] == ["field f / max f", "scale t = d / D"] * 3
    assert all(len(panel.collections) == len(panel.images) == 1 for panel in panels)
    assert len(profiles.patches) == 3
    assert plot.overview({"a": DISC}).axes[0].get_legend() is None


@pytest.mark.parametrize("count", [1, 2, 7])
@pytest.mark.parametrize("draw", [plot.shapes, plot.overview])
def test_nothing_overlaps_or_leaves_the_page(draw: Draw, count: int) -> None:
    figure = draw({f"a mask with a name too long to print, {i}": DISC if i % 2 else TALL for i in range(count)})
    figure.canvas.draw()
    boxes = [ax.get_tightbbox() for ax in figure.axes]
    assert len(boxes) == 1 + count * (2 if draw is plot.overview else 1)
    width, height = figure.bbox.size
    for i, box in enumerate(boxes):
        assert -1 <= box.x0 < box.x1 <= width + 1
        assert -1 <= box.y0 < box.y1 <= height + 1
        assert not any(box.padded(-1).overlaps(other) for other in boxes[:i])


def test_decision_regions_lie_where_the_classes_are() -> None:
    found = decision_region_complexity(
        lambda p: (p[:, 0] > 1) * 2, [(0, 3), (-1, 1)], resolution=(7, 5), classes=[0, 1, 2]
    )
    ax = plot.decision_regions(found)
    image = ax.images[0]
    assert image.get_extent() == pytest.approx((-0.25, 3.25, -1.25, 1.25))
    assert image.origin == "lower"
    colours = image.get_array()
    assert colours.shape == (5, 7, 3)  # the first feature runs to the right
    assert len(np.unique(colours[:, :3].reshape(-1, 3), axis=0)) == 1
    assert (colours[0, 2] != colours[0, 3]).any()
    assert (labels(ax), ax.get_title()) == (("feature 0", "feature 1"), "0.00 bits")
    assert [text.get_text() for text in ax.get_legend().texts] == ["0: 0.00 bits", "2: 0.00 bits"]


def test_decision_regions_name_their_window_and_unit() -> None:
    disc = decision_region_complexity(lambda p: p.norm(dim=1) < 1, [(-2, 2)] * 2, resolution=31)
    ax = plot.decision_regions(disc, low=0.25, high=0.75)
    assert ax.get_title() == f"{float(disc.overall(0.25, 0.75)):.2f} bits"
    assert ax.get_legend().texts[1].get_text() == f"True: {float(disc.mean(0.25, 0.75)[1]):.2f} bits"
    deviations = decision_region_complexity(lambda p: p.norm(dim=1) < 1, [(-2, 2)] * 2, resolution=31, estimator="std")
    assert plot.decision_regions(deviations).get_title() == f"{float(deviations.overall()):.3f} of max f"
    with pytest.raises(ValueError, match="low and high must obey"):
        plot.decision_regions(disc, low=0.5, high=0.5)


def test_decision_planes_show_their_points() -> None:
    found = decision_plane(lambda p: p[:, :3], torch.eye(3, 5, dtype=torch.float64) * 2, resolution=12)
    ax = plot.decision_regions(found)
    np.testing.assert_allclose(np.transpose(ax.lines[0].get_data()), found.plane.corners)
    assert labels(ax)[0] == "along the longest side"
    line = decision_region_complexity(lambda p: p[:, 0] > 1, [(0, 3)], resolution=7)
    with pytest.raises(ValueError, match="two axes; got 1"):
        plot.decision_regions(line)


def refuse(*_: object, **__: object) -> None:
    raise AssertionError("solved again")


def test_what_is_solved_is_not_solved_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A profile, a field and a map that are computed give the same figures as the mask, without a solve."""
    solution = torchlinf.solve_field(DISC, spatial_ndim=2)
    profile = torchlinf.complexity_profile(DISC, spatial_ndim=2, bins=64)
    shares = torchlinf.complexity_map(DISC, spatial_ndim=2, high=0.5)
    solutions = {name: torchlinf.solve_field(mask, spatial_ndim=2) for name, mask in SHAPES.items()}
    expected = [plot.profile(DISC, bins=64), plot.levels(DISC), plot.complexity_map(DISC, high=0.5)]
    titles = [[ax.get_xlabel() for ax in plot.shapes(SHAPES).axes], plot.overview(SHAPES).get_size_inches().tolist()]
    monkeypatch.setattr("torchlinf.plot.solved_shape.complexity_profile", refuse)
    monkeypatch.setattr("torchlinf.plot.solved_shape.solve_field", refuse)
    monkeypatch.setattr("torchlinf.plot.shape_figures.measured_map", refuse)
    drawn = [plot.profile(profile), plot.levels(DISC, solution=solution), plot.complexity_map(DISC, shares=shares)]
    np.testing.assert_array_equal(drawn[0].patches[0].get_data().values, expected[0].patches[0].get_data().values)
    for ax, same in zip(drawn[1:], expected[1:], strict=True):
        np.testing.assert_array_equal(ax.images[0].get_array(), same.images[0].get_array())
        for path, other in zip(ax.collections[0].get_paths(), same.collections[0].get_paths(), strict=True):
            np.testing.assert_array_equal(path.vertices, other.vertices)
    assert drawn[2].get_title() == expected[2].get_title()
    assert [ax.get_xlabel() for ax in plot.shapes(SHAPES, solutions=solutions).axes] == titles[0]
    assert plot.overview(SHAPES, solutions=solutions).get_size_inches().tolist() == titles[1]
    assert plot.levels(DISC, of="distance").images  # needs no field
    assert plot.levels(DISC, of=DISC.double()).images
    for again in (plot.profile, plot.levels, plot.complexity_map):
        with pytest.raises(AssertionError, match="solved again"):
            again(DISC)


@pytest.mark.parametrize("options", [{}, {"estimator": "std"}, {"bins": 64, "rho": 3.0}])
def test_figures_of_several_shapes_measure_as_the_core_does(options: dict[str, Any]) -> None:
    """Their profiles come from the field that the level lines need, one solve a shape."""
    for figure in (plot.shapes(SHAPES, **options), plot.overview(SHAPES, **options)):
        drawn = {patch.get_label(): patch.get_data().values for patch in figure.axes[0].patches}
        for name, mask in SHAPES.items():
            expected = torchlinf.complexity_profile(mask, spatial_ndim=2, **options).level_values
            np.testing.assert_allclose(drawn[name], expected, rtol=0, atol=1e-12)


def test_one_solve_a_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def counted(mask: torch.Tensor, **options: Any) -> torchlinf.FieldSolution:
        calls.append(mask)
        return torchlinf.solve_field(mask, **options)

    monkeypatch.setattr("torchlinf.plot.solved_shape.solve_field", counted)
    monkeypatch.setattr("torchlinf.plot.solved_shape.complexity_profile", refuse)
    plot.shapes(SHAPES)
    plot.overview(SHAPES)
    assert len(calls) == 2 * len(SHAPES)


def test_options_of_the_measure_are_those_of_the_core() -> None:
    ax = plot.profile(DISC, bins=16, rho=2.0, tol=1e-6)
    same = torchlinf.complexity_profile(DISC, bins=16, rho=2.0, tol=1e-6, spatial_ndim=2)
    np.testing.assert_array_equal(ax.patches[0].get_data().values, same.levels())
    title = plot.complexity_map(DISC, bins=16, rho=2.0).get_title()
    assert title == f"{torchlinf.complexity(DISC, bins=16, rho=2.0, spatial_ndim=2):.2f} bits"
    near, far = (plot.levels(DISC, rho=rho).collections[0].get_paths()[4].vertices for rho in (1.0, 50.0))
    assert near.shape != far.shape or not np.array_equal(near, far)
    assert "of max f" in plot.shapes(SHAPES, estimator="std").axes[1].get_xlabel()


@pytest.mark.parametrize(
    "draw", [plot.profile, plot.levels, plot.complexity_map, lambda mask: plot.shapes({"a": mask})]
)
def test_bad_input_is_refused_before_a_figure_is_opened(draw: Draw) -> None:
    for mask, error, words in [
        (torch.zeros(4, 6), ValueError, "at least one pixel inside"),
        (torch.full((4, 6), 0.5), ValueError, "must hold only 0 and 1"),
        (np.ones((4, 6)), TypeError, "from_numpy"),
    ]:
        with pytest.raises(error, match=words):
            draw(mask)
    assert plt.get_fignums() == []


def test_more_bad_input() -> None:
    with pytest.raises(ValueError, match=r"mask must be \(H, W\) or \(D, H, W\); got \(1, 1, 4, 6\)"):
        plot.levels(torch.ones(1, 1, 4, 6))
    with pytest.raises(ValueError, match="of must be 'field' or 'distance'; got 'f'"):
        plot.levels(DISC, of="f")
    for draw in (plot.shapes, plot.overview):
        with pytest.raises(ValueError, match="at least one mask"):
            draw({})
        with pytest.raises(TypeError, match="masks must map names to masks; got Tensor"):
            draw(DISC)
        with pytest.raises(ValueError, match=r"masks\['b'\] must have at least one pixel inside; got an empty one"):
            draw({"a": DISC, "b": torch.zeros(3, 4)})
        with pytest.raises(ValueError, match="solutions must map the names of all masks"):
            draw(SHAPES, solutions={})
        with pytest.raises(ValueError, match="bins must be an integer of 1 or more; got 0"):
            draw(SHAPES, bins=0)
    with pytest.raises(TypeError, match="low is not an option here"):
        plot.shapes(SHAPES, low=0.5)


def test_bad_input_beside_what_is_solved() -> None:
    profile = torchlinf.complexity_profile(DISC, spatial_ndim=2)
    solution = torchlinf.solve_field(DISC, spatial_ndim=2)
    shares = torchlinf.complexity_map(DISC, spatial_ndim=2)
    both = torchlinf.complexity_profile(torch.stack([DISC, DISC]), spatial_ndim=2)
    empty = torchlinf.complexity_profile(torch.zeros(3, 4), spatial_ndim=2)
    wrong = [
        (
            lambda: plot.profile(profile, bins=9),
            ValueError,
            "bins must be left out beside a computed profile; got bins=9",
        ),
        (lambda: plot.profile(both), ValueError, r"must be that of one shape with a pixel inside; got 2 shapes"),
        (lambda: plot.profile(empty), ValueError, r"got 1 shapes of radius 0"),
        (
            lambda: plot.levels(DISC, solution=solution, tol=0.1),
            ValueError,
            "tol must be left out beside a computed sol",
        ),
        (
            lambda: plot.levels(TALL, solution=solution),
            ValueError,
            r"solution must be that of mask; got values \(31, 31\)",
        ),
        (lambda: plot.levels(DISC, solution=solution.value), TypeError, "solution must be a FieldSolution; got Tensor"),
        (lambda: plot.complexity_map(DISC, shares=shares, high=0.5), ValueError, "high must be left out beside a comp"),
        (lambda: plot.complexity_map(TALL, shares=shares), ValueError, "shares must be those of mask; got"),
        (lambda: plot.complexity_map(DISC, shares=0.5), TypeError, "shares must be a tensor; got float"),
        (lambda: plot.complexity_map(DISC, estimator="std"), ValueError, 'estimator must be "entropy" for a map'),
        (lambda: plot.complexity_map(DISC, top=0), ValueError, "top must be finite and above 0"),
        (lambda: plot.profile(DISC, ax="left"), TypeError, "ax must be matplotlib axes; got str"),
        (lambda: plot.decision_regions(DISC), TypeError, "regions must be DecisionRegions; got Tensor"),
    ]
    for draw, error, words in wrong:
        with pytest.raises(error, match=words):
            draw()
    assert plt.get_fignums() == []


def test_without_matplotlib_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    for draw in (plot.profile, plot.levels, plot.complexity_map, lambda mask: plot.shapes({"a": mask})):
        with pytest.raises(ImportError, match=r"pip install 'torchlinf\[plot\]'"):
            draw(DISC)
    with pytest.raises(ImportError, match=r"pip install 'torchlinf\[plot\]'"):
        plot.decision_regions(decision_region_complexity(lambda p: p[:, 0] > 1, [(0, 3), (0, 2)], resolution=7))


def test_thirty_classes_have_colours_of_their_own() -> None:
    found = decision_region_complexity(lambda p: (p[:, 0] * 30).long(), [(0, 0.999), (0, 1)], resolution=(30, 2))
    assert len(found.classes) == 30
    handles = plot.decision_regions(found).get_legend().get_patches()
    assert len({patch.get_facecolor() for patch in handles}) == 30
