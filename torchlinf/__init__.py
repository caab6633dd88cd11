"""Multi-scale complexity of discrete shapes from the screened L-infinity field, on PyTorch tensors."""

from torchlinf import shapes
from torchlinf._complexity_map import complexity_map
from torchlinf._soft import soft_chessboard_distance, soft_linf_field
from torchlinf._soft_complexity import soft_complexity
from torchlinf.complexity import ComplexityProfile, complexity, complexity_profile
from torchlinf.distance import chessboard_distance
from torchlinf.field import FieldSolution, Status, linf_field, solve_field

__version__ = "0.1.0"

__all__ = [
    "ComplexityProfile",
    "FieldSolution",
    "Status",
    "chessboard_distance",
    "complexity",
    "complexity_map",
    "complexity_profile",
    "linf_field",
    "shapes",
    "soft_chessboard_distance",
    "soft_complexity",
    "soft_linf_field",
    "solve_field",
]
