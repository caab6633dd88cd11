"""Parts of a shape that are simpler than the whole."""

from torchlinf.decompose.cut_tree import Decomposition, parts

__all__ = ["Decomposition", "parts"]
