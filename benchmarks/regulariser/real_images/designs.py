"""Compare designs of a term in training: `python -m benchmarks.regulariser.real_images.designs [--states ...]`.

Each goes on from the first run of the study, as its second run does. With the first seed all are measured on training
images ("seen") and on the images to choose on; with all seeds those in FINAL, on held-out images. Then it is measured
why a pull carries over to other images or not. Needs the folders of the study. What is measured is kept in
`results/designs`, and not measured again.
"""

import argparse
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.regulariser.real_images import training
from benchmarks.regulariser.real_images.afterwards import simplified
from benchmarks.regulariser.real_images.carrying import FEW, Numbers, carried
from benchmarks.regulariser.real_images.data import VARIABLES, Images, load
from benchmarks.regulariser.real_images.measures import measured
from benchmarks.regulariser.real_images.methods import PLAIN, TRUTH
from benchmarks.regulariser.real_images.network import UNet
from benchmarks.regulariser.real_images.pulls import Design, anew, instead, loss, train, with_first
from benchmarks.regulariser.real_images.tables import AIM, Runs, difference, methods_of, of_seeds
from benchmarks.regulariser.real_images.training import State, first_run, logits_of
from benchmarks.results import Cell, Table, markdown

HERE = Path(__file__).parent
DOCS = Path(__file__).parents[3] / "docs"
SEEN = 6  # of the images to train on each sixth is measured
AFTERWARDS = 30.0  # weight of `simplify` afterwards
GRID = "mask, grid"
KEPT = ("IoU", AIM, GRID, "objects")
SIMPLER = ", simplified"
TARGETS = "simplified predictions of the first network"
ABSOLUTE = (TRUTH, PLAIN, TARGETS)  # no differences
CARRYING = "carrying over"  # kept beside the designs

DESIGNS = {
    PLAIN: Design(),
    "no second run": Design(times=0),
    "simplified predictions in place of the truth": Design(instead, alone=True),
    "averaged network": Design(partial(anew, averaged=True), share=3.0, every=5),
    "averaged network, price falling, area kept": Design(
        partial(anew, averaged=True, falling=True), share=3.0, every=5, keep_area=True
    ),
    "loss, by doubt, warm-up": Design(partial(loss, by_doubt=True), share=3.0, every=3, warm=True),
}
FINAL = ("averaged network",)


class Comparison:
    """One set and seed: what is measured of it, and where that is kept."""

    def __init__(self, name: str, seed: int, states: Path, results: Path) -> None:
        self._name, self._seed, self._states = name, seed, states
        self._results = results / f"{name}_{seed}.json"
        self._done = _read(self._results)
        self._train = load(name, "train")

    def run(self, choosing: bool) -> None:
        """Measure what is missing: all designs where the best is chosen, else the final ones."""
        seen = Images(self._train.images[::SEEN], self._train.masks[::SEEN])
        parts = {"seen": seen, "choose": load(self._name, "choose")} if choosing else {}
        final = parts | {"held-out": load(self._name, "held-out")}
        for title in (TRUTH, *(DESIGNS if choosing else (PLAIN, *FINAL))):
            mine = final if title in (TRUTH, PLAIN, *FINAL) else parts
            missing = {part: images for part, images in mine.items() if part not in self._done.get(title, ())}
            if missing:
                self._keep(title, self._done.get(title, {}) | self._measured(title, missing))
        if choosing and TARGETS not in self._done:
            targets = self._with_targets().masks[::SEEN, 1:2] > 0
            self._keep(TARGETS, {"seen": measured(targets, seen.masks > 0, KEPT)})
        if choosing and CARRYING not in self._done:
            self._keep(CARRYING, carried(self._network(self._start()), parts["seen"], parts["choose"]))

    def _measured(self, title: str, parts: dict[str, Images]) -> dict[str, dict[str, list[float]]]:
        """Of every part the predictions, and held-out ones once more, simplified."""
        truth = {part: images.masks > 0 for part, images in parts.items()}
        masks = dict(truth)
        if title != TRUTH:
            logits = self._logits(title, parts)
            masks = {part: z > 0 for part, z in logits.items()}
            if "held-out" in logits:
                masks["held-out" + SIMPLER] = simplified(logits["held-out"], AFTERWARDS)
        return {part: measured(mask, truth[part.removesuffix(SIMPLER)], KEPT) for part, mask in masks.items()}

    def _keep(self, title: str, values: dict[str, Any]) -> None:
        self._done[title] = values
        self._results.write_text(json.dumps(self._done, separators=(",", ":")) + "\n", encoding="utf-8")
        print(f"{self._name} {self._seed} {title}", flush=True)

    def _logits(self, title: str, parts: dict[str, Images]) -> dict[str, Tensor]:
        """Predictions of the network that this design trained."""
        network = self._network(self._state(f"design {title}", lambda: self._trained(DESIGNS[title])))
        return {part: logits_of(network, images.images) for part, images in parts.items()}

    def _trained(self, design: Design) -> State:
        steps = training.MORE_STEPS * design.times
        return train(self._name, self._with_targets(), self._seed, self._start(), design, steps).state_dict()

    def _with_targets(self) -> Images:
        return Images(self._train.images, self._state("first targets", self._first_targets))

    def _first_targets(self) -> Tensor:
        return with_first(self._train, self._network(self._start())).masks

    def _start(self) -> State:
        return self._state("first run", lambda: first_run(self._name, self._train, self._seed).state_dict())

    def _network(self, state: State) -> UNet:
        network = UNet(self._name).to(memory_format=torch.channels_last)
        network.load_state_dict(state)
        return network

    def _state(self, what: str, make: Callable[[], Any]) -> Any:
        file = self._states / f"{self._name} {self._seed} {what}.pt"
        if not file.exists():
            torch.save(make(), file)
        return torch.load(file)


def tables(name: str, runs: Runs) -> list[Table]:
    """Where the best is chosen, on held-out images, and what carries over."""
    found = [_choosing(name, runs), _final(name, runs)]
    kept = [run[CARRYING] for run in runs.values() if CARRYING in run]
    return [table for table in found if table.rows] + [table for each in kept for table in _carrying(name, each)]


def _choosing(name: str, runs: Runs) -> Table:
    columns = ["", "IoU", "object", "mask", "seen: IoU", "seen: object", "seen: mask"]
    places = [(part, each) for part in ("choose", "seen") for each in ("IoU", AIM, GRID)]
    chosen = {seed: run for seed, run in runs.items() if "seen" in run.get(PLAIN, ())}
    return Table(
        f"{name.capitalize()}: designs",
        columns,
        _rows(chosen, places),
        "Means of the truth, of no term and of the first network's simplified predictions; for all others differences "
        "from no term ± standard error over the images. The first three columns are of the images to choose on, the "
        "others of images to train on. Complexity of objects is in their own frames, that of masks on the grid, in "
        "bits.",
    )


def _final(name: str, runs: Runs) -> Table:
    places = [("held-out", each) for each in ("IoU", AIM, GRID)]
    places += [("held-out" + SIMPLER, each) for each in ("IoU", AIM, GRID)]
    columns = ["", "IoU", "object", "mask", "simplified: IoU", "simplified: object", "simplified: mask"]
    return Table(
        f"{name.capitalize()}: held out",
        columns,
        _rows(runs, places),
        "As above, the mean of all seeds. `Simplified` is by `simplify`, weight 30.",
    )


def _rows(runs: Runs, places: list[tuple[str, str]]) -> list[list[Cell]]:
    rows: list[list[Cell]] = []
    for title in sorted(methods_of(runs), key=lambda title: title not in ABSOLUTE):
        if title == CARRYING:
            continue
        row: list[Cell] = [title]
        for part, measure in places:
            digits = 4 if measure == "IoU" else 2
            values = of_seeds(runs, title, measure, part)
            if not values.size:
                row.append(None)
            elif title in ABSOLUTE:
                row.append(f"{np.nanmean(values):.{digits}f}")
            else:
                value, error = difference(runs, title, PLAIN, measure, part)
                row.append(f"{value:+.{digits}f} ± {error:.{digits}f}")
        if any(cell is not None for cell in row[1:]):
            rows.append(row)
    return rows


def _carrying(name: str, kept: dict[str, Numbers]) -> list[Table]:
    return [
        Table(
            f"{name.capitalize()}: flips of simplified predictions",
            ["images, weight", "of the objects' pixels", "removed", "right by the truth", "right by the network"],
            [[row, *(f"{share:.1%}" for share in each.values())] for row, each in kept["flips"].items()],
            "Before the second run. `Right by the network` is what its probabilities lead to expect.",
        ),
        Table(
            f"{name.capitalize()}: gradients in the parameters",
            ["", "pairs of images", "seen and other images", "with the area", "with the data term"],
            [[row, *(f"{value:.3f}" for value in each.values())] for row, each in kept["gradients"].items()],
            f"Cosines of the gradients of {FEW} seen images: with each other, of their mean with the mean of as many "
            "other images, with the mean gradient of the area, and with that of the data term.",
        ),
    ]


def main(arguments: list[str] | None = None) -> None:
    """Measure what is missing, and write the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.regulariser.real_images.designs", description=__doc__)
    parser.add_argument("--sets", nargs="*", choices=VARIABLES, default=["facades"])
    parser.add_argument("--seeds", nargs="*", type=int, default=[0, 1, 2], help="the best is chosen with the first")
    parser.add_argument("--report", action="store_true", help="measure nothing")
    parser.add_argument("--results", type=Path, default=HERE / "results" / "designs")
    parser.add_argument("--states", type=Path, default=Path("build/real_images"))
    parser.add_argument("--out", type=Path, default=DOCS)
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    for folder in (options.states, options.results, options.out):
        folder.mkdir(parents=True, exist_ok=True)
    for seed in () if options.report else options.seeds:
        for name in options.sets:
            Comparison(name, seed, options.states, options.results).run(seed == options.seeds[0])
    text = []
    for name in options.sets:
        files = sorted(options.results.glob(f"{name}_*.json"))
        text += tables(name, {path.stem.split("_")[1]: _read(path) for path in files})
    written = "\n".join(map(markdown, text))
    print(written)
    (options.out / "regulariser_designs.inc").write_text(written, encoding="utf-8")


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


if __name__ == "__main__":
    main()
