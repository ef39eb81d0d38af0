"""What is drawn, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Gaussians:
    """Anisotropic 3D Gaussians in the world.

    Attributes:
        means: centres, metres.
        quats: rotations, wxyz; need not be normalised.
        scales: standard deviations along the rotated axes, metres.
        opacities: in [0, 1].
        features: channels to blend: shared by all views ``(n, c)``, or one set for each ``(v, n, c)``.
    """

    means: Float[Tensor, "n 3"]
    quats: Float[Tensor, "n 4"]
    scales: Float[Tensor, "n 3"]
    opacities: Float[Tensor, " n"]
    features: Float[Tensor, "n c"] | Float[Tensor, "v n c"]


@dataclass(frozen=True)
class Rendering:
    """Images of Gaussians from ``v`` cameras.

    Attributes:
        features: blended channels over the background.
        alpha: accumulated opacity in [0, 1].
        depth: expected depth along the optical axis, metres; 0 where nothing was hit.
    """

    features: Float[Tensor, "v h w c"]
    alpha: Float[Tensor, "v h w"]
    depth: Float[Tensor, "v h w"]
