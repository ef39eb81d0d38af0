"""Pinhole cameras: OpenCV axes (x right, y down, z forward), pixel centres at (i + 0.5, j + 0.5)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Camera:
    """One calibrated view.

    Attributes:
        w2c: world-to-camera ``[R | t]``, metres.
        K: intrinsics in pixels; skew is not supported.
        width: image width in pixels.
        height: image height in pixels.
    """

    w2c: Float[Tensor, "3 4"]
    K: Float[Tensor, "3 3"]
    width: int
    height: int

    @property
    def centre(self) -> Float[Tensor, "3"]:
        """The camera's position in the world, metres."""
        return -self.w2c[:, :3].T @ self.w2c[:, 3]

    def project(self, points: Float[Tensor, "*n 3"]) -> tuple[Float[Tensor, "*n 2"], Float[Tensor, "*n"]]:
        """World points to pixels and depths (metres along the optical axis; negative behind the camera)."""
        local = points @ self.w2c[:, :3].T + self.w2c[:, 3]
        pixels = local @ self.K.T
        return pixels[..., :2] / pixels[..., 2:], local[..., 2]

    def resized(self, width: int, height: int) -> Camera:
        """The same view at another resolution."""
        scale = torch.tensor([[width / self.width], [height / self.height], [1.0]], dtype=self.K.dtype)
        return Camera(self.w2c, self.K * scale.to(self.K.device), width, height)

    def to(self, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> Camera:
        """A copy on ``device`` in ``dtype``."""
        return Camera(self.w2c.to(device, dtype), self.K.to(device, dtype), self.width, self.height)
