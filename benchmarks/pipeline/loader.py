"""By how much does `ShapeComplexityScore` slow a loader with two workers that decodes and augments images?"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageEnhance, ImageFilter
from skimage import data
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from benchmarks import shapes
from benchmarks.timing import Ratio, alternate, ratio
from torchlinf.transforms import ShapeComplexityScore

Sample = tuple[Tensor, ...]
Score = Callable[[Image.Image], Tensor]


class HalfSize:
    """The score of a copy with half the pixels along each side."""

    def __init__(self) -> None:
        """Around the usual score."""
        self.score = ShapeComplexityScore()

    def __call__(self, mask: Image.Image) -> Tensor:
        """Shrink and score."""
        return self.score(mask.reduce(2).point(lambda value: 255 * (value > 127)))


SCORES: dict[str, Score | None] = {
    "no score": None,
    "the mask": ShapeComplexityScore(),
    "a copy of half the side": HalfSize(),
}


@dataclass(frozen=True)
class Answer:
    """Of one way to score: milliseconds a sample in one process, how much longer an epoch takes, and rank agreement."""

    name: str
    each: float
    slowdown: Ratio
    agreement: float


def run(count: int = 96, side: int = 256, rounds: int = 5, workers: int = 2) -> list[Answer]:
    """Epochs of the loader without and with scores, in turn."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), count, side)
        samples = {name: Photographs(Path(folder), score) for name, score in SCORES.items()}
        times = alternate({name: epoch(loader(of, workers)) for name, of in samples.items()}, rounds=rounds)
        each = {name: _each(of) for name, of in samples.items()}
        full = samples["the mask"].scores()
        return [
            Answer(name, each[name], ratio(times[name], times["no score"]), _rank_agreement(of.scores(), full))
            for name, of in samples.items()
        ]


class Photographs(Dataset[Sample]):
    """Photographs with masks, decoded from files and augmented in the way of most training scripts."""

    def __init__(self, folder: Path, score: Score | None = None) -> None:
        """With `score` a sample has the complexity of its mask as a third entry."""
        self.paths = sorted(folder.glob("*.jpg"))
        self.score = score

    def __len__(self) -> int:
        return len(self.paths)

    def scores(self) -> list[float]:
        """Of all masks, NaN without a score."""
        masks = [decode(path.with_suffix(".png")) for path in self.paths]
        return [np.nan if self.score is None else self.score(mask).item() for mask in masks]

    def __getitem__(self, index: int) -> Sample:
        path = self.paths[index]
        image, mask = decode(path), decode(path.with_suffix(".png"))
        scores = () if self.score is None else (self.score(mask),)
        return (*augment(image, mask, np.random.default_rng(index)), *scores)


def decode(path: Path) -> Image.Image:
    """The image of a file, which is closed again."""
    with Image.open(path) as image:
        return image.copy()


def augment(image: Image.Image, mask: Image.Image, generator: np.random.Generator) -> Sample:
    """Flip, rotate, crop and resize both; jitter and blur the image; normalise."""
    angle, scale = generator.uniform(-20, 20), generator.uniform(0.7, 1.0)
    corner = generator.uniform(0, 1 - scale, 2) * image.size
    box = (*corner, *(corner + np.array(image.size) * scale))
    if generator.random() < 0.5:
        image, mask = (x.transpose(Image.Transpose.FLIP_LEFT_RIGHT) for x in (image, mask))
    image = image.rotate(angle, Image.Resampling.BILINEAR).resize(image.size, Image.Resampling.BILINEAR, box)
    mask = mask.rotate(angle).resize(mask.size, Image.Resampling.NEAREST, box)
    for enhance in (ImageEnhance.Brightness, ImageEnhance.Contrast, ImageEnhance.Color):
        image = enhance(image).enhance(generator.uniform(0.6, 1.4))
    image = image.filter(ImageFilter.GaussianBlur(generator.uniform(0.1, 2.0)))
    pixels = torch.from_numpy(np.array(image)).permute(2, 0, 1).float() / 255
    return (pixels - 0.5) / 0.25, torch.from_numpy(np.array(mask) > 0)


def write(folder: Path, count: int, side: int) -> None:
    """Pieces of a photograph as JPEG, and silhouettes as PNG masks."""
    generator = np.random.default_rng(0)
    photograph = np.tile(data.astronaut(), (1 + side // 512, 1 + side // 512, 1))
    for number, mask in enumerate(shapes.batch(count, side)):
        row, column = generator.integers(0, [size - side + 1 for size in photograph.shape[:2]])
        Image.fromarray(photograph[row : row + side, column : column + side]).save(folder / f"{number:04}.jpg")
        Image.fromarray(255 * mask.numpy().astype(np.uint8)).save(folder / f"{number:04}.png")


def loader(samples: Photographs, workers: int) -> DataLoader[Sample]:
    """Workers that stay, so that starting them is in no epoch but the first, which does not count."""
    return DataLoader(samples, batch_size=16, num_workers=workers, persistent_workers=workers > 0)


def epoch(loader: DataLoader[Sample]) -> Callable[[], None]:
    """One pass over the loader."""

    def run() -> None:
        for _ in loader:
            pass

    return run


def _rank_agreement(a: list[float], b: list[float]) -> float:
    """Spearman's correlation of the ranks; NaN where there are no scores."""
    from scipy.stats import spearmanr

    return np.nan if np.isnan(a).any() else float(spearmanr(a, b).statistic)


def _each(samples: Photographs) -> float:
    """Milliseconds of processor time for a sample, in this process."""
    samples[0]
    began = time.process_time()
    for index in range(len(samples)):
        samples[index]
    return 1e3 * (time.process_time() - began) / len(samples)
