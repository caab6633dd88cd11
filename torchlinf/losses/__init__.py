"""Losses that simplify what a network predicts."""

from torchlinf.losses.shape_loss import ShapeComplexityLoss

__all__ = ["ShapeComplexityLoss"]
