"""Run the study: `python -m benchmarks.regions_study [--anew] [--report]`.

What is measured is kept in `results.json` beside this file, one run a data set and seed, and not measured again. The
tables go to the documentation.
"""

import argparse
import json
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from benchmarks.regions_study.classifiers import classifiers
from benchmarks.regions_study.data import VIEWS, split
from benchmarks.regions_study.measures import measured
from benchmarks.regions_study.tables import Runs, tables
from benchmarks.results import markdown

RESULTS = Path(__file__).parent / "results.json"
DOCS = Path(__file__).parents[2] / "docs"
FILE = "regions_study_tables.inc"
DIGITS = 5


def main(arguments: list[str] | None = None) -> None:
    """Measure what is missing, and write the tables."""
    options = _parser().parse_args(arguments)
    stored: dict[str, Any] = {} if options.anew else _read(options.results)
    for name in () if options.report else options.only or VIEWS:
        for seed in range(options.seeds):
            if str(seed) in stored.setdefault(name, described(name)):
                continue
            began = time.process_time()
            stored[name][str(seed)] = run(name, seed, options.resolution)
            print(f"{name}, seed {seed}: {time.process_time() - began:.1f} s of processor time", flush=True)
            options.results.write_text(json.dumps(stored, separators=(",", ":")) + "\n", encoding="utf-8")
    text = "\n".join(map(markdown, tables(as_runs(stored), stored)))
    print(text)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / FILE).write_text(text, encoding="utf-8")


def described(name: str) -> dict[str, Any]:
    """How large a set is."""
    X, y = VIEWS[name].load()
    return {"samples": len(X), "classes": len(np.unique(y))}


def run(name: str, seed: int, resolution: int) -> dict[str, list[Any]]:
    """The numbers of every classifier on one split of a set: a list for each of them, in the order of "classifier"."""
    halves = split(VIEWS[name], seed)
    columns: dict[str, list[Any]] = {"classifier": []}
    for title, classifier in classifiers(seed).items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a network that stops early is a classifier too
            classifier.fit(halves.train, halves.train_classes)
        columns["classifier"].append(title)
        for what, value in measured(classifier, halves, resolution, seed).items():
            columns.setdefault(what, []).append(round(value, DIGITS))
    return columns


def as_runs(stored: dict[str, Any]) -> Runs:
    """By data set, one entry a seed, with the test error beside the accuracies."""
    return {
        name: [
            {**columns, "error": [1 - value for value in columns["test"]]}
            for key, columns in stored[name].items()
            if key.isdecimal()
        ]
        for name in VIEWS
        if name in stored
    }


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.regions_study", description=__doc__)
    parser.add_argument("--anew", action="store_true", help="measure everything again")
    parser.add_argument("--report", action="store_true", help="measure nothing: write the tables from what is kept")
    parser.add_argument("--only", action="append", choices=VIEWS, metavar="NAME", help="a data set; several times")
    parser.add_argument("--seeds", type=int, default=5, help="splits of every set, two or more")
    parser.add_argument("--resolution", type=int, default=128, help="points along each side of the grid")
    parser.add_argument("--results", type=Path, default=RESULTS, help="file of what was measured")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder for the tables")
    return parser


if __name__ == "__main__":
    main()
