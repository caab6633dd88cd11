"""`torchlinf score footprints.gpkg`: the options of outlines, and the command's side of `scoring.geodata`."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer

from torchlinf.cli.outputs import endings, folder_problem, say
from torchlinf.cli.progress import cores, progress

Resolution = Annotated[
    float | None,
    typer.Option("--resolution", metavar="R", help="Of outlines: side of a pixel, in the unit of the coordinates."),
]
PixelsPerRadius = Annotated[
    int | None,
    typer.Option("--pixels-per-radius", min=1, metavar="N", help="Of outlines: draw each so that its radius is N."),
]
Layer = Annotated[str | None, typer.Option("--layer", metavar="NAME", help="Of outlines: the layer of the file.")]
Crs = Annotated[
    str | None,
    typer.Option("--crs", metavar="CRS", help="Of outlines: project to this first, as EPSG:32633; or utm."),
]
Repair = Annotated[bool, typer.Option("--repair", help="Of outlines: make invalid geometries valid first.")]
OPTIONS: Mapping[str, Any] = {
    "resolution": Resolution,
    "pixels_per_radius": PixelsPerRadius,
    "layer": Layer,
    "crs": Crs,
    "repair": Repair,
}
# What a call about outlines may say beside `OPTIONS` and the measure.
SHARED = ("paths", "out", "as_json", "overwrite", "workers", "max_pixels", "measure")


def takes_geodata(command: Callable[..., None]) -> Callable[..., None]:
    """Give `torchlinf score` the options of outlines, and score files of outlines instead of masks."""
    own = inspect.signature(command).parameters

    @wraps(command)
    def run(**given: Any) -> None:
        from torchlinf.scoring import is_geodata

        options = {name: given.pop(name) for name in OPTIONS}
        outlines = [path for path in given["paths"] if is_geodata(path)]
        if not outlines:
            if set_options := [name for name, value in options.items() if value]:
                raise typer.BadParameter(
                    f"{_flags(set_options)} is for files of outlines; got masks", param_hint=_flags(set_options)
                )
            command(**given)
            return
        if len(outlines) < len(given["paths"]):
            raise typer.BadParameter("files of outlines and masks must be scored apart; got both in one call")
        other = [name for name, value in given.items() if name not in SHARED and value != own[name].default]
        other += ["connectivity"] if given["measure"].connectivity is not None else []
        if other:
            raise typer.BadParameter(f"{_flags(other)} is not for outlines", param_hint=_flags(other))
        shared = {name: given[name] for name in SHARED if name != "paths"}
        shared["workers"] = shared["workers"] or cores()
        score_geodata(outlines, options, **shared)

    added = [
        inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=False if name == "repair" else None, annotation=kind
        )
        for name, kind in OPTIONS.items()
    ]
    plain = [one for one in own.values() if one.name != "measure"]
    run.__signature__ = inspect.Signature([*plain, *added, own["measure"]])  # type: ignore[attr-defined]
    return run


def score_geodata(
    files: Sequence[Path],
    drawing: Mapping[str, Any],
    *,
    out: Path | None,
    as_json: bool,
    overwrite: bool,
    workers: int,
    max_pixels: int,
    measure: Any,
) -> None:
    """Score files of outlines; the arguments are those of the command.

    Raises:
        typer.BadParameter: options that contradict each other.
        typer.Exit: some outlines failed (1), or all had to end (2).
    """
    from torchlinf._helpers.parallel import threads
    from torchlinf.scoring import GeoOptions, number_of_parts, open_journal, parts_of, rows_in, write_geo_table

    _check_out(out, files, as_json, overwrite)
    with endings(out):
        options = GeoOptions(**drawing, max_pixels=max_pixels, measure=measure)
        _check(options)
        if out is not None and not overwrite and (found := rows_in(out, files, options)) is not None:
            say(f"The table {out} is there already, with {found[1]} rows.")
            _end_if_failed(*found)
            return
        files = list(dict.fromkeys(files))
        parts = []
        with threads(workers), open_journal(out, options, overwrite) as journal:
            steps = sum(number_of_parts(file, options.layer) for file in files)
            with progress(0, steps, out is not None) as advance:
                for file in files:
                    for part in parts_of(file, options, journal.done.get(str(file), {}) if journal else {}):
                        parts.append(part)
                        if journal:
                            journal.append(part)
                        advance()
            write_geo_table(out, parts, options, as_json=as_json)
    _end_if_failed(sum(part.failed() for part in parts), sum(len(part.columns["row"]) for part in parts))


def _end_if_failed(failed: int, total: int) -> None:
    if failed:
        say(f"{failed} of {total} rows have no numbers; the column 'error' says why.")
        raise typer.Exit(1)


def _check(options: Any) -> None:
    """Refuse what no outline could be measured with, before any file is read."""
    try:
        options.table([])
    except (TypeError, ValueError) as error:
        raise typer.BadParameter(str(error)) from error
    check_crs(options.crs)


def check_crs(crs: str | None) -> None:
    """Refuse a system of coordinates that is unknown or has degrees."""
    if crs is None or crs.lower() == "utm":
        return
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        chosen = CRS.from_user_input(crs)
    except CRSError as error:
        raise typer.BadParameter(f"{crs} is no system of coordinates: {error}", param_hint="--crs") from error
    if chosen.is_geographic:
        raise typer.BadParameter(f"{crs} has degrees; pass a projected system", param_hint="--crs")


def _check_out(out: Path | None, files: Sequence[Path], as_json: bool, overwrite: bool) -> None:
    from torchlinf.scoring import GEO_TABLES

    problem = None if out is None else folder_problem(out)
    if out is None:
        problem = "--overwrite needs a table to work on; pass --out" if overwrite else None
    elif out.suffix.lower() not in GEO_TABLES:
        problem = f"a table of outlines is {', '.join(GEO_TABLES)}; got {out.name}"
    elif as_json and out.suffix.lower() != ".jsonl":
        problem = f"{out} has not the name of JSON lines; leave --json out, or pass for example scores.jsonl"
    elif out.exists() and any(file.exists() and out.samefile(file) for file in files):
        problem = f"{out} is one of the files to score"
    if problem:
        raise typer.BadParameter(problem, param_hint="--out")


def _flags(names: Sequence[str]) -> str:
    return ", ".join(f"--{name.replace('_', '-')}" for name in names)
