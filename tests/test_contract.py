"""The contract of all entry points: one measure; the same options, defaults, checks, errors and numbers everywhere.

`ENTRIES` names every function, class and command that measures, with a minimal call. What is new goes in there.
"""

import dataclasses
import inspect
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypedDict

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch
from torch import Tensor, nn
from typer.testing import CliRunner

import torchlinf
from torchlinf import (
    Measure,
    decompose,
    labels,
    losses,
    metrics,
    order,
    plot,
    polygons,
    regions,
    scoring,
    shapes,
    transforms,
)
from torchlinf.cli.app import app
from torchlinf.measure import (
    GridOptions,
    LevelOptions,
    MeanOptions,
    MeasureOptions,
    ProfileOptions,
    SoftOptions,
    WindowOptions,
)
from torchlinf.measure.options import _DOCS, names_of
from torchlinf.polygons.table import PolygonOptions
from torchlinf.regions.orientations import PlaneOptions, RegionOptions
from torchlinf.scoring.ray import ScoreMasks, score_shards

MASK = shapes.disc(6)  # 13 x 13, without a part, so that every option below changes its number
MASK[6:9, 9:] = False
MASK[0, 1] = MASK[1, 0] = True  # and with a second component, which has two of one pixel each by faces
SIDE = len(MASK)
EMPTY = torch.zeros_like(MASK)
BOUNDS = [(0.0, SIDE - 1.0)] * 2


class FieldOptions(TypedDict, total=False):
    rho: float | Tensor | None
    tol: float


def inside(mask: Tensor) -> Callable[[Tensor], Tensor]:
    """A classifier that says where a mask is, as logits of class 1."""
    return lambda points: 4 * mask[tuple(points.round().long().T)].to(points.dtype) - 2


class Lookup(nn.Module):
    """The same as a module."""

    def __init__(self, mask: Tensor) -> None:
        super().__init__()
        self.answer = inside(mask)

    def forward(self, points: Tensor) -> Tensor:
        return self.answer(points)


def regions_of(mask: Tensor, **options: Any) -> regions.DecisionRegions:
    return regions.decision_region_complexity(
        inside(mask), BOUNDS, resolution=SIDE, threshold=0.0, classes=[0, 1], **options
    )


def region_mean(mask: Tensor, **options: Any) -> Any:
    """A turned grid is asked anew, and does not see what a turned mask is; "mean" is that of the summary alone."""
    if "orientation" not in options:
        return regions_of(mask, **options).mean()[1]
    one = {**options, "orientation": "least"} if options["orientation"] == "mean" else options
    found = regions.decision_region_complexity(
        clamped(mask), BOUNDS, resolution=SIDE, threshold=0.0, classes=[0, 1], **one
    )
    alone = torchlinf.complexity_profile(found.masks, spatial_ndim=2).mean()
    torch.testing.assert_close(found.mean(), alone, rtol=0, atol=0)
    return float("nan")


def summary_mean(mask: Tensor, **options: Any) -> Any:
    """Of the grid as it lies, unless the options say otherwise."""
    found = regions.decision_region_summary(
        clamped(mask), BOUNDS, resolution=SIDE, threshold=0.0, classes=[0, 1], **{"orientation": None, **options}
    )
    return float("nan") if "orientation" in options else found.mean()[1]


def triangle_of(mask: Tensor) -> Tensor:
    return torch.tensor([[0.0, 0.0], [0.0, 9.0], [9.0, 0.0]], dtype=torch.float64, device="cpu")


def clamped(mask: Tensor) -> Callable[[Tensor], Tensor]:
    return lambda points: inside(mask)(points.clamp(0, SIDE - 1))


def plane_mean(mask: Tensor, **options: Any) -> float:
    """The complexity of the region on a plane, less that of the mask it was drawn from: 0."""
    one = {**options, "orientation": "least"} if options.get("orientation") == "mean" else options
    found = regions.decision_plane(clamped(mask), triangle_of(mask), resolution=9, threshold=0.0, **one)
    level = {name: value for name, value in options.items() if name in names_of(LevelOptions)}
    alone = torchlinf.complexity_profile(found.masks, spatial_ndim=2, **level).mean()
    torch.testing.assert_close(found.mean(), alone, rtol=0, atol=0)
    return float("nan")


def planes_mean(mask: Tensor, **options: Any) -> float:
    found = regions.decision_plane_complexity(
        clamped(mask), triangle_of(mask), num_planes=2, resolution=9, threshold=0.0, **options
    )
    if options.get("orientation") == "mean":  # which `test_turned_regions` compares
        return float("nan")
    level = {name: value for name, value in options.items() if name in names_of(RegionOptions)}
    window = {name: value for name, value in options.items() if name not in level}
    corners = triangle_of(mask)[found.triples[0]]
    one = regions.decision_plane(clamped(mask), corners, resolution=9, threshold=0.0, **level)
    torch.testing.assert_close(found.values[0], one.overall(**window), rtol=0, atol=0)
    return float("nan")


def region_loss(mask: Tensor, **options: Any) -> float:
    """The loss is the mean of both classes, weighted by area; the reference is that of the regions."""
    loss = regions.DecisionRegionLoss(BOUNDS, resolution=SIDE, max_flips=1, **options)(Lookup(mask))
    level = {name: value for name, value in options.items() if name in names_of(LevelOptions)}
    window = {name: value for name, value in options.items() if name not in level}
    torch.testing.assert_close(loss.double(), regions_of(mask, **level).overall(**window), rtol=1e-5, atol=1e-6)
    return float("nan")


def metric(mask: Tensor, **options: Any) -> Any:
    with torch.device("cpu"):  # the states of a metric are on the default device, as torchmetrics has it
        made = metrics.ShapeComplexity(1, **options)
        made.update(mask[None, None].int())
        return made.compute()


def staircase(axes: Any) -> float:
    """The mean of the profile that is drawn."""
    return float(axes.patches[0].get_data().values.mean())


def file_of(mask: Tensor, folder: Path) -> Path:
    path = folder / "mask.npy"
    np.save(path, mask.numpy(force=True))
    return path


@dataclasses.dataclass(frozen=True)
class Entry:
    """One entry point.

    `call` takes a mask and options, and gives the complexity of the mask: NaN where it gives no such number.
    """

    target: Any
    kind: type
    data: int
    call: Callable[..., Any]
    changed: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    slow: bool = False
    documented: bool = True


def outlined(mask: Tensor, **options: Any) -> Any:
    """The table of the outline of a mask. In another frame it is drawn anew, so there it has numbers of its own."""
    shapely = pytest.importorskip("shapely")
    rows, columns = mask.nonzero().T.numpy(force=True)
    outline = shapely.union_all(shapely.box(columns, -rows - 1, columns + 1, -rows))
    table = polygons.complexity_table([outline], resolution=1.0, **options)
    return float("nan") if set(options) & set(PARTS) else table


SCORED = {"windows": scoring.WINDOWS}
FOLDER = Path()  # where masks are written, set by a fixture


def nothing(_: Any) -> float:
    plt.close("all")
    return float("nan")


def in_table(mask: Tensor, **options: Any) -> float:
    with scoring.open_table(FOLDER / "table.jsonl", **options):
        return float("nan")


def scored(mask: Tensor, **options: Any) -> Any:
    return averaged([row.values for row in scoring.score_masks(scoring.find_masks([file_of(mask, FOLDER)]), **options)])


def averaged(rows: list[Any]) -> Any:
    """Of a table with one row an object the means; the other columns are those of the last row."""
    return {
        **rows[-1],
        **{name: np.mean([row[name] for row in rows]) for name in ("complexity", "fine") if name in rows[0]},
    }


def on_ray(mask: Tensor, **options: Any) -> float:
    pytest.importorskip("pyarrow")
    table = ScoreMasks("mask", name="id", **options)({"id": np.array(["a"]), "mask": mask.numpy(force=True)[None]})
    return averaged(table.select([name for name in ("complexity", "fine") if name in table.column_names]).to_pylist())


def cli(command: str) -> Callable[..., Any]:
    """Call a command; a usage error becomes the error of the library, so that words can be compared."""

    def call(mask: Tensor, **options: Any) -> Any:
        arguments = [command, str(file_of(mask, FOLDER))]
        for name, value in options.items():
            if name == "windows":
                for window, (low, high) in (value or {}).items():
                    arguments += ["--window", f"{window}={low}-{high}"]
            else:
                arguments += [f"--{name.replace('_', '-')}", str(value)]
        arguments += ["--plot", str(FOLDER / "plot.png")] if command == "profile" else ["--json"]
        found = CliRunner().invoke(app, arguments)
        if found.exit_code == 2:
            raise ValueError(re.sub(r"[\s│╭╮╰╯─]+", " ", found.output + getattr(found, "stderr", "")))
        assert found.exit_code == 0, found.output
        if command == "profile":
            return float("nan")
        return averaged([json.loads(line) for line in found.output.splitlines() if line.startswith("{")])

    return call


ENTRIES = {
    "complexity": Entry(
        torchlinf.complexity, MeanOptions, 1, lambda m, **o: torchlinf.complexity(m, spatial_ndim=2, **o)
    ),
    "complexity_profile": Entry(
        torchlinf.complexity_profile,
        ProfileOptions,
        1,
        lambda m, **o: torchlinf.complexity_profile(m, spatial_ndim=2, **o).mean(),
    ),
    "complexity_map": Entry(
        torchlinf.complexity_map,
        WindowOptions,
        1,
        lambda m, **o: torchlinf.complexity_map(m, spatial_ndim=2, **o).sum(),
    ),
    "soft_complexity": Entry(
        torchlinf.soft_complexity,
        SoftOptions,
        1,
        lambda m, **o: nothing(torchlinf.soft_complexity(m.double(), spatial_ndim=2, **o)),
    ),
    "solve_field": Entry(
        torchlinf.solve_field,
        FieldOptions,
        1,
        lambda m, **o: nothing(torchlinf.solve_field(m, spatial_ndim=2, **o)),
        documented=False,
    ),
    "linf_field": Entry(
        torchlinf.linf_field,
        FieldOptions,
        1,
        lambda m, **o: nothing(torchlinf.linf_field(m, spatial_ndim=2, **o)),
        documented=False,
    ),
    "soft_linf_field": Entry(
        torchlinf.soft_linf_field,
        FieldOptions,
        1,
        lambda m, **o: nothing(torchlinf.soft_linf_field(m.double(), spatial_ndim=2, **o)),
        documented=False,
    ),
    "losses.ShapeComplexityLoss": Entry(
        losses.ShapeComplexityLoss,
        MeanOptions,
        0,
        lambda m, **o: losses.ShapeComplexityLoss(max_flips=1, **o)(m[None, None].double()),
    ),
    "regions.DecisionRegionLoss": Entry(regions.DecisionRegionLoss, WindowOptions, 1, region_loss),
    "metrics.ShapeComplexity": Entry(metrics.ShapeComplexity, MeasureOptions, 1, metric),
    "transforms.ShapeComplexityScore": Entry(
        transforms.ShapeComplexityScore, MeasureOptions, 0, lambda m, **o: transforms.ShapeComplexityScore(**o)(m)
    ),
    "transforms.ShapeComplexityScored": Entry(
        transforms.ShapeComplexityScored,
        MeasureOptions,
        1,
        lambda m, **o: {
            name.removeprefix("m_"): value
            for name, value in transforms.ShapeComplexityScored("m", **o)({"m": m}).items()
            if name != "m"
        },
    ),
    "labels.complexity_table": Entry(
        labels.complexity_table, MeasureOptions, 1, lambda m, **o: labels.complexity_table(m.int(), **o)
    ),
    "polygons.complexity_table": Entry(polygons.complexity_table, PolygonOptions, 1, outlined),
    "regions.decision_region_complexity": Entry(regions.decision_region_complexity, RegionOptions, 2, region_mean),
    "regions.decision_region_summary": Entry(
        regions.decision_region_summary, RegionOptions, 2, summary_mean, {"orientation": "mean"}
    ),
    "regions.decision_plane": Entry(regions.decision_plane, RegionOptions, 2, plane_mean),
    "regions.decision_plane_complexity": Entry(regions.decision_plane_complexity, PlaneOptions, 2, planes_mean),
    "decompose.parts": Entry(
        decompose.parts,
        WindowOptions,
        1,
        lambda m, **o: decompose.parts(m, spatial_ndim=2, penalty_per_part=9, **o).before,
    ),
    "plot.profile": Entry(plot.profile, ProfileOptions, 1, lambda m, **o: staircase(plot.profile(m, **o)), slow=True),
    "plot.shapes": Entry(
        plot.shapes, LevelOptions, 1, lambda m, **o: staircase(plot.shapes({"a": m}, **o).axes[0]), slow=True
    ),
    "plot.overview": Entry(
        plot.overview, GridOptions, 1, lambda m, **o: nothing(plot.overview({"a": m}, **o)), slow=True
    ),
    "plot.hasse": Entry(
        plot.hasse,
        ProfileOptions,
        1,
        lambda m, **o: nothing(plot.hasse({"a": m}, **o)),
        {"windows": order.WINDOWS},
        slow=True,
    ),
    "plot.complexity_map": Entry(
        plot.complexity_map, WindowOptions, 1, lambda m, **o: nothing(plot.complexity_map(m, **o)), slow=True
    ),
    "plot.levels": Entry(plot.levels, FieldOptions, 1, lambda m, **o: nothing(plot.levels(m, **o)), slow=True),
    "scoring.score_mask": Entry(
        scoring.score_mask, MeasureOptions, 1, lambda m, **o: scoring.score_mask(m.numpy(force=True), **o), SCORED
    ),
    "scoring.score_masks": Entry(scoring.score_masks, MeasureOptions, 1, scored, SCORED),
    "scoring.score_source": Entry(
        scoring.score_source,
        MeasureOptions,
        1,
        lambda m, **o: scoring.score_source(scoring.find_masks([file_of(m, FOLDER)])[0], **o).values,
        SCORED,
    ),
    "scoring.open_table": Entry(scoring.open_table, MeasureOptions, 1, in_table, SCORED),
    "scoring.ray.ScoreMasks": Entry(ScoreMasks, MeasureOptions, 1, on_ray, SCORED),
}
# Without a call: that needs a cluster of Ray, see `test_ray`.
SIGNATURES = {**ENTRIES, "scoring.ray.score_shards": Entry(score_shards, MeasureOptions, 2, nothing, SCORED)}
COMMANDS = ("score", "order", "profile")

# What each option is tried with; with all but the tolerances the number of the mask is another one.
VALID: Mapping[str, Any] = {
    "low": 0.5,
    "high": 0.25,
    "windows": {"fine": (0.0, 0.25), "complexity": (0.25, 1.0)},
    "bins": 8,
    "estimator": "std",
    "levels": "rim",
    "rho": 1.0,
    "tol": 1e-6,
    "tol_bits": 0.5,
    "orientation": 30.0,
    "rotations": 5,
    "per": "object",
    "connectivity": 1,
    "min_pixels": 3,
    "pool": "area",
}
# What an option must stand beside.
BESIDE: Mapping[str, Mapping[str, Any]] = {
    "rotations": {"orientation": "mean"},
    "connectivity": {"per": "object"},
    "min_pixels": {"per": "object"},
    "pool": {"per": "object"},
}
PARTS = ("orientation", "rotations", "per", "connectivity", "min_pixels", "pool")
INVALID: tuple[dict[str, Any], ...] = (
    {"low": 0.5, "high": 0.2},
    {"low": "0"},
    {"high": 2.0},
    {"windows": [(0.0, 0.25)]},
    {"windows": {}},
    {"windows": {"a": (0.5, 0.1)}},
    {"windows": {"a": 0.5}},
    {"bins": 0},
    {"bins": "8"},
    {"bins": 2**30},
    {"estimator": "mean"},
    {"estimator": 3},
    {"levels": "x"},
    {"levels": None},
    {"rho": -1},
    {"rho": "2"},
    {"tol": 0},
    {"tol": None},
    {"tol_bits": -1},
    {"tol_bits": "0"},
    {"orientation": "up"},
    {"orientation": True},
    {"orientation": math.inf},
    {"orientation": [[1, 0], [0, 1]]},
    {"orientation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]},
    {"rotations": 0},
    {"rotations": 3},
    {"per": "class"},
    {"per": None},
    {"connectivity": 0},
    {"connectivity": 5, "per": "object"},
    {"connectivity": 1},
    {"min_pixels": 0},
    {"min_pixels": 5},
    {"pool": "sum"},
    {"pool": "area"},
)
HOUSE = re.compile(r"^\w+( and \w+)* must .+; got .+\. (Pass|Leave|Scales|Name) ?.+\.$", re.S)


@pytest.fixture(autouse=True)
def _surroundings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setitem(globals(), "FOLDER", tmp_path)
    dtype = torch.get_default_dtype()
    yield
    torch.set_default_device(None)
    torch.set_default_dtype(dtype)
    plt.close("all")


@cache
def reference(options: str) -> float:
    """The complexity by `complexity_profile`, the one that all others have to give."""
    chosen = json.loads(options)
    window = [chosen.pop(name, default) for name, default in (("low", 0.0), ("high", 1.0))]
    return float(torchlinf.complexity_profile(MASK, spatial_ndim=2, **chosen).mean(*window))


def tried(name: str) -> dict[str, Any]:
    """An option, with what it must stand beside."""
    return {**BESIDE.get(name, {}), name: VALID[name]}


def number(found: Any, name: str = "complexity") -> float:
    if isinstance(found, Mapping):
        found = found[name]
    return float(found.mean() if isinstance(found, np.ndarray) else found)


def test_the_values_that_are_tried_change_the_number() -> None:
    default = reference("{}")
    for name in VALID:
        if name not in ("windows", "tol", "tol_bits"):
            found = reference(json.dumps(tried(name)))
            assert found != pytest.approx(default, abs=1e-3), name
            if name in BESIDE:
                assert found != pytest.approx(reference(json.dumps(BESIDE[name])), abs=1e-3), name


@pytest.mark.parametrize("name", SIGNATURES)
def test_options_have_the_names_the_order_the_defaults_and_the_words_of_the_measure(name: str) -> None:
    entry = SIGNATURES[name]
    parameters = inspect.signature(entry.target).parameters
    options = {field.name: field.default for field in dataclasses.fields(Measure)}
    taken = names_of(entry.kind)
    assert [one for one in parameters if one in taken] == list(taken)
    document = " ".join(inspect.getdoc(entry.target).split())
    for option in taken:
        assert parameters[option].kind is inspect.Parameter.KEYWORD_ONLY
        assert parameters[option].default == entry.changed.get(option, options[option])
        assert not entry.documented or " ".join(f"{option}: {_DOCS[option]}".split()) in document


@pytest.mark.parametrize("entry", SIGNATURES.values())
def test_only_data_are_positional(entry: Entry) -> None:
    code = inspect.unwrap(entry.target.__init__ if isinstance(entry.target, type) else entry.target).__code__
    assert code.co_argcount == entry.data + isinstance(entry.target, type)


@pytest.mark.parametrize("name", ENTRIES)
def test_every_entry_point_gives_the_number_of_the_profile(name: str) -> None:
    entry = ENTRIES[name]
    options: list[dict[str, Any]] = [{}, *map(tried, names_of(entry.kind))]
    for chosen in options[:: 4 if entry.slow else 1]:
        if "complexity_map" in name and "estimator" in chosen:
            with pytest.raises(ValueError, match='estimator must be "entropy" for a map; got'):
                entry.call(MASK, **chosen)
            continue
        found = entry.call(MASK, **chosen)
        plt.close("all")
        if "windows" in chosen and isinstance(found, Mapping):
            for window, (low, high) in chosen["windows"].items():
                expected = reference(json.dumps({"low": low, "high": high}))
                assert number(found, window) == pytest.approx(expected, rel=1e-6), window
        elif not isinstance(found, float) or not math.isnan(found):
            assert number(found) == pytest.approx(reference(json.dumps(chosen)), rel=1e-6), chosen


@pytest.mark.parametrize("name", ENTRIES)
def test_wrong_values_are_refused_everywhere_in_the_same_words(name: str) -> None:
    entry = ENTRIES[name]
    for wrong in INVALID:
        if not set(wrong) <= set(names_of(entry.kind)):
            continue
        with pytest.raises((TypeError, ValueError)) as expected:
            Measure(**wrong)
        with pytest.raises(expected.type) as found:
            entry.call(MASK, **wrong)
        assert str(found.value) == str(expected.value), wrong
        assert HOUSE.match(str(found.value)), str(found.value)


@pytest.mark.parametrize("name", ENTRIES)
def test_options_that_are_not_taken_are_refused(name: str) -> None:
    entry = ENTRIES[name]
    taken = {*names_of(entry.kind), *entry.changed}
    for option, value in {**VALID, "frame": "any"}.items():
        if option not in taken:
            # torchmetrics refuses what it does not know by a ValueError.
            with pytest.raises(ValueError if name.startswith("metrics") else TypeError, match=option):
                entry.call(MASK, **{option: value})


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_take_every_option(command: str) -> None:
    call = cli(command)
    names = [name for name in VALID if command != "profile" or name not in PARTS]
    for chosen in [{}, *map(tried, names)][:: 5 if command == "profile" else 1]:
        found = call(MASK, **chosen)
        if isinstance(found, Mapping) and "windows" not in chosen:
            assert found["complexity"] == pytest.approx(reference(json.dumps(chosen)), rel=1e-9), chosen
            measured = json.loads(found["measure"])
            assert all(measured[one] == value for one, value in chosen.items())


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_refuse_wrong_values_in_the_same_words(command: str) -> None:
    for wrong in INVALID:
        # Words that are no numbers, and windows that are no mapping, cannot be written on a command line.
        if any(value is None or isinstance(value, list | dict) for value in wrong.values()):
            continue
        texts = ("estimator", "levels", "per", "pool")
        if any(isinstance(value, str) and one not in (*texts, "orientation") for one, value in wrong.items()):
            continue
        if wrong == {"orientation": True} or (command == "profile" and set(wrong) & set(PARTS)):
            continue
        wrong = {one: str(value) if one in texts else value for one, value in wrong.items()}
        with pytest.raises((TypeError, ValueError)) as expected:
            Measure(**{k: float(v) if k in ("low", "high", "rho", "tol", "tol_bits") else v for k, v in wrong.items()})
        with pytest.raises(ValueError, match="Usage") as found:
            cli(command)(MASK, **wrong)
        words = " ".join(str(expected.value).split())
        assert words in " ".join(str(found.value).split()), (words, str(found.value))


@pytest.mark.parametrize("windows", [[(0.0, 0.25)], {}, {"a": (0.5, 0.1)}, {"a": 0.5}])
def test_orders_check_windows_as_the_measure_does(windows: Any) -> None:
    profiles = {"a": torchlinf.complexity_profile(MASK, spatial_ndim=2)}
    with pytest.raises((TypeError, ValueError)) as expected:
        Measure(windows=windows)
    for call in (order.dominance, lambda p, windows: plot.hasse({"a": MASK}, profiles=p, windows=windows)):
        with pytest.raises(expected.type) as found:
            call(profiles, windows=windows)
        assert str(found.value) == str(expected.value)


QUICK = [name for name, entry in ENTRIES.items() if not entry.slow]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64, torch.bfloat16])
def test_the_default_dtype_does_not_matter(dtype: torch.dtype) -> None:
    torch.set_default_dtype(dtype)
    for name in QUICK:
        found = ENTRIES[name].call(MASK)
        if not isinstance(found, float):
            assert number(found) == pytest.approx(reference("{}"), rel=1e-6), name


def test_the_default_device_does_not_matter() -> None:
    torch.set_default_device("meta")  # a tensor that is made there by mistake has no data, and fails
    for name in QUICK:
        found = ENTRIES[name].call(MASK)
        if not isinstance(found, float):
            assert number(found) == pytest.approx(reference("{}"), rel=1e-6), name
    for method in ("monotone", "accelerated", "batched"):
        rough = torchlinf.complexity_profile(MASK, spatial_ndim=2, method=method, scales=[0.5, 1.0], tol=1e-3)
        assert number(rough.mean()) == pytest.approx(reference("{}"), abs=float(rough.error_bound()) + 1e-9)
    assert shapes.add_noise(shapes.square(16), 2, 3).device.type == "cpu"
    assert shapes.band([(0, 0), (0, 5)], 3).device.type == "cpu"
    profile = torchlinf.complexity_profile(torch.stack([MASK, MASK]), spatial_ndim=2)
    assert profile[1].mean().device.type == "cpu"
    order.dominance({"a": profile[0], "b": profile[1]}, every_scale=True)
    order.kendall_tau([profile[0], profile[1]])


def test_a_profile_of_some_shapes() -> None:
    masks = torch.stack([MASK, EMPTY, torch.ones_like(MASK), MASK * (torch.arange(SIDE) > 4)])[:, None]
    rho = torch.tensor([[2.0], [3.0], [4.0], [5.0]])
    whole = torchlinf.complexity_profile(masks, rho=rho, levels="rim")
    chosen = torch.tensor([True, False, False, True])
    for index in (0, (3, 0), slice(1, 3), slice(1, 1), torch.tensor([3, 0, 0]), chosen, ..., None):
        some = whole[index]
        for name in ("values", "radius", "field_error_bound", "seconds"):
            assert torch.equal(getattr(some, name).nan_to_num(-1), getattr(whole, name)[index].nan_to_num(-1)), name
        for of in (lambda p: p.mean(0.1, 0.7), lambda p: p.error_bound(), lambda p: p.peak()[0], lambda p: p.peak()[1]):
            assert torch.equal(of(some).nan_to_num(-1), of(whole)[index].nan_to_num(-1))
        assert torch.equal(some.measure.rho, rho[index])
    assert torch.equal(whole[3, 0].levels(), whole.levels()[3][0])
    assert whole[1:1].radius.shape == (0, 1)
    assert [int(one.radius) for one in whole[:, 0]] == whole.radius[:, 0].tolist()
    with pytest.raises(IndexError, match=r"index must select from the leading shape \(4, 1\); got 7. Pass"):
        whole[7]
    assert order.dominance({"a": whole[0], "b": whole[3]}).number_of_nodes() == 2
    plot.profile(whole[3])


def rows_of(path: Path) -> dict[str, str]:
    """The rows of the table of empty shapes in the docs: the first cell and the second."""
    text = path.read_text(encoding="utf-8").partition("## Empty shapes")[2].partition("\n## ")[0]
    cells = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("| `")]
    return {first.strip(): second.strip() for first, second in cells}


def is_nan(found: Any) -> bool:
    return bool(torch.as_tensor(found).isnan().all())


def raising(call: Callable[[], Any]) -> Callable[[], bool]:
    def check() -> bool:
        with pytest.raises(ValueError, match=r"at least one pixel inside|a pixel inside; got an empty one"):
            call()
        return True

    return check


def profile_of_nothing() -> torchlinf.ComplexityProfile:
    return torchlinf.complexity_profile(EMPTY, spatial_ndim=2)


# What an empty mask gives: the entry point as the docs name it, a word of their row, and whether it is so.
EMPTIES: tuple[tuple[str, str, Callable[[], Any]], ...] = (
    ("linf_field", "zeros", lambda: not torchlinf.linf_field(EMPTY, spatial_ndim=2).any()),
    ("chessboard_distance", "zeros", lambda: not torchlinf.chessboard_distance(EMPTY, spatial_ndim=2).any()),
    (
        "solve_field",
        "EMPTY",
        lambda: torchlinf.solve_field(EMPTY, spatial_ndim=2).status == torchlinf.Status.EMPTY,
    ),
    ("complexity", "NaN", lambda: is_nan(torchlinf.complexity(EMPTY, spatial_ndim=2))),
    (
        "complexity_profile",
        "radius 0",
        lambda: (
            is_nan(profile_of_nothing().mean())
            and is_nan(profile_of_nothing().error_bound())
            and int(profile_of_nothing().radius) == 0
            and len(profile_of_nothing().levels()) == 0
        ),
    ),
    ("complexity_map", "NaN", lambda: is_nan(torchlinf.complexity_map(EMPTY, spatial_ndim=2))),
    ("soft_linf_field", "zeros", lambda: not torchlinf.soft_linf_field(EMPTY.double(), spatial_ndim=2).any()),
    ("soft_complexity", "0", lambda: torchlinf.soft_complexity(EMPTY.double(), spatial_ndim=2) == 0),
    (
        "losses.ShapeComplexityLoss",
        "largest",
        lambda: losses.ShapeComplexityLoss(bins=8)(EMPTY[None, None].float()) == 3,
    ),
    ("metrics.ShapeComplexity", "num_empty", lambda: metric(EMPTY, bins=8) == 3),
    ("transforms.ShapeComplexityScore", "NaN", lambda: is_nan(transforms.ShapeComplexityScore()(EMPTY))),
    (
        "labels.complexity_table",
        "no row",
        lambda: {len(column) for column in labels.complexity_table(EMPTY.int()).values()} == {0},
    ),
    (
        "regions.decision_region_complexity",
        "NaN",
        lambda: is_nan(regions_of(EMPTY).mean()[1]) and regions_of(EMPTY).num_empty == 1,
    ),
    ("order.dominance", "an error", raising(lambda: order.dominance({"a": profile_of_nothing()}))),
    ("order.kendall_tau", "an error", raising(lambda: order.kendall_tau([profile_of_nothing()] * 2))),
    ("decompose.parts", "no parts", lambda: int(decompose.parts(EMPTY, spatial_ndim=2).num_parts) == 0),
    ("plot", "an error", raising(lambda: plot.overview({"a": EMPTY}))),
    ("plot", "an error", raising(lambda: plot.profile(EMPTY))),
    ("plot", "an error", raising(lambda: plot.hasse({"a": EMPTY}))),
    (
        "torchlinf score",
        "error",
        lambda: (
            scoring.score_mask(EMPTY.numpy())["complexity"] is None
            and "no foreground" in scoring.score_mask(EMPTY.numpy())["error"]
        ),
    ),
)


@pytest.mark.parametrize(("name", "word", "check"), EMPTIES)
def test_an_empty_mask_gives_what_the_docs_say(name: str, word: str, check: Callable[[], Any]) -> None:
    rows = rows_of(Path(torchlinf.__file__).parents[1] / "docs" / "limitations.md")
    (said,) = [text for names, text in rows.items() if f"`{name}`" in names]
    assert word in said
    assert check()


def test_infinity_is_written_as_json_knows_it() -> None:
    settings = json.loads(Measure(tol_bits=math.inf).settings(), parse_constant=lambda text: pytest.fail(text))
    assert Measure(tol_bits=float(settings["tol_bits"])) == Measure(tol_bits=math.inf)
