"""Strands that grow side by side look alike (paper, supplement, "Optimization details": spatial regularisation).

Each loss is the squared difference of a strand's descriptor from its neighbours', averaged over pairs of strand and
neighbour: ``1 / (N k) sum_i sum_j |f_i - f_j|^2``. Neighbours come from :func:`dynhair.strands.root_neighbours`.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from dynhair.strands import bending_angles, strand_lengths


def shape_loss(strands: Float[Tensor, "n l 3"], neighbours: Int[Tensor, "n k"]) -> Float[Tensor, ""]:
    """The paper's ``L_shape``: neighbours bend alike. The descriptor is the bending angles, radians."""
    return _neighbour_loss(bending_angles(strands), neighbours)


def smoothness_loss(strands: Float[Tensor, "n l 3"], neighbours: Int[Tensor, "n k"]) -> Float[Tensor, ""]:
    """The paper's ``L_smooth``: neighbours have the same course. The descriptor is the points relative to the root."""
    return _neighbour_loss((strands - strands[:, :1]).flatten(1), neighbours)


def length_loss(strands: Float[Tensor, "n l 3"], neighbours: Int[Tensor, "n k"]) -> Float[Tensor, ""]:
    """The paper's ``L_length``: neighbours are equally long. The descriptor is the arc length."""
    return _neighbour_loss(strand_lengths(strands)[:, None], neighbours)


def _neighbour_loss(descriptors: Float[Tensor, "n d"], neighbours: Int[Tensor, "n k"]) -> Float[Tensor, ""]:
    # One neighbour at a time: all at once would take k times the memory of the strands.
    sums = [
        (descriptors - descriptors.index_select(0, column)).square().sum() for column in neighbours.long().unbind(1)
    ]
    return torch.stack(sums).sum() / neighbours.numel()
