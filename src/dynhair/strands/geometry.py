"""Strands as polylines ``(N, L, 3)``, root first: lengths, bending, resampling, smoothing."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError


def segment_lengths(strands: Float[Tensor, "*n l 3"]) -> Float[Tensor, "*n s"]:
    """Measure the ``L - 1`` segments of each strand, in the strands' unit; the gradient of a zero length is zero."""
    return torch.linalg.vector_norm(strands.diff(dim=-2), dim=-1)


def strand_lengths(strands: Float[Tensor, "*n l 3"]) -> Float[Tensor, "*n"]:
    """Measure the arc length of each strand, in the strands' unit."""
    return segment_lengths(strands).sum(dim=-1)


def bending_angles(strands: Float[Tensor, "*n l 3"]) -> Float[Tensor, "*n b"]:
    """Measure the angles between consecutive segments of each strand (paper, supplement, "Shape consistency").

    The paper's arccos has an infinite gradient on a straight strand; the same angle as an arctangent has not.

    Args:
        strands: polylines of at least three points.

    Returns:
        ``L - 2`` angles in [0, pi], radians; 0, with a zero gradient, beside a segment without length.
    """
    directions = torch.nn.functional.normalize(strands.diff(dim=-2), dim=-1)
    before, after = directions[..., :-1, :], directions[..., 1:, :]
    sine = torch.linalg.vector_norm(torch.linalg.cross(before, after, dim=-1), dim=-1)
    cosine = (before * after).sum(dim=-1)
    undefined = (sine == 0) & (cosine == 0)
    return torch.atan2(sine, torch.where(undefined, 1.0, cosine))


def resample_strands(strands: Float[Tensor, "n l 3"], count: int) -> Float[Tensor, "n k 3"]:
    """Place ``count`` points at equal steps of arc length along each strand.

    Roots and tips are kept exactly. Differentiable in the points; a strand without length stays where it is.

    Args:
        strands: polylines of at least two points.
        count: points of each new strand, at least two.

    Raises:
        DynhairError: ``count`` is less than two.
    """
    if count < 2:
        raise DynhairError(f"strands cannot be resampled to {count} points", expected="at least 2")
    lengths = segment_lengths(strands)
    along = torch.nn.functional.pad(lengths.cumsum(dim=-1), (1, 0))
    steps = torch.linspace(0, 1, count, dtype=strands.dtype, device=strands.device)[1:-1]
    targets = along[:, -1:] * steps
    segments = torch.searchsorted(along.detach(), targets.detach(), right=True).sub_(1).clamp_(0, lengths.shape[1] - 1)
    shortest = torch.finfo(strands.dtype).tiny ** 0.5
    weights = (targets - along.gather(1, segments)) / lengths.gather(1, segments).clamp_min(shortest)
    index = segments[..., None].expand(-1, -1, 3)
    starts, ends = strands[:, :-1].gather(1, index), strands[:, 1:].gather(1, index)
    inner = starts + weights.clamp(0, 1)[..., None] * (ends - starts)
    return torch.cat([strands[:, :1], inner, strands[:, -1:]], dim=1)


def smooth_strands(strands: Float[Tensor, "*n l 3"]) -> Float[Tensor, "*n l 3"]:
    """Replace each inner point by the average of itself and its two neighbours; roots and tips are kept.

    One pass of a low-pass filter along the strand (paper, supplement, "Dynamic training stage").
    """
    inner = (strands[..., :-2, :] + strands[..., 1:-1, :] + strands[..., 2:, :]) / 3
    return torch.cat([strands[..., :1, :], inner, strands[..., -1:, :]], dim=-2)


def with_lengths(strands: Float[Tensor, "n l 3"], rest: Float[Tensor, "n l 3"]) -> Float[Tensor, "n l 3"]:
    """The directions of some strands with the roots and segment lengths of others: these, bent without being stretched.

    Args:
        strands: give the direction of each segment; one without length draws its segment together to a point.
        rest: give the roots and the lengths.
    """
    segments = strands.diff(dim=1)
    shortest = torch.finfo(strands.dtype).tiny ** 0.5
    stretch = segments.square().sum(-1).clamp_min(shortest).rsqrt() * segment_lengths(rest)
    return torch.cat([rest[:, :1], rest[:, :1] + (segments * stretch[..., None]).cumsum(1)], dim=1)


def cut_strands(strands: Float[Tensor, "n l 3"], lengths: Float[Tensor, " n"], count: int) -> Float[Tensor, "n k 3"]:
    """The first ``lengths`` metres of each strand as ``count`` points at equal steps of arc length.

    Args:
        strands: polylines, root first.
        lengths: at most the strands' own.
        count: points of each new strand.
    """
    along = torch.nn.functional.pad(segment_lengths(strands).cumsum(dim=-1), (1, 0))
    steps = torch.linspace(0, 1, count, dtype=strands.dtype, device=strands.device)
    targets = lengths[:, None] * steps
    upper = torch.searchsorted(along, targets.contiguous()).clamp(1, strands.shape[1] - 1)
    below, above = along.gather(1, upper - 1), along.gather(1, upper)
    share = ((targets - below) / (above - below).clamp_min(1e-12)).clamp(0, 1)[..., None]
    index = upper[..., None].expand(-1, -1, 3)
    return (1 - share) * strands.gather(1, index - 1) + share * strands.gather(1, index)
