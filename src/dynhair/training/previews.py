"""Preview pictures during training: truth above, avatar below."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from dynhair.avatar import AvatarImages
from dynhair.pictures import grid
from dynhair.storage import atomic_file
from dynhair.training.batches import Batch
from dynhair.training.rest_scene import RestScene
from dynhair.training.static_model import Paint
from dynhair.training.static_scene import render_painted_hair

_TILE = 160


def preview_picture(images: AvatarImages, batch: Batch) -> UInt8[np.ndarray, "h w 3"]:
    """A row of truth and a row of the avatar; for each view its colours and its hair coverage."""

    def row(rgb: torch.Tensor, hair: torch.Tensor) -> torch.Tensor:
        coverage = hair[..., None].expand(-1, -1, -1, 3)
        return torch.cat([tile for view in zip(rgb, coverage, strict=True) for tile in view], dim=1)

    rows = torch.cat([row(batch.rgb, batch.hair), row(images.rgb.detach().cpu(), images.hair.detach().cpu())])
    return _picture(rows)


def write_preview(picture: UInt8[np.ndarray, "h w 3"], path: Path) -> None:
    """Write a picture as PNG, atomically."""
    with atomic_file(path) as temporary:
        Image.fromarray(picture).save(temporary)


def hairstyle_picture(
    strands: Float[Tensor, "n l 3"], width: float, scene: RestScene, paint: Paint, background: Float[Tensor, "3"]
) -> UInt8[np.ndarray, "h w 3"]:
    """The hair at rest in every view: the image, the strands in its colours, and the directions of both as hues."""
    views = scene.views.resized(_TILE)
    colours = paint.segments(strands.shape[1] - 1)
    with torch.no_grad():
        drawn = render_painted_hair(strands, width, scene.body, views.cameras, colours, paint.body)
    rgb = drawn.rgb + (1 - drawn.alpha)[..., None] * background
    rows = [views.rgb, rgb, _hues(views.direction), _hues(drawn.direction)]
    pictures = [[_picture(image) for image in row] for row in rows]
    labels = ["image", "strands", "direction", "strands' direction"]
    return grid(pictures, labels, [str(place) for place in range(len(views))])


def _hues(direction: Float[Tensor, "v h w 2"]) -> Float[Tensor, "v h w 3"]:
    """Directions as hues, which close like undirected angles do; their weight is the brightness."""
    hue = torch.atan2(direction[..., 1], direction[..., 0])[..., None]
    thirds = torch.tensor([0.0, 2.0, 4.0]) * torch.pi / 3
    return (0.5 + 0.5 * torch.cos(hue - thirds)) * direction.norm(dim=-1, keepdim=True)


def _picture(image: Float[Tensor, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    return (image.clamp(0, 1) * 255 + 0.5).byte().numpy()
