"""`torchlinf simplify footprints.gpkg`: the command's side of `scoring.simplify_outlines`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

from torchlinf.cli.outputs import endings, fail, folder_problem, say
from torchlinf.cli.progress import progress
from torchlinf.cli.score_geodata import check_crs


def simplify_geodata(
    file: Path,
    out: Path,
    rule: Mapping[str, Any],
    drawing: Mapping[str, Any],
    *,
    overwrite: bool,
    max_pixels: int,
    workers: int,
) -> None:
    """Simplify a file of outlines; the arguments are those of the command.

    Raises:
        typer.BadParameter: options that contradict each other.
        typer.Exit: some outlines failed (1), or all had to end (2).
    """
    from torchlinf._helpers.parallel import threads
    from torchlinf.polygons import simplify
    from torchlinf.scoring import (
        GEO_SUFFIXES,
        UnreadableMaskError,
        number_of_parts,
        simplified_outlines,
        write_outlines,
    )

    problem = folder_problem(out)
    if out.suffix.lower() not in GEO_SUFFIXES:
        problem = f"outlines are written as {', '.join(GEO_SUFFIXES)}; got {out.name}"
    elif out.exists() and file.exists() and out.samefile(file):
        problem = f"{out} is the file to simplify"
    elif out.exists() and not overwrite:
        problem = f"{out} is there already; pass --overwrite, or another"
    if problem:
        raise typer.BadParameter(problem, param_hint="--out")
    names = ("resolution", "pixels_per_radius", "straighten", "repair")
    plain = {name: drawing[name] for name in names} | {"max_pixels": max_pixels}
    try:
        simplify([], **plain, **rule)
    except (TypeError, ValueError) as error:
        raise typer.BadParameter(str(error)) from error
    check_crs(drawing["crs"])
    with (
        threads(workers),
        endings(out, resumes=False),
        progress(0, number_of_parts(file, drawing["layer"]), True, "simplifying") as advance,
    ):
        try:
            frame = simplified_outlines(file, plain | dict(rule), drawing["layer"], drawing["crs"], advance)
        except UnreadableMaskError as error:
            fail(f"{file}: {error}.")
        write_outlines(out, frame)
    failed = int(frame["error"].notna().sum())
    if failed:
        say(f"{failed} of {len(frame)} outlines are as they were; the column 'error' says why.")
        raise typer.Exit(1)
