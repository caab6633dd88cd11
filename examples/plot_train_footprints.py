"""
Training a segmentation network on ragged labels
================================================

Footprints of buildings are unions of boxes. Drawn by hand in a hurry, or seen through noise, they become ragged, and a
network learns to be ragged too. ``torchlinf.losses.ShapeComplexityLoss`` asks it for simple shapes: here it is added to
a Dice loss in the last epochs of a small U-Net, and compared with the same epochs without it.

Run with ``--full`` for more seeds and longer training.
"""

# %%
# Images of buildings, made up, with noise of two grains. Sheds lean against the walls and shadows fall on them, and
# whoever drew the labels took each for a part of the outline, or not, at will. The truth is kept for scoring alone.

import sys

import kornia
import matplotlib.pyplot as plt
import torch
from torch import Tensor, nn

import torchlinf
from torchlinf.losses import ShapeComplexityLoss

FULL = "--full" in sys.argv
SEEDS = range(3 if FULL else 2)
FIRST_STEPS, LAST_STEPS = (250, 900) if FULL else (250, 150)
SIZE, BATCH = 48, 8


def footprint(generator: torch.Generator) -> Tensor:
    """Two or three boxes that overlap."""
    canvas = torch.zeros(SIZE, SIZE, dtype=torch.bool)

    def between(low: int, high: int) -> int:
        return int(torch.randint(low, high + 1, (), generator=generator))

    row, column = between(10, 16), between(10, 16)
    canvas[row : row + between(12, 20), column : column + between(12, 20)] = True
    for _ in range(between(1, 2)):
        at_row, at_column = row + between(-5, 10), column + between(-5, 10)
        canvas[at_row : at_row + between(8, 16), at_column : at_column + between(8, 16)] = True
    return canvas


def sheds_and_shadows(shape: Tensor, generator: torch.Generator, count: int = 10, side: int = 4) -> list[Tensor]:
    """Blocks of pixels on the boundary, each to be added to the shape or to be taken from it."""
    edge = (torchlinf.chessboard_distance(shape, spatial_ndim=2) == 1).nonzero()
    blocks = []
    for _ in range(count):
        row, column = (edge[torch.randint(len(edge), (), generator=generator)] - side // 2).tolist()
        block = torch.zeros_like(shape)
        block[max(row, 1) : row + side, max(column, 1) : column + side] = True
        blocks.append(block)
    return blocks


def draw(generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """One image, its label and the truth, (1, SIZE, SIZE) each."""
    truth = footprint(generator)
    image, label = truth.float(), truth.clone()
    for number, block in enumerate(sheds_and_shadows(truth, generator)):
        shed = number % 2 == 0
        image[block & (truth != shed)] = 0.6 if shed else 0.4
        if torch.rand((), generator=generator) < 0.6:
            label[block] = shed
    for grain, strength in ((1, 0.15), (4, 0.1)):
        coarse = torch.randn(1, 1, SIZE // grain + 2, SIZE // grain + 2, generator=generator)
        noise = nn.functional.interpolate(coarse, size=(SIZE, SIZE), mode="bilinear", align_corners=False)
        image = image + strength * noise[0, 0]
    return image[None], label[None], truth[None]


def make(count: int, seed: int) -> tuple[Tensor, Tensor, Tensor]:
    """Images, ragged labels and the clean truth, (count, 1, SIZE, SIZE) each."""
    generator = torch.Generator().manual_seed(seed)
    images, labels, truths = zip(*(draw(generator) for _ in range(count)), strict=True)
    return torch.stack(images), torch.stack(labels).float(), torch.stack(truths)


TRAIN, TEST = make(400, seed=1), make(64, seed=3)

# %%
# A small U-Net. kornia flips images and labels together, and measures overlap by its Dice loss.


def block(inputs: int, outputs: int) -> nn.Module:
    """Two convolutions."""
    layers = []
    for channels in (inputs, outputs):
        layers += [nn.Conv2d(channels, outputs, 3, padding=1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU()]
    return nn.Sequential(*layers)


class UNet(nn.Module):
    """Three resolutions; logits of background and building."""

    def __init__(self, width: int = 8) -> None:
        super().__init__()
        self.down = nn.ModuleList([block(1, width), block(width, 2 * width), block(2 * width, 4 * width)])
        self.up = nn.ModuleList([block(3 * width, width), block(6 * width, 2 * width)])
        self.head = nn.Conv2d(width, 2, 1)

    def forward(self, x: Tensor) -> Tensor:
        fine = self.down[0](x)
        middle = self.down[1](nn.functional.max_pool2d(fine, 2))
        coarse = self.down[2](nn.functional.max_pool2d(middle, 2))
        middle = self.up[1](torch.cat([middle, nn.functional.interpolate(coarse, scale_factor=2)], dim=1))
        return self.head(self.up[0](torch.cat([fine, nn.functional.interpolate(middle, scale_factor=2)], dim=1)))


FLIPS = kornia.augmentation.AugmentationSequential(
    kornia.augmentation.RandomHorizontalFlip(),
    kornia.augmentation.RandomVerticalFlip(),
    data_keys=["input", "mask"],
)


def train(network: nn.Module, steps: int, regulariser: ShapeComplexityLoss | None, rate: float) -> None:
    """Dice and cross-entropy on the ragged labels, and the regulariser if there is one."""
    optimiser = torch.optim.Adam(network.parameters(), lr=rate)
    schedule = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 0.02, total_iters=steps)
    network.train()
    for _ in range(steps):
        pick = torch.randint(len(TRAIN[0]), (BATCH,))
        images, labels = FLIPS(TRAIN[0][pick], TRAIN[1][pick])
        target = labels[:, 0].long()
        logits = network(images)
        loss = kornia.losses.dice_loss(logits, target) + nn.functional.cross_entropy(logits, target)
        if regulariser is not None:
            loss = loss + regulariser(logits)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()


@torch.no_grad()
def predict(network: nn.Module) -> Tensor:
    """Held-out predictions, bool."""
    network.eval()
    return network(TEST[0]).argmax(dim=1, keepdim=True).bool()


def score(prediction: Tensor) -> tuple[float, float]:
    """Mean complexity and mean IoU to the clean truth."""
    both, either = (prediction & TEST[2]).sum((1, 2, 3)), (prediction | TEST[2]).sum((1, 2, 3))
    return torchlinf.complexity(prediction).nanmean().item(), (both / either).mean().item()


# %%
# The same weights, the same images in the same order: the only difference is the regulariser.

results, shown = {"without": [], "with": []}, {}
for seed in SEEDS:
    torch.manual_seed(seed)
    network = UNet()
    train(network, FIRST_STEPS, None, rate=3e-3)
    weights = {name: value.clone() for name, value in network.state_dict().items()}
    for name in results:
        network.load_state_dict(weights)
        torch.manual_seed(1000 + seed)
        regulariser = ShapeComplexityLoss(weight=0.06, activation="softmax", include_background=False)
        train(network, LAST_STEPS, regulariser if name == "with" else None, rate=4e-3)
        shown[name] = predict(network)
        results[name].append(score(shown[name]))
        print(
            f"seed {seed}, {name:8} complexity {results[name][-1][0]:.3f}, IoU {results[name][-1][1]:.4f}", flush=True
        )

# %%
# What the last seed predicts for the first held-out images: above each mask its complexity in bits.

fig, axes = plt.subplots(5, 7, figsize=(9, 6.8), layout="constrained")
rows = {"image": TEST[0], "label": TEST[1].bool(), **shown, "truth": TEST[2]}
for ax, (name, images) in zip(axes, rows.items(), strict=True):
    for column, (one, picture) in enumerate(zip(ax, images[:, 0], strict=False)):
        one.imshow(picture.float(), cmap="gray_r", interpolation="nearest")
        one.set_xticks([])
        one.set_yticks([])
        if column == 0:
            one.set_ylabel(name)
        if picture.dtype == torch.bool:
            one.set_title(f"{torchlinf.complexity(picture, spatial_ndim=2):.2f}", fontsize=9)
plt.show()

# %%
# Means over the seeds. The truth itself is not of complexity zero: two boxes are more than one.

means = {name: torch.tensor(found).mean(dim=0) for name, found in results.items()}
change = means["with"][0] / means["without"][0] - 1
print(f"complexity of the truth {score(TEST[2])[0]:.3f}")
print(f"complexity {means['without'][0]:.3f} -> {means['with'][0]:.3f} ({change:+.0%})")
print(f"IoU to the truth {means['without'][1]:.3f} -> {means['with'][1]:.3f}")
