"""Simpler outlines: `torchlinf.polygons.simplify` beside buildingregulariser 0.2.5, on what a model has found in Perth.

Run `TORCHLINF_FOOTPRINTS=folder python -m benchmarks.outlines`; it prints a table in Markdown. There is no truth for
these outlines: it says how far each method goes from the model's outline, and how simple what it makes is.
"""

import argparse
import os
import time
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import shapely
import torch

from torchlinf.polygons import complexity_table, simplify

RAW, REGULARISED = "perth_predicted_raw_1296.gpkg", "perth_buildingregulariser_out.gpkg"
RESOLUTION = 0.5  # metres; the pixels of the model have 1 m
WEIGHTS = (3.0, 10.0, 30.0)
NOTHING_ELSE = 1e9  # a weight at which no flip pays
TOLERANCE = 0.85  # metres, for straight walls
SHORT = 1.0  # metres: a side of the model's stairs
STRAIGHT = 0.75  # metres: the stairs of a diagonal are no higher than 0.71 m
NOTCH = 4.0  # square metres, from which on a part of the hull outside of the outline is a notch


def rows(raw: Any, simpler: Any) -> dict[str, float]:
    """How simple outlines are, and how far from those they were made of."""
    measured = complexity_table(simpler, resolution=RESOLUTION, orientation="own")
    sides = [np.hypot(*np.diff(shapely.get_coordinates(ring), axis=0).T) for ring in shapely.get_rings(simpler)]
    common, both = shapely.area(shapely.intersection(raw, simpler)), shapely.area(shapely.union(raw, simpler))
    distance = shapely.hausdorff_distance(raw, simpler)
    notches, owner = shapely.get_parts(shapely.difference(shapely.convex_hull(raw), raw), return_index=True)
    owner, notches = owner[shapely.area(notches) >= NOTCH], notches[shapely.area(notches) >= NOTCH]
    filled = shapely.area(shapely.intersection(notches, simpler[owner])) > shapely.area(notches) / 2
    tree = shapely.STRtree(simpler)
    first, second = tree.query(simpler, predicate="overlaps")
    return {
        "complexity, bits": float(np.nanmean(measured["complexity"])),
        "corners": float(np.mean([sum(map(len, sides)) / len(simpler)])),
        "sides of at most 1 m, %": float(np.mean(np.concatenate(sides) <= SHORT + 1e-6)) * 100,
        "IoU with the raw outline": float(np.mean(common / both)),
        "least IoU": float(np.min(common / both)),
        "area, %": float(np.mean(shapely.area(simpler) / shapely.area(raw) - 1)) * 100,
        "Hausdorff distance, m": float(np.mean(distance)),
        "notches filled, %": float(np.mean(filled)) * 100,
        "overlapping pairs": float((first < second).sum()),
        "not one valid polygon": float((~shapely.is_valid(simpler) | (shapely.get_type_id(simpler) != 3)).sum()),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.outlines", description=__doc__)
    parser.add_argument("--every", type=int, default=1, metavar="N", help="take every Nth outline alone")
    every = parser.parse_args().every
    torch.set_num_threads(1)
    folder = Path(os.environ["TORCHLINF_FOOTPRINTS"])
    raw, regularised = (
        np.asarray(geopandas.read_file(folder / name, engine="pyogrio").geometry, dtype=object)[::every]
        for name in (RAW, REGULARISED)
    )
    simplify(raw[:2], resolution=RESOLUTION, straighten=TOLERANCE)  # compiles
    found = {"raw": (rows(raw, raw), float("nan")), "buildingregulariser": (rows(raw, regularised), float("nan"))}
    straight = shapely.simplify(raw, STRAIGHT)
    for tolerance in (STRAIGHT, 1.0):
        found[f"Douglas-Peucker, {tolerance:g} m"] = rows(raw, shapely.simplify(raw, tolerance)), float("nan")
    for given, name, tolerance, weights in (
        (raw, "simplify", None, WEIGHTS),
        (straight, f"Douglas-Peucker, {STRAIGHT:g} m, and simplify", None, WEIGHTS),
        (raw, f"simplify, straighten={TOLERANCE:g}", TOLERANCE, (*WEIGHTS, NOTHING_ELSE)),
    ):
        for weight in weights:
            start = time.process_time()
            table = simplify(given, resolution=RESOLUTION, weight=weight, straighten=tolerance)
            seconds = time.process_time() - start
            assert not any(error is not None for error in table["error"])
            found[f"{name}, weight {weight:g}"] = rows(raw, table["geometry"]), 1000 * seconds / len(raw)
    names = list(found["raw"][0])
    print(f"{len(raw)} outlines, drawn with pixels of {RESOLUTION:g} m\n")
    print(f"| outlines | {' | '.join(names)} | ms an outline |\n|---|{'---|' * (len(names) + 1)}")
    for name, (values, took) in found.items():
        print(f"| {name} | {' | '.join(f'{value:.3g}' for value in values.values())} | {took:.3g} |")


if __name__ == "__main__":
    main()
