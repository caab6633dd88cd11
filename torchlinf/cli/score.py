"""`torchlinf score`: a table of masks."""

import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from torchlinf.cli.inputs import by_source, find_sources, reading_options, spacing_of
from torchlinf.cli.measure_options import takes_measure
from torchlinf.cli.options import (
    AsJson,
    Ignore,
    Invert,
    Label,
    Labels,
    MaxPixels,
    Members,
    Nonzero,
    Out,
    Overwrite,
    Paths,
    Ray,
    Report,
    Retry,
    Spacing,
    Stack,
    Threshold,
    Volume,
    Voxel,
    Workers,
)  # fmt: skip
from torchlinf.cli.outputs import (
    STATUS,
    check_out,
    end_if_failed,
    endings,
    is_standard_output,
    load_table,
    refuse_source,
    say,
)  # fmt: skip
from torchlinf.cli.progress import cores, progress
from torchlinf.cli.score_geodata import takes_geodata
from torchlinf.scoring import COLUMNS, MAX_PIXELS, RULE, WINDOWS

if TYPE_CHECKING:
    from torchlinf.measure import Measure

EPILOG = f"""{RULE}

Columns: {", ".join(COLUMNS)}. Instead of the three columns of complexity there is one for each --window, and with --low
or --high the one column complexity.

{STATUS}"""


@takes_measure(WINDOWS)
@takes_geodata
def score(
    paths: Paths,
    *,
    out: Out = None,
    as_json: AsJson = False,
    overwrite: Overwrite = False,
    retry: Retry = False,
    threshold: Threshold = None,
    label: Label = None,
    labels: Labels = False,
    nonzero: Nonzero = False,
    ignore: Ignore = None,
    stack: Stack = False,
    volume: Volume = False,
    spacing: Spacing = None,
    voxel: Voxel = None,
    invert: Invert = False,
    members: Members = None,
    workers: Workers = None,
    max_pixels: MaxPixels = MAX_PIXELS,
    ray: Ray = None,
    report: Report = None,
    measure: "Measure",
) -> None:
    """Score masks: one row of numbers a mask, or an object with --per object.

    Without --out the table goes to the terminal, or as CSV into a pipe. A mask that cannot be scored gives a row that
    says why, and the rest go on. With --out the rows are kept in a journal, FILE.part, until all are there: stopped by
    Ctrl-C, a kill or a full disk, the same command goes on where it was. Masks whose rows are in the table already are
    not scored again.

    Outlines in a .gpkg, .geojson, .shp or .parquet (GeoParquet) file are drawn at --resolution, and scored with a row
    for each that has their attributes too; --out may be .gpkg then.
    """
    from torchlinf.scoring import ScoreOptions, open_table, score_groups

    with reading_options():
        options = ScoreOptions(
            threshold, invert, max_pixels, members, measure, label, nonzero, ignore or (), volume, labels, stack,
            spacing_of(spacing), voxel,
        )  # fmt: skip
    if report is not None:
        from torchlinf.cli.report import check_page, write_page

        check_page(report, "--report")
    if ray is not None:
        from torchlinf.cli.score_on_ray import score_on_ray

        if as_json or overwrite or retry or report is not None:
            raise typer.BadParameter(
                "it always goes on in its folder, of Parquet files; torchlinf report makes a page of it",
                param_hint="--ray",
            )
        with endings(None):
            score_on_ray(paths, out, ray, workers or cores(), options, progress)
        return
    check_out(out, as_json, overwrite, retry)
    failed, shown = 0, []
    with endings(out):
        sources = find_sources(paths, members)
        refuse_source(out, sources)
        with open_table(out, as_json=as_json, resume=not overwrite, retry=retry, **options.measuring) as put:
            names = {source.name for source in sources}
            held, failures = by_source(put.done, names), by_source(put.failed, names)
            done = held.keys() - failures.keys()
            new = [source for source in sources if source.name not in done]
            failed += sum(any(put.done[path] is not None for path in held[name]) for name in done & names)
            if before := len(sources) - len(new):
                say(f"{before} of {len(sources)} masks are in {out} already.")
            groups = score_groups(new, options, workers=workers or cores())
            streams = is_standard_output(out) and (as_json or out is not None) and sys.stdout.isatty()
            with closing(groups), progress(before, len(sources), shown=not streams) as advance:
                for source, rows in zip(new, groups, strict=True):
                    replaced = {*held.get(source.name, ()), *failures.get(source.name, ())}
                    put(*rows, instead_of=sorted(replaced - {row.path for row in rows}))
                    if report is not None and is_standard_output(out):
                        shown += [row.cells() for row in rows]
                    failed += any(row.error is not None for row in rows)
                    advance()
    if report is not None and (shown or not is_standard_output(out)):
        with endings(None):
            cells = shown if out is None or is_standard_output(out) else [row.cells() for row in load_table(out)]
            title = "Complexity of shapes" if out is None else f"Complexity of shapes: {out.name}"
            write_page(cells, report, title, Path(), max_pixels=max_pixels)
    end_if_failed(failed, len(sources), "" if is_standard_output(out) or retry else " --retry scores them again.")
