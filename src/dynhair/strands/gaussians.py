"""Strands as Gaussians: one for each segment, as long as the segment and as thick as the strand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.render import Gaussians

NEGLIGIBLE_LENGTH = 1e-6
"""Metres. Segment lengths are softened by this much, so that one without length still has finite gradients."""


@dataclass(frozen=True)
class StrandGaussians:
    """The Gaussians of ``N`` strands of ``L`` points, ``n = N * (L - 1)``, strand by strand, root first.

    Attributes:
        means: midpoints of the segments.
        quats: rotations from the x axis to the segments, wxyz.
        scales: standard deviations along the segment, and twice across it.
        directions: unit directions from root to tip; zero for a segment without length.
    """

    means: Float[Tensor, "n 3"]
    quats: Float[Tensor, "n 4"]
    scales: Float[Tensor, "n 3"]
    directions: Float[Tensor, "n 3"]


def root_taper(segments: int, *, length: int = 4, root: float = 0.25) -> Float[Tensor, " s"]:
    """Factors that narrow a strand towards its root, "to reduce visual artifacts at the scalp boundary" (paper).

    Args:
        segments: segments of the strand.
        length: how many segments from the root are narrowed.
        root: the factor at the root itself, from which it rises linearly to 1.

    Returns:
        The factor in the middle of each segment.
    """
    middle = torch.arange(segments) + 0.5
    return (root + (1 - root) * middle / length).clamp_max(1)


def strand_gaussians(
    strands: Float[Tensor, "n l 3"], width: float | Float[Tensor, " n"], taper: Float[Tensor, " s"] | None = None
) -> StrandGaussians:
    """Put a Gaussian on each segment of each strand.

    Paper, "Strand-aligned Gaussian rendering" and appendix "Gaussian Splatting for hair rasterization": means at the
    midpoints, standard deviation along the segment half its length, rotation by parallel transport from the x axis.
    That rotation, ``normalise([1 + a.b, a x b])`` for the x axis ``a`` and direction ``b``, does not exist where ``b``
    points against ``a``. A Gaussian is the same turned end for end, so ``b`` is first turned into the half-space of
    positive x, and the rotation is well conditioned for every segment.

    Args:
        strands: polylines, metres.
        width: full width of a strand, metres, of all or of each; the standard deviation across is half of it.
        taper: factor on the width of each of the ``L - 1`` segments, see :func:`root_taper`; 1 if not given.

    Returns:
        Gaussians on the strands' device, differentiable in ``strands`` with finite gradients for all segments.
    """
    segments = strands.diff(dim=1)
    x, y, z = segments.unbind(-1)
    length = torch.sqrt(x * x + y * y + z * z + NEGLIGIBLE_LENGTH**2)
    x, y, z = x / length, y / length, z / length
    half_cosine = torch.sqrt(0.5 + 0.5 * x.abs())
    half_sine = torch.copysign(0.5 / half_cosine, x)

    across = torch.as_tensor(width / 2, dtype=length.dtype, device=length.device)[..., None].expand_as(length)
    if taper is not None:
        across = across * taper.to(length)
    return StrandGaussians(
        means=torch.lerp(strands[:, :-1], strands[:, 1:], 0.5).flatten(0, 1),
        quats=torch.stack([half_cosine, torch.zeros_like(x), -half_sine * z, half_sine * y], dim=-1).flatten(0, 1),
        scales=torch.stack([length / 2, across, across], dim=-1).flatten(0, 1),
        directions=torch.stack([x, y, z], dim=-1).flatten(0, 1),
    )


@runtime_checkable
class _Placed(Protocol):
    @property
    def means(self) -> Tensor: ...

    @property
    def quats(self) -> Tensor: ...

    @property
    def scales(self) -> Tensor: ...


@runtime_checkable
class _Body(_Placed, Protocol):
    @property
    def opacities(self) -> Tensor: ...


def strands_and_body(
    strands: _Placed, body: _Body, features: Float[Tensor, "n c"] | Float[Tensor, "v n c"]
) -> Gaussians:
    """Strands, opaque, and the body that they grow on, to be drawn in one pass.

    Args:
        strands: their Gaussians.
        body: its Gaussians.
        features: of the strands' Gaussians and then of the body's, see :class:`~dynhair.render.Gaussians`.
    """
    return Gaussians(
        means=torch.cat([strands.means, body.means]),
        quats=torch.cat([strands.quats, body.quats]),
        scales=torch.cat([strands.scales, body.scales]),
        opacities=torch.cat([strands.means.new_ones(len(strands.means)), body.opacities]),
        features=features,
    )
