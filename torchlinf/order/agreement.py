"""Agreement of an expected order of shapes with the order of their complexity: the paper's Kendall's tau."""

from collections.abc import Sequence

import torch
from torch import Tensor

from torchlinf.measure import ComplexityProfile
from torchlinf.order.indicators import bounds_at_scales, require_comparable


def kendall_tau(profiles: Sequence[ComplexityProfile]) -> Tensor:
    """Agreement of an expected order of shapes with the order of their complexity, at each scale.

    Of all pairs of shapes, the share that agrees with the expected order less the share that contradicts it. A pair
    contradicts it if the shape that comes later is simpler. A pair of equal complexities counts as agreement. In this
    it differs from `scipy.stats.kendalltau`: its tau-b leaves equal pairs out of the numerator and corrects the
    denominator for them, and is not defined where all values are equal. Without equal values both are the same number.

    Two values count as equal if their intervals meet: each value plus or minus its `level_error_bound` and the rounding
    of its sum. The interval is proven to hold the complexity of the exact field. So a pair that contradicts the
    expected order does so in the exact fields too.

    Args:
        profiles: two or more, in the order in which the complexity is expected to grow, each of one shape that is not
            empty, all of one estimator, number of bins and kind of levels, and on the same scales. They are computed
            already; nothing is solved here.

    Returns:
        (L,) float64 on the CPU, in [-1, 1], one for each of the profiles' scales; 1 if no pair contradicts the order.
        Not differentiable.

    Raises:
        TypeError: `profiles` is no sequence, or an entry is no `ComplexityProfile`.
        ValueError: fewer than two profiles, one of several shapes or of an empty one, or estimators, bins, levels
            or scales that differ.

    Source: the modified Kendall tau of Arslan and Tari (2020).

    Example:
        >>> from torchlinf import complexity_profile, shapes
        >>> masks = shapes.square(20), shapes.disc(20), shapes.disc(10)
        >>> kendall_tau([complexity_profile(mask, scales=[0.5, 1.0], spatial_ndim=2) for mask in masks])
        tensor([0.3333, 1.0000], dtype=torch.float64)
    """
    if not isinstance(profiles, Sequence):
        got = type(profiles).__name__
        raise TypeError(f"profiles must be a sequence in the expected order; got {got}. Pass a list of profiles.")
    require_comparable(enumerate(profiles))
    if len(profiles) < 2:
        raise ValueError(f"profiles must be two or more; got {len(profiles)}. Pass the profiles of two shapes or more.")
    if any(profile.scales.tolist() != profiles[0].scales.tolist() for profile in profiles):
        raise ValueError("profiles must be on the same scales; got several grids. Pass the same scales= for each.")
    values = torch.stack([profile.values.flatten().cpu() for profile in profiles]).double()  # (N, L)
    bounds = bounds_at_scales(profiles)
    first, later = torch.triu_indices(len(values), len(values), offset=1)
    simpler = values[later] + bounds[later] < values[first] - bounds[first]  # (pairs, L)
    return 1 - 2 * simpler.double().mean(dim=0)
