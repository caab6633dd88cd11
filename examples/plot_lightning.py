"""
Complexity in a Lightning module
================================

A network finds boxes with appendages in noise. Its Lightning module logs how complex the shapes are that it predicts,
in training and in validation, with :class:`torchlinf.metrics.ShapeComplexity`, and adds
:class:`torchlinf.losses.ShapeComplexityLoss` to its loss for the second half. What that loss can do is measured in
:doc:`plot_train_footprints`; here it is about what to write where.

It needs the extras ``metrics`` and ``lightning``. Run with ``--full`` for more and larger training.
"""

# %%
# Made-up data: a square with one appendage, somewhere in an image of 40 x 56 pixels, seen through strong noise.

import logging
import sys
import warnings

import lightning
import matplotlib.pyplot as plt
import torch
from lightning.pytorch import LightningModule, Trainer
from torch import Tensor, nn
from torch.utils.data import DataLoader, TensorDataset

from torchlinf import shapes
from torchlinf.losses import ShapeComplexityLoss
from torchlinf.metrics import ShapeComplexity
from torchlinf.plot import COLOURS

FULL = "--full" in sys.argv
HEIGHT, WIDTH, EPOCHS, SAMPLES = 40, 56, 30 if FULL else 12, 384 if FULL else 96
STAGES = ("train", "val")
WARM_UP = EPOCHS // 2  # epochs without the regulariser, until the predictions resemble something


def samples(count: int, seed: int) -> TensorDataset:
    """Images (count, 1, HEIGHT, WIDTH) and masks of the same shape."""
    generator = torch.Generator().manual_seed(seed)

    def draw(low: int, high: int) -> int:
        return int(torch.randint(low, high, (), generator=generator))

    masks = torch.zeros(count, 1, HEIGHT, WIDTH)
    for mask in masks:
        side, face = draw(14, 22), ("right", "left", "top", "bottom")[draw(0, 4)]
        shape = shapes.with_appendages((side, side), [shapes.Appendage(face, draw(4, side - 4), draw(3, 8))])
        height, width = shape.shape
        top, left = draw(1, HEIGHT - height), draw(1, WIDTH - width)
        mask[0, top : top + height, left : left + width] = shape
    return TensorDataset(masks + 0.8 * torch.randn(masks.shape, generator=generator), masks)


train, validation = samples(SAMPLES, seed=0), samples(48, seed=1)

# %%
# The module holds a metric for each stage and logs the metric object itself: Lightning then computes it at the end of
# the epoch, over all batches (and all processes), and resets it. One channel of logits needs ``threshold=0.0``. The
# targets are not given to it: every image has its shape here, and a prediction without a pixel counts as much as the
# most complex shape could.


class Segmenter(LightningModule):
    """Five convolutions; `weight` is that of the regulariser."""

    def __init__(self, weight: float) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for inputs, step in ((1, 1), (12, 2), (12, 4), (12, 1)):  # dilated, so as to see whole appendages
            layers += [nn.Conv2d(inputs, 12, 3, padding=step, dilation=step), nn.BatchNorm2d(12), nn.ReLU()]
        self.network = nn.Sequential(*layers, nn.Conv2d(12, 1, 3, padding=1))
        self.regulariser = ShapeComplexityLoss(weight=weight, activation="sigmoid", max_flips=8)
        self.complexities = nn.ModuleDict(
            {f"{stage}_complexity": ShapeComplexity(1, threshold=0.0) for stage in STAGES}
        )
        self.history: dict[str, list[float]] = {}

    def step(self, batch: tuple[Tensor, Tensor], stage: str) -> tuple[Tensor, Tensor]:
        """Logits and data term of a batch, and what is logged of them."""
        images, masks = batch
        logits = self.network(images)
        name = f"{stage}_complexity"
        self.complexities[name].update(logits)
        self.log(name, self.complexities[name], on_step=False, on_epoch=True)
        found = logits > 0
        dice = 2 * (found * masks).sum((1, 2, 3)) / (found.sum((1, 2, 3)) + masks.sum((1, 2, 3)))
        self.log(f"{stage}_dice", dice.mean(), on_step=False, on_epoch=True, batch_size=len(images))
        return logits, nn.functional.binary_cross_entropy_with_logits(logits, masks)

    def training_step(self, batch: tuple[Tensor, Tensor], _: int) -> Tensor:
        """The data term, and after some epochs the regulariser too."""
        logits, loss = self.step(batch, "train")
        if self.current_epoch < WARM_UP or not self.regulariser.weight:
            return loss
        return loss + self.regulariser(logits)

    def validation_step(self, batch: tuple[Tensor, Tensor], _: int) -> None:
        """Only what is logged."""
        self.step(batch, "val")

    def on_train_epoch_end(self) -> None:
        """Keep the logged values for the figure; a logger would write them to disk."""
        for name, value in self.trainer.logged_metrics.items():
            self.history.setdefault(name, []).append(float(value))

    def configure_optimizers(self) -> dict[str, object]:
        """Adam, with small steps once there is a regulariser."""
        optimiser = torch.optim.Adam(self.parameters(), lr=1e-2)
        rate = torch.optim.lr_scheduler.MultiStepLR(optimiser, [WARM_UP], gamma=0.1)
        return {"optimizer": optimiser, "lr_scheduler": rate}


# %%
# Nothing is written to disk: no logger, no checkpoints.

logging.getLogger("lightning.pytorch").setLevel(logging.ERROR)  # it reports the hardware
warnings.filterwarnings("ignore", message=".*does not have many workers")  # the data are in memory
warnings.filterwarnings("ignore", message=".*LeafSpec", category=FutureWarning)  # Lightning's talk with torch
lightning.seed_everything(0, verbose=False)
model = Segmenter(weight=0.05)
trainer = Trainer(
    max_epochs=EPOCHS, accelerator="cpu", devices=1, logger=False, enable_checkpointing=False,
    enable_progress_bar=False, enable_model_summary=False, num_sanity_val_steps=0, log_every_n_steps=1,
)  # fmt: skip
trainer.fit(model, DataLoader(train, batch_size=16, shuffle=True), DataLoader(validation, batch_size=48))

# %%
# What was logged; the vertical line is where the regulariser sets in. The grey line is the same metric on the masks
# themselves: predictions above it have ragged edges, predictions below it have lost detail. At first
# predictions fill the image, a box of complexity 0, or are empty, which counts 10 bits.

targets = ShapeComplexity(1)
targets.update(validation.tensors[1].bool())
fig, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
epochs = range(1, EPOCHS + 1)
for stage, colour, words in zip(STAGES, COLOURS, ("training", "validation"), strict=False):
    axes[0].plot(epochs, model.history[f"{stage}_complexity"], color=colour, label=words)
    axes[1].plot(epochs, model.history[f"{stage}_dice"], color=colour, label=words)
axes[0].axhline(float(targets.compute()), color=COLOURS[-1], linestyle="--", label="masks, validation")
axes[0].set(ylabel="complexity (bits)", ylim=(0, 10.4))
axes[1].set(ylabel="Dice coefficient", ylim=(0, 1))
for ax in axes:
    ax.axvline(WARM_UP + 0.5, color="#BBBBBB", linewidth=1, zorder=0)
    ax.set(xlabel="epoch")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False)
plt.show()
for name, values in model.history.items():
    print(f"{name:16} {values[-1]:.3f}")
print(f"{'masks':16} {float(targets.compute()):.3f}")
