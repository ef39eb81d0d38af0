"""Hair masks made elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, UnidentifiedImageError

from dynhair.errors import DynhairError

LIP_HAIR = 2
"""Hair in the label maps of networks trained on LIP (Look into Person), CDGNet among them."""
_LABEL_MODES = ("L", "P", "1", "I;16", "I")
_MASK_MODES = ("L", "1", "LA", "RGB", "RGBA")


def read_hair_mask(path: Path, hair_label: int | None = None) -> UInt8[np.ndarray, "h w"]:
    """Read a hair mask or a label map.

    Args:
        path: a grey or palette picture without loss, PNG for instance.
        hair_label: the hair's label if the file is a label map (:data:`LIP_HAIR` for CDGNet's); None if it is a grey
            mask, white where there is hair.

    Returns:
        The hair's coverage in the file's own size; only 0 and 255 from a label map.

    Raises:
        DynhairError: the file is missing, is no picture, or holds other values than ``hair_label`` lets expect.
    """
    try:
        with Image.open(path) as picture:
            picture.load()
    except FileNotFoundError:
        raise DynhairError("the file is missing", path=path) from None
    except (OSError, UnidentifiedImageError) as error:
        raise DynhairError(f"not readable as a picture ({error})", path=path, expected="a PNG file") from None
    return _coverage(picture, path) if hair_label is None else _labelled(picture, hair_label, path)


def _labelled(picture: Image.Image, hair_label: int, path: Path) -> UInt8[np.ndarray, "h w"]:
    if picture.mode not in _LABEL_MODES:
        raise DynhairError(
            f"a picture of colours (mode {picture.mode})",
            path=path,
            expected="a label map: a grey or palette picture of class numbers",
            mend="save the labels themselves, not a coloured view of them",
        )
    labels = np.asarray(picture)
    found = np.unique(labels)
    if len(found) > 64 or (hair_label not in found and set(found.tolist()) >= {0, 255}):
        raise DynhairError(
            f"holds {_listed(found)}, not class numbers",
            path=path,
            expected=f"a label map with hair = {hair_label}",
            mend="give no hair label if the file is a mask, white where there is hair",
        )
    return np.where(labels == hair_label, 255, 0).astype(np.uint8)


def _coverage(picture: Image.Image, path: Path) -> UInt8[np.ndarray, "h w"]:
    if picture.mode not in _MASK_MODES:
        raise DynhairError(
            f"a picture of mode {picture.mode}",
            path=path,
            expected="a grey mask of 8 bits, white where there is hair",
            mend="name the hair's label if the file is a label map",
        )
    channels = np.asarray(picture.convert("RGB"))
    if (channels != channels[..., :1]).any():
        raise DynhairError(
            "a picture in colours",
            path=path,
            expected="a grey mask, white where there is hair",
            mend="save the mask itself, not a coloured view of it",
        )
    mask = np.ascontiguousarray(channels[..., 0])
    if 0 < mask.max() < 128 and len(np.unique(mask)) <= 64:
        raise DynhairError(
            f"holds {_listed(np.unique(mask))}, too dark for a mask",
            path=path,
            expected="a grey mask, white (255) where there is hair",
            mend="name the hair's label if the file is a label map",
        )
    return mask


def _listed(values: np.ndarray) -> str:
    shown = ", ".join(str(value) for value in values[:12])
    return f"the values {shown}" + (", ..." if len(values) > 12 else "")
