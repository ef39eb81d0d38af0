"""Preview pictures during training: truth above, avatar below."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import UInt8
from PIL import Image

from dynhair.avatar import AvatarImages
from dynhair.storage import atomic_file
from dynhair.training.batches import Batch


def preview_picture(images: AvatarImages, batch: Batch) -> UInt8[np.ndarray, "h w 3"]:
    """A row of truth and a row of the avatar; for each view its colours and its hair coverage."""

    def row(rgb: torch.Tensor, hair: torch.Tensor) -> torch.Tensor:
        coverage = hair[..., None].expand(-1, -1, -1, 3)
        return torch.cat([tile for view in zip(rgb, coverage, strict=True) for tile in view], dim=1)

    rows = torch.cat([row(batch.rgb, batch.hair), row(images.rgb.detach().cpu(), images.hair.detach().cpu())])
    return (rows.clamp(0, 1) * 255 + 0.5).byte().numpy()


def write_preview(picture: UInt8[np.ndarray, "h w 3"], path: Path) -> None:
    """Write a picture as PNG, atomically."""
    with atomic_file(path) as temporary:
        Image.fromarray(picture).save(temporary)
