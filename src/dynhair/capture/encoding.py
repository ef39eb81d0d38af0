"""Images of a capture as 8-bit arrays, and the encoding of orientation maps.

An orientation map is a grey image with alpha, or one with a palette of such colours. Luminance ``l`` stands for the
angle ``l / 256`` of pi; alpha holds the coherence in 16 steps: its upper four bits, 0 to 15, stand for 0 to 1, and the
lower four are ignored.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image, UnidentifiedImageError
from torch import Tensor

from dynhair.capture.records import View
from dynhair.errors import DynhairError


@dataclass(frozen=True)
class EncodedView:
    """A view as 8-bit arrays, as it is cached."""

    rgb: UInt8[np.ndarray, "h w 3"]
    mask: UInt8[np.ndarray, "h w"]
    hair: UInt8[np.ndarray, "h w"] | None
    orientation: UInt8[np.ndarray, "h w 2"] | None

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(a.nbytes for a in (self.rgb, self.mask, self.hair, self.orientation) if a is not None)

    def decoded(self) -> View:
        """Convert to float32."""
        angle, coherence = (None, None) if self.orientation is None else decode_orientation(self.orientation)
        return View(
            rgb=_unit(self.rgb),
            mask=_unit(self.mask),
            hair=None if self.hair is None else _unit(self.hair),
            orientation=angle,
            coherence=coherence,
        )


def decode_orientation(encoded: UInt8[np.ndarray, "h w 2"]) -> tuple[Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    """Convert an orientation map to angles in [0, 1) of pi and coherence in [0, 1]."""
    pixels = torch.from_numpy(encoded)
    return pixels[..., 0].float().div_(256), (pixels[..., 1] >> 4).float().div_(15)


def encode_orientation(
    angle: Float[np.ndarray, "h w"],
    coherence: Float[np.ndarray, "h w"],
    *,
    angle_step: int = 1,
    coherence_levels: int = 16,
) -> UInt8[np.ndarray, "h w 2"]:
    """Compute the pixels of an orientation map.

    Args:
        angle: undirected, in units of pi; taken modulo 1.
        coherence: in [0, 1].
        angle_step: round angles to this multiple of pi / 256, for smaller files.
        coherence_levels: round coherence to so many levels, 2 to 16, for smaller files.
    """
    steps = np.round(angle * 256 / angle_step).astype(np.int64) * angle_step % 256
    levels = np.round(np.clip(coherence, 0, 1) * (coherence_levels - 1)) / (coherence_levels - 1)
    return np.stack([steps, np.round(levels * 15).astype(np.int64) << 4], -1).astype(np.uint8)


def read_rgb(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """Read a colour image.

    Raises:
        DynhairError: the file is missing, truncated or not an image; so for all readers here.
    """
    with open_image(path) as image:
        return np.array(image.convert("RGB"))


def read_mask(path: Path) -> UInt8[np.ndarray, "h w"]:
    """Read a mask: a grey image, or the first channel of one with several."""
    with open_image(path) as image:
        if image.mode in ("L", "LA", "RGB", "RGBA"):
            return np.array(image.getchannel(0))
        return np.array(image.convert("L"))


def read_orientation(path: Path) -> UInt8[np.ndarray, "h w 2"]:
    """Read an orientation map as luminance and alpha."""
    with open_image(path) as image:
        if image.mode == "P" and "transparency" in image.info:
            return np.array(image.convert("RGBA"))[..., [0, 3]]
        if image.mode != "LA":
            raise DynhairError(
                f"an orientation map of mode {image.mode}",
                path=path,
                expected="LA: angle as luminance, coherence as alpha",
                mend="write it as a grey PNG with alpha, or with a palette of such colours",
            )
        return np.array(image)


def read_size(path: Path) -> tuple[int, int]:
    """Read an image's width and height from its header."""
    with open_image(path) as image:
        return image.size


@contextmanager
def open_image(path: Path) -> Iterator[Image.Image]:
    """Open an image; whatever fails inside the block for its damage is a DynhairError too."""
    try:
        with Image.open(path) as image:
            yield image
    except FileNotFoundError:
        raise DynhairError("the file is missing", path=path) from None
    except (DynhairError, MemoryError):
        raise
    except UnidentifiedImageError:
        raise _unreadable(path, "is not an image") from None
    except Exception as error:  # damaged files make Pillow's decoders raise all sorts
        raise _unreadable(path, f"is damaged ({error})") from None


def _unreadable(path: Path, found: str) -> DynhairError:
    return DynhairError(found, path=path, expected="a whole JPEG or PNG", mend="write it again")


def _unit(pixels: np.ndarray) -> Tensor:
    return torch.from_numpy(pixels).float().div_(255)
