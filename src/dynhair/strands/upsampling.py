"""Strands of a scalp texture carried over to any roots on the scalp."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from dynhair.errors import DynhairError


class _Cells(NamedTuple):
    """The 2 x 2 texels around each root: their flat indices and bilinear weights; invalid ones weigh nothing."""

    texels: Int[Tensor, "n 4"]
    weights: Float[Tensor, "n 4"]


def upsample(
    strands: Float[Tensor, "s s l 3"], valid: Bool[Tensor, "s s"], uv: Float[Tensor, "n 2"]
) -> Float[Tensor, "n l 3"]:
    """Interpolate a texture of strands at roots, without averaging strands that part (Im2Haircut).

    Bilinear interpolation of strands that run different ways gives strands that nobody has: shorter and through the
    middle. So it is blended with the nearest texel's strand, at a share of this that depends on the similarity ``c``
    of neighbouring strands: ``alpha`` = 1 - 1.63 c^5 up to c = 0.9, and 0.4 - 0.4 c above. Here each neighbour of the
    nearest texel has a ``c`` and an ``alpha`` of its own: a root beside a parting is still interpolated along it.

    Two strands' similarity is the mean cosine between their corresponding segments: it looks at courses alone, not at
    lengths, and a strand's tip counts no more than its root. Opposed strands (c < 0) are not blended at all.

    Args:
        strands: one for each texel (row, column), in normal form; whatever invalid texels hold is never looked at.
        valid: which texels lie on the scalp.
        uv: texture coordinates of the roots.

    Returns:
        A strand for each root; differentiable in ``strands``. A root whose four texels are all invalid has the strand
        of the nearest valid texel.

    Raises:
        DynhairError: no texel is valid.
    """
    if not bool(valid.any()):
        raise DynhairError("a texture without valid texels has no strands to interpolate", expected="a scalp's mask")
    flat = torch.where(valid[..., None, None], strands, 0).flatten(0, 1)
    cells = _surrounding_texels(valid, uv.to(strands))
    nearest = cells.weights.argmax(dim=1, keepdim=True)
    # A neighbour hands the share of its weight that is not blended in to the nearest texel.
    withheld = cells.weights * _share_of_nearest(_similarity(flat, cells.texels, nearest))
    weights = (cells.weights - withheld).scatter_add(1, nearest, withheld.sum(dim=1, keepdim=True))
    # One fused weighted sum over the four texels, in place of four gathered copies of all strands.
    blended = torch.nn.functional.embedding_bag(cells.texels, flat.flatten(1), per_sample_weights=weights, mode="sum")
    return blended.unflatten(1, strands.shape[2:])


def _share_of_nearest(similarity: Float[Tensor, "n 4"]) -> Float[Tensor, "n 4"]:
    similarity = similarity.clamp(0, 1)
    return torch.where(similarity <= 0.9, 1 - 1.63 * similarity**5, 0.4 - 0.4 * similarity)


def _surrounding_texels(valid: Bool[Tensor, "s s"], uv: Float[Tensor, "n 2"]) -> _Cells:
    """Find the texels that roots lie between; where none of the four can be used, the nearest valid one alone."""
    size = len(valid)
    place = (uv * size - 0.5).clamp(0, size - 1)
    corner = place.floor().clamp(max=max(size - 2, 0))
    u, v = (place - corner).unbind(dim=-1)
    column, row = corner.long().unbind(dim=-1)
    right = min(size - 1, 1)
    first = row * size + column
    texels = torch.stack([first, first + right, first + right * size, first + right * size + right], dim=-1)
    weights = torch.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], dim=-1)
    weights = weights * valid.flatten()[texels]
    total = weights.sum(dim=-1)
    alone = (total <= 0).nonzero().squeeze(1)
    if len(alone):
        choices = valid.nonzero()
        distances = torch.cdist(place[alone], choices.flip(-1).to(place))
        row, column = choices[distances.argmin(dim=1)].unbind(dim=-1)
        texels = texels.index_put((alone,), (row * size + column)[:, None].expand(-1, 4))
        weights = weights.index_put((alone,), weights.new_tensor([1.0, 0, 0, 0]))
        total = total.index_fill(0, alone, 1)
    return _Cells(texels, weights / total[:, None])


def _similarity(
    flat: Float[Tensor, "t l 3"], texels: Int[Tensor, "n 4"], nearest: Int[Tensor, "n 1"]
) -> Float[Tensor, "n 4"]:
    """Compare the strand of each root's nearest texel with those of its four texels."""
    courses = torch.nn.functional.normalize(flat.diff(dim=1), dim=-1).flatten(1) / (flat.shape[1] - 1) ** 0.5
    # Roots in one cell share their comparisons, and a texture has fewer cells than a head has roots.
    pairs, which = (texels.gather(1, nearest) * len(flat) + texels).unique(return_inverse=True)
    return (courses[pairs // len(flat)] * courses[pairs % len(flat)]).sum(dim=-1)[which]
