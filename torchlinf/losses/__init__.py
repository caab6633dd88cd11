"""Losses that simplify what a network predicts, and `simplify`, which does it to what is predicted."""

from torchlinf.losses.shape_loss import ShapeComplexityLoss
from torchlinf.losses.simplify import Simplification, simplify

__all__ = ["ShapeComplexityLoss", "Simplification", "simplify"]
