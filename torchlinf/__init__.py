"""Multi-scale complexity of discrete shapes from the screened L-infinity field, on PyTorch tensors."""

from importlib import import_module
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from torchlinf import comparison as comparison
    from torchlinf import decompose as decompose
    from torchlinf import distributed as distributed
    from torchlinf import labels as labels
    from torchlinf import losses as losses
    from torchlinf import metrics as metrics
    from torchlinf import order as order
    from torchlinf import plot as plot
    from torchlinf import regions as regions
    from torchlinf import scoring as scoring
    from torchlinf import transforms as transforms
else:
    # Imported at first use, so that `torchlinf.losses` works after `import torchlinf`, and that stays light.
    _LATER = {"comparison", "decompose", "distributed", "labels", "losses", "metrics", "order", "plot"}
    _LATER |= {"regions", "scoring", "transforms"}

    def __getattr__(name):
        if name in _LATER:
            return import_module(f"torchlinf.{name}")
        raise AttributeError(f"module 'torchlinf' has no attribute {name!r}")
