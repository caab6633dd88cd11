"""`torchlinf simplify`: simpler masks, and simpler outlines, in files of the same kind."""

from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torchlinf.cli.inputs import by_source, find_sources, reading_options
from torchlinf.cli.measure_options import PARTS, parse_orientation, takes_measure
from torchlinf.cli.options import Ignore, Invert, Label, Labels, MaxPixels, Overwrite, Paths, Workers
from torchlinf.cli.outputs import STATUS, end_if_failed, endings, say
from torchlinf.cli.progress import cores, progress
from torchlinf.cli.score_geodata import Crs, Layer, PixelsPerRadius, Repair, Resolution
from torchlinf.cli.simplify_geodata import simplify_geodata
from torchlinf.scoring import JOURNAL, MAX_PIXELS, Source

if TYPE_CHECKING:
    from torchlinf.measure import Measure

TABLE = "simplified.csv"  # of a folder of simplified masks
EPILOG = f"""Masks are PNG, BMP, TIFF (one page) or .npy; other files give a row with an error. Arrays of probabilities
are priced by their log-odds, and become arrays of 0 and 1; of a mask each pixel that is changed costs 1. Of a label map
the pixels that are lost become 0, and only pixels of 0 are gained. Pixels that --ignore names are never changed.

{STATUS}"""


@takes_measure(None, without=(*PARTS, "windows"))
def simplify(
    paths: Paths,
    *,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="FOLDER", help="Write the masks here; of outlines the file to write."),
    ],
    weight: Annotated[
        float | None,
        typer.Option(
            "--weight",
            metavar="W",
            show_default="30; 10 for outlines",
            help="Price of log-odds (pixels) a share of the area, in bits.",
        ),
    ] = None,
    max_flips: Annotated[int, typer.Option(min=1, metavar="N", help="Flips that a shape may have.")] = 256,
    tries: Annotated[
        int, typer.Option(min=1, metavar="N", help="Regions tried in vain, one after another, for an end.")
    ] = 32,
    max_change: Annotated[
        float, typer.Option(metavar="SHARE", help="Share of the area of a shape that may be changed.")
    ] = 0.5,
    keep_topology: Annotated[
        bool,
        typer.Option("--keep-topology/--any-topology", help="Keep all components and holes, and make no others."),
    ] = True,
    per: Annotated[
        str | None,
        typer.Option(
            "--per",
            metavar="object|mask",
            show_default="object",
            help="Simplify each component alone, or all together.",
        ),
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option("--threshold", "-t", metavar="T", help="Inside is what is greater, in the file's own units."),
    ] = None,
    probability: Annotated[
        bool,
        typer.Option("--probability", help="Grey images of 8 or 16 bits are probabilities, white is 1; arrays too."),
    ] = False,
    label: Label = None,
    labels: Labels = False,
    ignore: Ignore = None,
    invert: Invert = False,
    orientation: Annotated[
        str | None,
        typer.Option(
            "--orientation",
            metavar="own|grid|DEGREES",
            show_default="the grid; own for outlines",
            help="The axes that a shape is simplified along.",
        ),
    ] = None,
    resolution: Resolution = None,
    pixels_per_radius: PixelsPerRadius = None,
    straighten: Annotated[
        float | None,
        typer.Option(
            metavar="LENGTH",
            help="Of outlines: make walls of the stairs of pixels, so near to the outline; 0.85 pixels do for stairs.",
        ),
    ] = None,
    layer: Layer = None,
    crs: Crs = None,
    repair: Repair = False,
    overwrite: Overwrite = False,
    workers: Workers = None,
    max_pixels: MaxPixels = MAX_PIXELS,
    measure: "Measure",
) -> None:
    """Make masks simpler: flip regions as long as that lowers the complexity by more than its price.

    The masks are written into a folder, under their own names and in their own format, with a table, simplified.csv, of
    what was changed. Stopped and started again, the same command goes on where it was. An empty mask is written as it
    is. Files of others in the folder are written over with --overwrite alone.

    Outlines in one .gpkg, .geojson, .shp or .parquet file are drawn at --resolution, each in its own frame, and written
    to a file of these kinds with their attributes. Sides that are not changed keep their corners. The file is written
    at the end, in one piece: stopped before, nothing is written, and the same command begins anew.
    """
    from torchlinf.scoring import is_geodata

    rule: dict[str, Any] = measure.options()
    rule |= {"max_flips": max_flips, "tries": tries, "max_change": max_change, "keep_topology": keep_topology}
    if orientation is not None:
        rule["orientation"] = None if orientation == "grid" else parse_orientation(orientation)
    drawing = {
        "resolution": resolution, "pixels_per_radius": pixels_per_radius, "straighten": straighten, "layer": layer,
        "crs": crs, "repair": repair,
    }  # fmt: skip
    outlines = [path for path in paths if is_geodata(path)]
    if outlines:
        of_masks = {
            "threshold": threshold, "label": label, "labels": labels, "ignore": ignore, "invert": invert,
            "probability": probability, "per": per,
        }  # fmt: skip
        _refuse(of_masks, "is not for outlines")
        rule["weight"] = 10.0 if weight is None else weight
        if len(paths) > 1:
            raise typer.BadParameter(f"one file of outlines must be given; got {len(paths)} paths")
        simplify_geodata(
            paths[0], out, rule, drawing, overwrite=overwrite, max_pixels=max_pixels, workers=workers or cores()
        )
        return
    _refuse(drawing, "is for files of outlines; got masks")
    rule |= {"weight": 30.0 if weight is None else weight, "per": per or "object"}
    from torchlinf.scoring import Reading, Simplifying, open_simplified, simplify_groups

    with reading_options():
        reading = Reading(threshold, label, False, ignore or (), invert, max_pixels, labels=labels)
        _check(rule)
    options = Simplifying(reading, probability, rule)
    if out.exists() and not out.is_dir():
        raise typer.BadParameter(f"{out} is not a folder", param_hint="--out")
    table = out / TABLE
    with endings(table):
        sources = find_sources(paths)
        targets = _targets(paths, sources, out)
        if not (overwrite or table.exists() or Path(f"{table}{JOURNAL}").exists()):
            _refuse_others(targets)
        out.mkdir(parents=True, exist_ok=True)
        with open_simplified(table, options, overwrite=overwrite) as (held, put):
            earlier = by_source(held, {source.name for source in sources})
            done = {
                source.name
                for source, target in zip(sources, targets, strict=True)
                if source.name in earlier
                and all(held[path].error is None for path in earlier[source.name])
                and target.exists()
            }
            new = [(source, target) for source, target in zip(sources, targets, strict=True) if source.name not in done]
            if before := len(sources) - len(new):
                say(f"{before} of {len(sources)} masks are in {table} already.")
            failed = 0
            groups = simplify_groups(new, options, workers=workers or cores())
            with closing(groups), progress(before, len(sources), True, "simplifying") as advance:
                for (source, _), rows in zip(new, groups, strict=True):
                    put(*rows, instead_of=sorted({*earlier.get(source.name, ())} - {row.path for row in rows}))
                    failed += any(row.error is not None for row in rows)
                    advance()
    end_if_failed(failed, len(sources), f" It is {table}; the same command tries them again.")


def _refuse(options: dict[str, Any], why: str) -> None:
    # 0 is a value that was given, as a label or a threshold.
    named = [name for name, value in options.items() if value is not False and value not in (None, (), [])]
    if given := [f"--{name.replace('_', '-')}" for name in named]:
        raise typer.BadParameter(f"{', '.join(given)} {why}", param_hint=", ".join(given))


def _check(rule: dict[str, Any]) -> None:
    """Refuse what no mask could be simplified with, before any file is read."""
    import torch

    from torchlinf.losses import simplify as simplify_masks

    try:
        simplify_masks(torch.zeros(1, 1, dtype=torch.bool), spatial_ndim=2, **rule)
    except TypeError as error:
        raise ValueError(str(error)) from error


def _refuse_others(targets: Sequence[Path]) -> None:
    """Refuse to write over files where no run has written before."""
    if there := [target for target in targets if target.exists()]:
        others = f" and {len(there) - 1} more are" if len(there) > 1 else " is"
        raise typer.BadParameter(
            f"{there[0]}{others} there already, without a table of an earlier run; pass --overwrite, or another folder",
            param_hint="--out",
        )


def _targets(paths: Sequence[Path], sources: Sequence[Source], out: Path) -> list[Path]:
    """The file to write for each mask: its name, and of a folder its place below it.

    Raises:
        typer.BadParameter: a mask would be written over, or two would have one name.
    """
    folders = sorted((path for path in paths if path.is_dir()), key=lambda path: -len(path.parts))
    if inside := [path for path in folders if out.resolve().is_relative_to(path.resolve())]:
        raise typer.BadParameter(f"{out} lies in {inside[0]}, whose masks are read; pass another", param_hint="--out")
    targets = []
    for source in sources:
        root = next((path for path in folders if source.path.is_relative_to(path)), source.path.parent)
        targets.append(out / source.path.relative_to(root))
    read = {source.path.resolve() for source in sources}
    for target in targets:
        if target.resolve() in read:
            raise typer.BadParameter(f"{target} is one of the masks; pass another folder", param_hint="--out")
    whole = Counter(target for source, target in zip(sources, targets, strict=True) if source.member is None)
    if twice := next((target for target, number in whole.items() if number > 1), None):
        raise typer.BadParameter(f"two masks would be written to {twice}; pass their folders one by one")
    return targets
