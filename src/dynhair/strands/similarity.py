"""Similarities: scale, rotation and translation, several at a time, and how they are fitted to pairs of points."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor


@dataclass(frozen=True)
class Similarities:
    """``x -> scale * rotation @ x + translation``, ``h`` of them, in float64.

    Attributes:
        scale: factors.
        rotation: rotation matrices.
        translation: shifts.
    """

    scale: Float[Tensor, " h"]
    rotation: Float[Tensor, "h 3 3"]
    translation: Float[Tensor, "h 3"]

    @classmethod
    def identity(cls) -> Similarities:
        """The one that changes nothing."""
        one = torch.ones(1, dtype=torch.float64)
        return cls(one, torch.eye(3, dtype=torch.float64)[None], torch.zeros(1, 3, dtype=torch.float64))

    def __getitem__(self, chosen: list[int]) -> Similarities:
        """Some of them."""
        return Similarities(self.scale[chosen], self.rotation[chosen], self.translation[chosen])

    def where(self, chosen: Bool[Tensor, " h"], other: Similarities) -> Similarities:
        """Those chosen, and the other ones in the places of the rest."""
        return Similarities(
            torch.where(chosen, self.scale, other.scale),
            torch.where(chosen[:, None, None], self.rotation, other.rotation),
            torch.where(chosen[:, None], self.translation, other.translation),
        )

    def apply(self, points: Float[Tensor, "#h n 3"]) -> Float[Tensor, "h n 3"]:
        """Move points, those of each similarity or the same for all."""
        return self.scale[:, None, None] * points @ self.rotation.mT + self.translation[:, None]


def closest_similarities(
    source: Float[Tensor, "h n 3"],
    target: Float[Tensor, "h n 3"],
    weights: Float[Tensor, "h n"],
    rotation: Float[Tensor, "h 3 3"] | None = None,
) -> Similarities:
    """Bring weighted points closest to others, never mirrored (Umeyama, PAMI 1991, eq. 39 to 43).

    Args:
        source: points to move, float64.
        target: where they should be.
        weights: of the pairs, not negative; their scale does not matter.
        rotation: to keep; the best ones by default.
    """
    shares = (weights / weights.sum(dim=1, keepdim=True))[..., None]
    from_mean, to_mean = (shares * source).sum(dim=1), (shares * target).sum(dim=1)
    centred = source - from_mean[:, None]
    covariance = (shares * (target - to_mean[:, None])).mT @ centred
    kept = _closest_rotations(covariance) if rotation is None else rotation
    scale = (kept * covariance).sum(dim=(1, 2)) / (shares * centred.square()).sum(dim=(1, 2))
    return Similarities(scale, kept, to_mean - scale[:, None] * (kept @ from_mean[..., None])[..., 0])


def _closest_rotations(covariance: Tensor) -> Tensor:
    left, singular, right = torch.linalg.svd(covariance)
    signs = torch.ones_like(singular)
    signs[:, 2] = torch.sign(torch.linalg.det(left @ right))
    return (left * signs[:, None]) @ right
