"""Pictures of a posed avatar, as pages show them and as they are saved."""

from __future__ import annotations

import io

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from dynhair.avatar import Avatar, PosedAvatar
from dynhair.camera import Camera
from dynhair.pictures import Picture


def picture(avatar: Avatar, posed: PosedAvatar, camera: Camera) -> Picture:
    """What the camera sees, on the avatar's background."""
    return _bytes(avatar.draw(posed, [camera]).rgb[0].cpu().numpy())


def cut_out(avatar: Avatar, posed: PosedAvatar, camera: Camera) -> UInt8[np.ndarray, "h w 4"]:
    """What the camera sees, on nothing: straight colours and coverage."""
    images = avatar.draw(posed, [camera])
    alpha = images.alpha[0, ..., None]
    own = (images.rgb[0] - (1 - alpha) * avatar.background) / alpha.clamp_min(1 / 255)
    return np.concatenate([_bytes(own.cpu().numpy()), _bytes(alpha.cpu().numpy())], -1)


def png(pixels: np.ndarray) -> bytes:
    """A picture as a PNG file."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "png")
    return file.getvalue()


def _bytes(values: np.ndarray) -> np.ndarray:
    return (values.clip(0, 1) * 255).round().astype(np.uint8)
