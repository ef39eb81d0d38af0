"""Hair coloured by how fast each strand moves, and the bar that tells which colour is which speed."""

from __future__ import annotations

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import torch
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from dynhair.avatar import PosedAvatar
from dynhair.avatar.spherical_harmonics import constant_coefficient
from dynhair.pictures import INK, PAPER, Picture

FASTEST = 0.5
"""m/s relative to the head, at the bar's end: about what a brisk turn of the head does to long hair."""

MAP = "plasma"  # perceptually uniform, and no hair colour


def coloured_by_speed(posed: PosedAvatar, speeds: Float[Tensor, " n"]) -> PosedAvatar:
    """The avatar with a colour for each strand's speed.

    Args:
        posed: in any frame.
        speeds: of each canonical strand, m/s.
    """
    look, segments = posed.hair, posed.strands.shape[1] - 1
    shares = (speeds[look.ids] / FASTEST).clamp(0, 1).cpu().numpy()
    colours = torch.from_numpy(mpl.colormaps[MAP](shares)[:, :3]).to(look.base_harmonic)
    base = constant_coefficient(colours).T.repeat_interleave(segments, 1)[None]
    return replace(
        posed, hair=replace(look, base_harmonic=base, higher_harmonics=torch.zeros_like(look.higher_harmonics))
    )


def colour_bar(width: int = 320, height: int = 40) -> Picture:
    """The colours of all speeds, with their numbers below."""
    picture = Image.new("RGB", (width, height), PAPER)
    colours = (mpl.colormaps[MAP](np.linspace(0, 1, width))[:, :3] * 255).round().astype(np.uint8)
    bar = np.repeat(colours[None], height // 2, 0)
    picture.paste(Image.fromarray(bar), (0, 0))
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(height * 0.35)
    for share, anchor in ((0.0, "lm"), (0.5, "mm"), (1.0, "rm")):
        text = f"{share * FASTEST:g} m/s" if share == 1 else f"{share * FASTEST:g}"
        draw.text((share * (width - 1), height * 0.75), text, INK, font, anchor=anchor)
    return np.asarray(picture)
