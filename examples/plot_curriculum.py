"""
A curriculum from simple to complex shapes
==========================================

A transform that scores the masks of a dataset, and a sampler that draws by the scores: the first epochs see simple
shapes only, the later ones all. Whether that helps is a question to the data; here it is asked, and the answer is no.

Run with ``--full`` for more seeds.
"""

# %%
# Made-up data: boxes with blocks grown onto their rims, from none to sixty, seen through noise. A sample is a
# dictionary, and ``ShapeComplexityScored`` adds the complexity of its mask.

import sys
from collections.abc import Callable
from itertools import islice

import matplotlib.pyplot as plt
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader

from torchlinf.samplers import ComplexitySampler
from torchlinf.transforms import ShapeComplexityScored

SIZE, BATCH, EPOCHS = 32, 16, 8
SEEDS = range(10 if "--full" in sys.argv else 3)
Samples = list[dict[str, Tensor]]


def grown_box(generator: torch.Generator) -> Tensor:
    """A box, and on it as many blocks as chance will have."""
    rows, columns = torch.randint(8, 15, (2,), generator=generator).tolist()
    mask = torch.zeros(SIZE, SIZE, dtype=torch.bool)
    mask[9 : 9 + rows, 9 : 9 + columns] = True
    for _ in range(int(torch.randint(0, 61, (), generator=generator))):
        grown = nn.functional.max_pool2d(mask[None].float(), 3, stride=1, padding=1)[0] > 0
        rim = (grown & ~mask).nonzero()
        row, column = rim[torch.randint(len(rim), (), generator=generator)].squeeze().clamp(2, SIZE - 3).tolist()
        mask[row - 1 : row + 2, column - 1 : column + 2] = True
    return mask


def samples(count: int, seed: int) -> Samples:
    """Masks, noisy images of them, and the complexity of each."""
    generator = torch.Generator().manual_seed(seed)
    score = ShapeComplexityScored("mask")
    masks = [grown_box(generator) for _ in range(count)]
    noise = torch.randn(count, 1, SIZE, SIZE, generator=generator)
    return [score({"image": mask + 0.8 * other, "mask": mask}) for mask, other in zip(masks, noise, strict=True)]


train, test = samples(240, seed=0), samples(100, seed=1)

# %%
# The samples are scored once, and the sampler draws by the scores. With data on disk the pass over them is a loader
# with workers, and the scores are worth keeping in a file.

scores, test_scores = (torch.stack([sample["mask_complexity"] for sample in part]) for part in (train, test))


def growing(epoch: int) -> float:
    """The simplest fifth at first, everything from the seventh epoch on."""
    return min(1.0, 0.2 + 0.14 * epoch)


sampler = ComplexitySampler(scores, share=growing)
fig, axes = plt.subplots(3, 8, figsize=(9, 4), layout="constrained")
for row, epoch in zip(axes, (0, 3, 6), strict=True):
    sampler.set_epoch(epoch)
    drawn = sorted(islice(sampler, 64), key=lambda index: scores[index])
    for ax, index in zip(row, drawn[::9], strict=True):
        ax.imshow(train[index]["mask"], cmap="gray_r")
        ax.set(xticks=[], yticks=[], title=f"{scores[index]:.2f} bits")
    row[0].set_ylabel(f"epoch {epoch}")
plt.show()

# %%
# The same small network, trained in the order of the curriculum and in random order. An epoch has equally many steps
# in both.


def network() -> nn.Sequential:
    """Three convolutions, one logit a pixel."""
    layers: list[nn.Module] = []
    for inputs in (1, 8):
        layers += [nn.Conv2d(inputs, 8, 3, padding=1), nn.ReLU()]
    return nn.Sequential(*layers, nn.Conv2d(8, 1, 3, padding=1))


images, masks = (torch.stack([sample[key] for sample in test]) for key in ("image", "mask"))


def dice(model: nn.Module) -> Tensor:
    """Dice coefficient of each sample of the test set."""
    with torch.no_grad():
        found = model(images)[:, 0] > 0
    return 2 * (found & masks).sum((1, 2)) / (found.sum((1, 2)) + masks.sum((1, 2)))


def run(seed: int, share: float | Callable[[int], float]) -> Tensor:
    """Dice on the test set after each epoch, (EPOCHS, samples)."""
    torch.manual_seed(seed)
    model = network()
    optimiser = torch.optim.Adam(model.parameters(), lr=3e-3)
    loader = DataLoader(train, batch_size=BATCH, sampler=ComplexitySampler(scores, share=share, seed=seed))
    path = []
    for _ in range(EPOCHS):
        for batch in loader:
            loss = nn.functional.binary_cross_entropy_with_logits(model(batch["image"])[:, 0], batch["mask"].float())
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
        path.append(dice(model))
    return torch.stack(path)


runs = {
    name: torch.stack([run(seed, share) for seed in SEEDS])  # (seeds, EPOCHS, samples)
    for name, share in (("curriculum", growing), ("random order", 1.0))
}

# %%
# The answer, on shapes of the test set below and above the median complexity; a line for each seed. Here the simple
# shapes at the start only delay the training: random order is ahead in every epoch's mean, also on the simple shapes.

simple = test_scores < test_scores.median()
fig, axes = plt.subplots(1, 2, figsize=(9, 3.6), sharey=True, layout="constrained")
for ax, chosen, title in zip(axes, (simple, ~simple), ("simple half", "complex half"), strict=True):
    for (name, found), look in zip(runs.items(), ("#332288", "#CC6677"), strict=True):
        for number, path in enumerate(found[:, :, chosen].mean(2)):
            ax.plot(range(1, EPOCHS + 1), path, color=look, label=name if number == 0 else None)
    ax.set(xlabel="epoch", title=f"test shapes: the {title}")
    ax.spines[["top", "right"]].set_visible(False)
axes[0].set_ylabel("Dice coefficient")
axes[0].legend(frameon=False)
plt.show()
for name, found in runs.items():
    for half, chosen in (("simple", simple), ("complex", ~simple)):
        last = found[:, -1, chosen].mean(1)
        print(f"{name:13} {half:8} Dice {last.mean():.4f}, from {last.min():.4f} to {last.max():.4f} over the seeds")
