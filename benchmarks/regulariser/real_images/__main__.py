"""Run the study: `python -m benchmarks.regulariser.real_images [--sets ...] [--seeds 3] [--report]`.

Needs the folders TORCHLINF_BUILDINGS and TORCHLINF_FACADES. What is measured is kept in the folder `results` beside
this file, and not measured again; networks and their predictions are kept in `--states`. The tables go to the
documentation.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.regulariser.real_images.afterwards import simplified
from benchmarks.regulariser.real_images.data import VARIABLES, load
from benchmarks.regulariser.real_images.measures import measured
from benchmarks.regulariser.real_images.methods import BOTH, PLAIN, TRUTH, afterwards, terms
from benchmarks.regulariser.real_images.tables import Found, draw, tables
from benchmarks.regulariser.real_images.training import State, first_run, logits_of, second_run
from benchmarks.results import markdown

HERE = Path(__file__).parent
DOCS = Path(__file__).parents[3] / "docs"
PARTS = ("choose", "held-out")
CHOSEN_WITH = 0  # the seed with which weights are chosen


class Study:
    """One set and seed: what is measured of it, and where that is kept."""

    def __init__(self, name: str, seed: int, states: Path, results: Path) -> None:
        self._name, self._seed, self._states = name, seed, states
        self._results = results / f"{name}_{seed}.json"
        self._done = _read(self._results)
        self._data = {part: load(name, part) for part in ("train", *PARTS)}

    def run(self) -> None:
        """Measure what is missing."""
        done = self._done
        if TRUTH not in done:
            self._keep(TRUTH, {part: self._data[part].masks > 0 for part in PARTS})
        for method in terms():
            logits = self._logits(method)
            if method not in done:
                self._keep(method, {part: z > 0 for part, z in logits.items()})
        plain = self._logits(PLAIN)
        if self._seed != CHOSEN_WITH:
            plain = {"held-out": plain["held-out"]}
        for method, change in afterwards(self._name).items():
            if method not in done:
                self._keep(method, {part: change(z) for part, z in plain.items()})
        method, weight = BOTH
        title = f"{method}, then simplify {weight:g}"
        if title not in done:
            self._keep(title, {"held-out": simplified(self._logits(method)["held-out"], weight)})

    def _logits(self, method: str) -> dict[str, Tensor]:
        """Predictions of the network that this method trained."""
        file = self._file(f"logits of {method}")
        if not file.exists():
            network = second_run(self._name, self._data["train"], self._seed, self._start(), terms()[method])
            torch.save({part: logits_of(network, self._data[part].images) for part in PARTS}, file)
        return torch.load(file)

    def _start(self) -> State:
        file = self._file("first run")
        if not file.exists():
            torch.save(first_run(self._name, self._data["train"], self._seed).state_dict(), file)
        return torch.load(file)

    def _file(self, what: str) -> Path:
        return self._states / f"{self._name} {self._seed} {what}.pt"

    def _keep(self, method: str, masks: dict[str, Tensor]) -> None:
        began = time.process_time()
        values: dict[str, Any] = {part: measured(found, self._data[part].masks > 0) for part, found in masks.items()}
        if "choose" in values:
            values["choose"] = {key: round(float(np.nanmean(found)), 5) for key, found in values["choose"].items()}
        self._done[method] = values
        self._results.write_text(json.dumps(self._done, separators=(",", ":")) + "\n", encoding="utf-8")
        print(
            f"{self._name} {self._seed} {method}, {values.get('choose', '')} ({time.process_time() - began:.0f} s)",
            flush=True,
        )


def main(arguments: list[str] | None = None) -> None:
    """Measure what is missing, and write the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.regulariser.real_images", description=__doc__)
    parser.add_argument("--sets", nargs="*", choices=VARIABLES, default=list(VARIABLES))
    parser.add_argument("--seeds", nargs="*", type=int, default=[0, 1, 2])
    parser.add_argument("--report", action="store_true", help="measure nothing")
    parser.add_argument("--results", type=Path, default=HERE / "results")
    parser.add_argument("--states", type=Path, default=Path("build/real_images"))
    parser.add_argument("--out", type=Path, default=DOCS)
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    for folder in (options.states, options.results):
        folder.mkdir(parents=True, exist_ok=True)
    for seed in () if options.report else options.seeds:
        for name in options.sets:
            Study(name, seed, options.states, options.results).run()
    stored = {
        name: {path.stem.split("_")[1]: _read(path) for path in sorted(options.results.glob(f"{name}_*.json"))}
        for name in options.sets
    }
    text = "\n".join(map(markdown, tables(stored)))
    print(text)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "regulariser_tables.inc").write_text(text, encoding="utf-8")
    draw(stored, options.out / "images" / "regulariser_curves.png")


def _read(path: Path) -> Found:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


if __name__ == "__main__":
    main()
