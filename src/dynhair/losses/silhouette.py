"""The hair's silhouette against hair masks (paper, "Geometric losses")."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from dynhair.losses.differences import added_up


def segmentation_loss(
    predicted: Float[Tensor, "*v h w"], target: Float[Tensor, "*v h w"], *, excess: float = 0.5
) -> Float[Tensor, ""]:
    """The paper's asymmetric ``L_seg``: missing hair counts fully, hair beyond the mask by half.

    Args:
        predicted: rendered hair coverage in [0, 1].
        target: hair mask in [0, 1].
        excess: weight of coverage beyond the mask.
    """
    return added_up(predicted, target, above=excess) / predicted.numel()


def segmentation_weight(
    step: int,
    iterations: int,
    warmup: float = 1 / 16,
    floor: float = 0.5,
    *,
    decay: float = 0.85,
    period: float = 1 / 16,
) -> float:
    """Factor on the segmentation weight: one, then an exponential decay "after a warm-up period", then a floor.

    The paper gives no figures. The defaults, shares of the run so that short runs decay alike, amount to a factor of
    0.85 for every 20,000 steps after the first 20,000 of 320,000.

    Args:
        step: steps done.
        iterations: steps of the whole run.
        warmup: share of the run before the decay.
        floor: the least factor.
        decay: factor for each period.
        period: share of the run in which the weight decays once by ``decay``.
    """
    periods = (step / iterations - warmup) / period
    return max(floor, decay ** max(periods, 0.0))
