"""The screened L-infinity field of a shape: the equation, its solvers, the certificate, and its derivatives.

One file a solver: `value_iteration`, `accelerated_value_iteration`, `batched_policy_iteration` (torch, any device),
`policy_iteration` (compiled, CPU). What other packages of torchlinf, and the benchmarks, may use is in `__all__`.
"""

from torchlinf.field.certificate import RESOLUTION, ROUNDING, certify
from torchlinf.field.distance import chessboard_distance
from torchlinf.field.erosions import soft_distance_of
from torchlinf.field.methods import METHODS, solve_locally, solve_shape, uses_kernels
from torchlinf.field.problem import Problem, pose
from torchlinf.field.soft import (
    as_probability,
    length_of,
    number_of_slices,
    occupancy_of,
    occupied_field,
    soft_chessboard_distance,
    soft_linf_field,
)
from torchlinf.field.solution import FieldSolution, Status, raise_failures
from torchlinf.field.solve import largest, linf_field, normalised, solve, solve_field
from torchlinf.field.stencil import Layout, System, residual

__all__ = [
    "METHODS",
    "RESOLUTION",
    "ROUNDING",
    "FieldSolution",
    "Layout",
    "Problem",
    "Status",
    "System",
    "as_probability",
    "certify",
    "chessboard_distance",
    "largest",
    "length_of",
    "linf_field",
    "normalised",
    "number_of_slices",
    "occupancy_of",
    "occupied_field",
    "pose",
    "raise_failures",
    "residual",
    "soft_chessboard_distance",
    "soft_distance_of",
    "soft_linf_field",
    "solve",
    "solve_field",
    "solve_locally",
    "solve_shape",
    "uses_kernels",
]
