"""The plots of the performance page."""

from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.results import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LABELS = {
    "pooling": "(c) explicit, max_pool2d",
    "vectorised": "(a) explicit, whole arrays",
    "compiled": "(a) explicit, compiled",
    "plain": "(b) sparse LU (hollow: stopped)",
    "mixed": "(b') sparse LU and D/2 sweeps",
}
# Told apart by people who see fewer colours too, and in grey by their markers.
COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00"]
MARKERS = ["o", "s", "^", "D", "v"]


def draw(results: list[Result], folder: Path) -> list[Path]:
    """Draw what there are results for; the files written."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    folder.mkdir(parents=True, exist_ok=True)
    panels = {"field": _speed, "growth": _growth, "work": _work}
    paths = []
    with mpl.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        for result in results:
            if result.name in panels:
                figure = Figure(figsize=(7.2, 3.8), layout="constrained", dpi=150)
                panels[result.name](figure.add_subplot(), result)
                paths.append(folder / f"performance_{result.name}.png")
                figure.savefig(paths[-1], metadata={"Software": None})
    return paths


def _speed(axes: "Axes", result: Result) -> None:
    names, ratios, ended = (result.series[key] for key in ("names", "ratios", "converged"))
    for i, (key, label) in enumerate(LABELS.items()):
        axes.plot(names, ratios[key], MARKERS[i], color=COLOURS[i], label=label, markersize=6)
    stopped = [(name, value) for name, value, end in zip(names, ratios["plain"], ended, strict=True) if not end]
    if stopped:
        axes.plot(*zip(*stopped, strict=True), MARKERS[3], color="white", markersize=3)
    axes.axhline(1, color="0.3", linewidth=1)
    axes.text(0.01, 1.1, "torchlinf", transform=axes.get_yaxis_transform(), color="0.3")
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.7)
    axes.set_ylabel("times as long as torchlinf")
    axes.set_title("The certified field of real silhouettes, one core", loc="left")
    axes.tick_params("x", rotation=30)
    axes.grid(axis="y", alpha=0.3)
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", frameon=False)


def _growth(axes: "Axes", result: Result) -> None:
    for i, curve in enumerate(result.series["curves"]):
        ours = curve["exponent"] is not None
        exponent = f", exponent {curve['exponent']:.2f}" if ours else ""
        milliseconds = [1e3 * seconds for seconds in curve["seconds"]]
        marker, colour, style = MARKERS[i % 5], COLOURS[i % 5], "-" if ours else "--"
        axes.plot(curve["pixels"], milliseconds, style, marker=marker, color=colour, label=curve["label"] + exponent)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("inside pixels")
    axes.set_ylabel("milliseconds")
    axes.set_title("One silhouette at 1, 2, 4 ... times the side, one core", loc="left")
    axes.grid(alpha=0.3)
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", frameon=False)


def _work(axes: "Axes", result: Result) -> None:
    series = result.series
    real = series["real"]
    parts = {"real silhouettes": slice(0, real), "shapes of the method page": slice(real, None)}
    for i, (label, part) in enumerate(parts.items()):
        radius, equivalent = series["radius"][part], series["equivalent"][part]
        axes.plot(radius, equivalent, MARKERS[i], color=COLOURS[i], label=label)
    most = max(series["radius"])
    axes.plot([0, most], [0, 4 * most], color="0.3", linewidth=1, label="4 D (target)")
    axes.axhline(40, color="0.3", linewidth=1, linestyle="--", label="40 (aim)")
    axes.set_ylim(0, 1.15 * max(*series["equivalent"], 60))
    axes.set_xlim(0, 1.05 * most)
    axes.set_xlabel("radius D, pixels")
    axes.set_ylabel("time of the solve in full sweeps")
    axes.set_title("Work of a certified solve", loc="left")
    axes.grid(alpha=0.3)
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", frameon=False)
