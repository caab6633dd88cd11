"""Score real shapes beside a square and a disc: a table, a CSV file and a picture. `make demo` runs it.

The shapes are cut out of pictures that scikit-image brings along, so nothing is downloaded. They are saved as masks
and scored from there; `torchlinf score demo/masks --out demo/scores.csv` does the same.
"""

import argparse
from pathlib import Path

import matplotlib
import numpy as np
import torch
from numpy.typing import NDArray
from skimage import data, filters, io, measure, morphology, transform

from torchlinf import plot, scoring, shapes

Mask = NDArray[np.bool_]


def main() -> None:
    parser = argparse.ArgumentParser(description="Score real shapes beside a square and a disc.")
    parser.add_argument("--out", type=Path, default=Path("demo"), help="folder for what is written")
    parser.add_argument(
        "--docs", action="store_true", help="also write the picture of the method, docs/images/demo.png"
    )
    options = parser.parse_args()
    sources = scoring.find_masks(save_masks(options.out / "masks"))
    score(sources, options.out / "scores.csv")
    pictures = [options.out / "shapes.png"]
    if options.docs:
        pictures.append(Path(__file__).parents[1] / "docs" / "images" / "demo.png")
    draw(sources, pictures)


def save_masks(folder: Path) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    masks = {"square": shapes.square(128).numpy(), "disc": shapes.disc(64).numpy(), **real_shapes()}
    paths = [folder / f"{name}.png" for name in masks]
    for path, mask in zip(paths, masks.values(), strict=True):
        io.imsave(path, np.where(np.pad(mask, 4), 255, 0).astype(np.uint8), check_contrast=False)
    return paths


def real_shapes() -> dict[str, Mask]:
    # The small ones are enlarged before they are cut out: numbers compare best between shapes of like radius.
    coins = transform.rescale(data.coins(), 2, order=3)
    galaxies = transform.rescale(data.hubble_deep_field()[128:198, 417:481].max(axis=2), 5, order=3)
    cell, camera, logo = data.cell(), data.camera(), data.logo().astype(int)
    # On uneven lighting a coin is what is brighter than its surroundings, its dark relief filled in.
    bright = filled(coins > filters.threshold_local(coins, 151, offset=-0.03))
    orange = (logo[..., 0] > logo[..., 1] + 20) & (logo[..., 3] > 127)
    return {
        "nicked coin": largest(bright),
        "worn coin": largest(bright, rank=12),
        "cell": largest(cell > filters.threshold_otsu(cell)),
        "galaxies": largest(galaxies > 60 / 255),
        "head": largest(data.shepp_logan_phantom() > 0),
        "cameraman": largest(filled(morphology.opening(camera < 60, morphology.disk(1)))),
        "snake": largest(filled(morphology.closing(orange, morphology.disk(5)))),
        "horse": largest(~data.horse()),
    }


def largest(mask: Mask, rank: int = 0) -> Mask:
    """The largest connected component, or the next but `rank`, cut to its box."""
    regions = measure.regionprops(measure.label(mask, connectivity=2))
    return sorted(regions, key=lambda region: -region.area)[rank].image


def filled(mask: Mask) -> Mask:
    """The mask without its holes."""
    outside = measure.label(np.pad(~mask, 1, constant_values=True), connectivity=1)
    return (outside != outside[0, 0])[1:-1, 1:-1]


def score(sources: list[scoring.Source], table: Path) -> None:
    rows = []
    with scoring.open_table(table) as write:
        for row in scoring.score_masks(sources):
            write(row)
            rows.append(row)
    scoring.print_table(sorted(rows, key=lambda row: row["complexity"]))
    print(f"wrote {table}")


def draw(sources: list[scoring.Source], pictures: list[Path]) -> None:
    matplotlib.use("Agg")
    masks = {source.path.stem: torch.from_numpy(scoring.read_mask(source.path)) for source in sources}
    figure = plot.shapes(masks)
    for picture in pictures:
        picture.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(picture, dpi=120)
        print(f"wrote {picture}")


if __name__ == "__main__":
    main()
