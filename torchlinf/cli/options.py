"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

Paths = Annotated[
    list[Path],
    typer.Argument(
        metavar="PATH",
        help="Masks (PNG, GIF, TIFF, BMP, JPEG, WebP, AVIF, PBM, PGM, PPM, .npy, .npz, NIfTI), folders of them, "
        "patterns in quotes, tar archives (.tar, .tar.gz, .tgz), and COCO and labelme files (.json).",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="FILE",
        help="Write the table here: .csv, .tsv, .jsonl (also with .gz) or .parquet, which is resumed; - is standard "
        "output.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object a line instead of CSV.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Begin the table anew instead of resuming it.")]
Retry = Annotated[bool, typer.Option("--retry", help="Of what is in the table, score anew what failed.")]
Members = Annotated[
    str | None, typer.Option("--members", metavar="PATTERN", help="Which members of tar archives are masks.")
]
Workers = Annotated[
    int | None,
    typer.Option("--workers", "-w", min=1, metavar="N", help="Masks worked on at a time.", show_default="all cores"),
]
Threshold = Annotated[
    float | None,
    typer.Option("--threshold", "-t", metavar="T", help="Inside is what is greater, in the file's own units."),
]
Label = Annotated[int | None, typer.Option("--label", metavar="N", help="Inside is what has this label.")]
Nonzero = Annotated[bool, typer.Option("--nonzero", help="Inside is what is not 0: all labels of a map as one shape.")]
Labels = Annotated[bool, typer.Option("--labels", help="A row for each label of a map but 0, as map.png#15.")]
Ignore = Annotated[
    list[int] | None,
    typer.Option("--ignore", metavar="N", help="A value that is outside of everything, as the void 255. Repeatable."),
]
Volume = Annotated[bool, typer.Option("--volume", help="Three axes, or pages of a TIFF, are one volume (D, H, W).")]
Stack = Annotated[bool, typer.Option("--stack", help="Three axes, or pages of a TIFF, are masks, a row each.")]
Spacing = Annotated[
    str | None,
    typer.Option(
        "--spacing",
        metavar="SIZES",
        help="Size of a pixel along each axis, depth first, as in 3,0.9,0.9; or header, or pixels. The mask is brought "
        "to cubes first.",
        show_default="that of NIfTI alone",
    ),
]
Voxel = Annotated[
    float | None,
    typer.Option("--voxel", metavar="SIZE", help="Size of the cubes.", show_default="the finest of the spacing"),
]
Report = Annotated[
    Path | None, typer.Option("--report", metavar="FILE", help="Write a page of the table too, .html, as report does.")
]
Invert = Annotated[bool, typer.Option("--invert", "-i", help="Swap inside and outside, for dark shapes.")]
Ray = Annotated[
    str | None,
    typer.Option("--ray", metavar="ADDRESS", help="Score on Ray into a folder: local, auto, or where a cluster is."),
]
MaxPixels = Annotated[int, typer.Option(min=1, metavar="N", help="Refuse larger masks; each pixel takes 130 bytes.")]
