"""The avatar as the browser draws it: splats, or strands as lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from torch import Tensor

from dynhair.avatar import Avatar, PosedAvatar
from dynhair.avatar.drawn_hair import COLOURS, drawn_hair
from dynhair.camera import Camera
from dynhair.export.colours import linear_colours
from dynhair.render import Gaussians
from dynhair.render.reference import quaternion_matrix
from dynhair.strands import strands_and_body
from dynhair.viewer.settings import Display

if TYPE_CHECKING:
    from viser import GaussianSplatHandle, LineSegmentsHandle, SceneApi  # pyright: ignore[reportMissingImports]

MOST_SEGMENTS = 60_000
"""Of lines; of more strands every second, third, ... is shown. One takes 30 bytes on the way, and a quad to draw."""

CENTIMETRE = 0.01
"""Covariances travel in half precision: in m^2 those of hair would be lost, in cm^2 they have 11 bits."""

BYTES_OF_SPLAT = 32
"""As viser packs one: position, covariance, colour."""


class BrowserScene:
    """Keeps what the browsers draw up to date; the same for all of them.

    Args:
        scene: of the server.
        avatar: whose poses are shown.
        eye: colours are those that this camera sees; they do not change with the view in the browser.
    """

    def __init__(self, scene: SceneApi, avatar: Avatar, eye: Camera) -> None:
        self._scene, self._avatar, self._eye = scene, avatar, eye
        self._splats: GaussianSplatHandle | None = None
        self._lines: LineSegmentsHandle | None = None

    def show(self, posed: PosedAvatar, display: Display) -> int:
        """Show a pose; nothing of it where pictures are shown instead.

        Returns:
            Bytes that go to each page.
        """
        if display != "strands" and self._lines is not None:
            self._lines.remove()
            self._lines = None
        if display == "image":
            if self._splats is not None:
                self._splats.remove()
                self._splats = None
            return 0
        drawn = browser_splats(self._avatar, posed, self._eye)
        if display == "splats":
            return self._show_splats(drawn)
        segments = posed.strands.shape[0] * (posed.strands.shape[1] - 1)
        head = Gaussians(*(part[segments:] for part in vars(drawn).values()))
        return self._show_lines(*strand_lines(posed.strands, drawn)) + self._show_splats(head)

    def _show_splats(self, drawn: Gaussians) -> int:
        means, covariances = scaled_moments(drawn)
        colours, opacities = drawn.features.clamp(0, 1).cpu().numpy(), drawn.opacities[:, None].cpu().numpy()
        if self._splats is None:
            self._splats = self._scene.add_gaussian_splats(
                "/splats", means, covariances, colours, opacities, scale=CENTIMETRE
            )
        else:
            self._splats.set_gaussians(means, covariances, colours, opacities)
        return BYTES_OF_SPLAT * len(means)

    def _show_lines(self, ends: Float32[np.ndarray, "s 2 3"], colours: UInt8[np.ndarray, "s 2 3"]) -> int:
        if self._lines is None:
            self._lines = self._scene.add_line_segments(
                "/strands", ends, colours, thickness=1.5, thickness_units="screen"
            )
        else:
            self._lines.points, self._lines.colors = ends, colours
        return ends.nbytes + colours.nbytes


def browser_splats(avatar: Avatar, posed: PosedAvatar, eye: Camera) -> Gaussians:
    """Hair and head in the colours that one camera sees.

    They are :class:`~dynhair.export.splats.Splats` without harmonics, which would take several times as long.
    """
    head, look = posed.head, posed.hair
    hair = drawn_hair(posed.strands, look.widths, look.base_harmonic, look.higher_harmonics, [eye])
    colours = hair.features[..., COLOURS]
    rows, cover, of_scalp = avatar.scalp(colours, look)
    of_head = head.colours[:, :3].clone()
    of_head[rows] = torch.lerp(of_head[rows], of_scalp[0], cover[:, None])
    return strands_and_body(hair, head, torch.cat([colours[0], of_head]).clamp_min(0))


def scaled_moments(drawn: Gaussians) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n 3 3"]]:
    """Means in cm and covariances in cm^2."""
    axes = quaternion_matrix(drawn.quats) * (drawn.scales / CENTIMETRE)[:, None]
    return (drawn.means / CENTIMETRE).cpu().numpy(), (axes @ axes.mT).cpu().numpy()


def strand_lines(
    strands: Float[Tensor, "m l 3"], drawn: Gaussians
) -> tuple[Float32[np.ndarray, "s 2 3"], UInt8[np.ndarray, "s 2 3"]]:
    """Ends and colours of the segments of as many strands as a browser draws quickly.

    A strand has its mean colour: those of single segments, which nobody saw by themselves, would be confetti.

    Args:
        strands: world, metres.
        drawn: whose first Gaussians are the strands', in their order.

    Returns:
        World, metres; and linear colours, which is what lines are lit with, while splats and pictures are sRGB.
    """
    count, segments = strands.shape[0], strands.shape[1] - 1
    every = -(-count * segments // MOST_SEGMENTS)
    ends = torch.stack([strands[::every, :-1], strands[::every, 1:]], 2).flatten(0, 1)
    colours = drawn.features[: count * segments].view(count, segments, 3)[::every].mean(1).clamp(0, 1)
    pixels = (linear_colours(colours.cpu().numpy()) * 255).round().astype(np.uint8)
    return ends.cpu().numpy(), pixels.repeat(2 * segments, 0).reshape(-1, 2, 3)
