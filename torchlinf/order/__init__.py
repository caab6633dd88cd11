"""Orders of shapes: partial orders by several indicators, their Hasse diagrams and chains, and Kendall's tau."""

from torchlinf.order.agreement import kendall_tau
from torchlinf.order.partial_order import (
    WINDOWS,
    Node,
    chains,
    dominance,
    hasse_diagram,
    incomparable_pairs,
    largest_antichain,
    longest_chain,
)

__all__ = [
    "WINDOWS",
    "Node",
    "chains",
    "dominance",
    "hasse_diagram",
    "incomparable_pairs",
    "kendall_tau",
    "largest_antichain",
    "longest_chain",
]
