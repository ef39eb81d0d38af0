"""What a hairstyle is like as a whole (paper, supplement, "Optimization details": spatial regularisation).

Strands that grow side by side look alike: ``L_shape``, ``L_smooth`` and ``L_length`` are the squared difference of a
strand's descriptor from its neighbours', averaged over pairs of strand and neighbour,
``1 / (N k) sum_i sum_j |f_i - f_j|^2``. Neighbours come from :func:`dynhair.strands.root_neighbours`.

Hair on the back of the head, which few cameras see, is of the same kind as that in front: ``L_pca``.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from dynhair.strands import bending_angles, strand_lengths

COMPONENT_DECAY = 0.05
"""By which the weight of a principal component falls exponentially with its number."""


def shape_loss(strands: Float[Tensor, "n l 3"], neighbours: Int[Tensor, "n k"]) -> Float[Tensor, ""]:
    """The paper's ``L_shape``: neighbours bend alike. The descriptor is the bending angles, radians."""
    return _neighbour_loss(bending_angles(strands), neighbours)


def smoothness_loss(strands: Float[Tensor, "n l 3"], neighbours: Int[Tensor, "n k"]) -> Float[Tensor, ""]:
    """The paper's ``L_smooth``: neighbours have the same course. The descriptor is the points relative to the root."""
    return _neighbour_loss((strands - strands[:, :1]).flatten(1), neighbours)


def length_loss(strands: Float[Tensor, "n l 3"], neighbours: Int[Tensor, "n k"]) -> Float[Tensor, ""]:
    """The paper's ``L_length``: neighbours are equally long. The descriptor is the arc length."""
    return _neighbour_loss(strand_lengths(strands)[:, None], neighbours)


def pca_consistency_loss(front: Float[Tensor, "f k"], back: Float[Tensor, "b k"]) -> Float[Tensor, ""]:
    """The paper's ``L_pca``: coefficients of the hair behind are distributed as those of the hair in front.

    ``1 / D sum_d w_d (|mu_d^f - mu_d^b| + 1/2 |s_d^f - s_d^b|)`` with ``w_d = exp(-0.05 d)`` and d counted from 1; mu
    is a component's mean over the strands and s its variance (the paper's sigma), as a mean of squared deviations.

    The paper means to regularise the hair behind. Pass ``front.detach()`` where that in front is not to follow it.

    Args:
        front: coefficients of the strands in front, leading component first; see :func:`grows_in_front`.
        back: those of the others.

    Returns:
        The loss; zero where either side has no strands, for then there is nothing to compare.
    """
    if not len(front) or not len(back):
        return front.sum() * 0 + back.sum() * 0
    number = torch.arange(1, front.shape[1] + 1, dtype=front.dtype, device=front.device)
    means = (front.mean(0) - back.mean(0)).abs()
    variances = (front.var(0, correction=0) - back.var(0, correction=0)).abs()
    return (torch.exp(-COMPONENT_DECAY * number) * (means + variances / 2)).mean()


def grows_in_front(roots: Float[Tensor, "n 3"], centre: Float[Tensor, "3"]) -> Bool[Tensor, " n"]:
    """Which strands grow on the front half of the scalp: further along z, out of the face, than the scalp's centre.

    Args:
        roots: head frame, metres.
        centre: of the scalp, such as :attr:`dynhair.strands.ScalpFrame.centre`.
    """
    return roots[:, 2] > centre[2]


def _neighbour_loss(descriptors: Float[Tensor, "n d"], neighbours: Int[Tensor, "n k"]) -> Float[Tensor, ""]:
    # One neighbour at a time: all at once would take k times the memory of the strands.
    sums = [
        (descriptors - descriptors.index_select(0, column)).square().sum() for column in neighbours.long().unbind(1)
    ]
    return torch.stack(sums).sum() / neighbours.numel()
