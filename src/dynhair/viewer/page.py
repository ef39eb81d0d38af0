"""One browser that looks: the picture that it has, and whether it is due for another."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from dynhair.avatar import Avatar, PosedAvatar
from dynhair.viewer.drawing import picture
from dynhair.viewer.resolution import Resolution
from dynhair.viewer.viewpoint import Viewpoint

if TYPE_CHECKING:
    from viser import ClientHandle, ViserServer  # pyright: ignore[reportMissingImports]

SETTLING = 0.25
"""Seconds without a change after which a page gets its picture in full size."""


class Page:
    """Sends a page its pictures.

    Args:
        client: the page.
        server: that serves it.

    Attributes:
        size: of the last picture, width and height in pixels.
    """

    def __init__(self, client: ClientHandle, server: ViserServer) -> None:
        self._client, self._server = client, server
        self._resolution = Resolution()
        self._drawn: tuple[PosedAvatar, Viewpoint] | None = None
        self._height = 0
        self._changed_at = 0.0
        self.size = (0, 0)

    @property
    def viewpoint(self) -> Viewpoint:
        """Where the page looks from now."""
        camera = self._client.camera
        w, x, y, z = (float(value) for value in camera.wxyz)
        right, up, forward = (float(value) for value in camera.position)
        canvas = max(camera.image_width, 1), max(camera.image_height, 1)
        return Viewpoint((w, x, y, z), (right, up, forward), float(camera.fov), canvas)

    def wait(self, now: float) -> float | None:
        """Seconds until the picture is due to be sharpened; None if it is sharp."""
        if self._drawn is None or self._height >= self._resolution.still(self._drawn[1].canvas[1]):
            return None
        return max(self._changed_at + SETTLING - now, 0.0)

    def show(self, avatar: Avatar, posed: PosedAvatar, posing: float) -> bool:
        """Send a picture if it would be another than the page has.

        Args:
            avatar: that draws.
            posed: what is drawn.
            posing: seconds that posing it took.

        Returns:
            Whether one was sent.
        """
        begin = time.monotonic()
        viewpoint = self.viewpoint
        changed = self._drawn is None or self._drawn[0] is not posed or self._drawn[1] != viewpoint
        if changed:
            self._changed_at = begin
        elif self.wait(begin) != 0:
            return False
        canvas = viewpoint.canvas[1]
        self._height = self._resolution.moving(canvas) if changed else self._resolution.still(canvas)
        factor = 1 if avatar.super_resolution is None else avatar.super_resolution.factor
        image = picture(avatar, posed, viewpoint.camera(self._height, factor))
        if self._client.client_id not in self._server.get_clients():
            return False  # it was closed meanwhile
        self._client.scene.set_background_image(image, "jpeg", jpeg_quality=80 if changed else 92)
        self._client.flush()
        self._drawn, self.size = (posed, viewpoint), (image.shape[1], image.shape[0])
        if changed:
            self._resolution.took(posing + time.monotonic() - begin)
        return True

    def clear(self, avatar: Avatar) -> None:
        """Leave the page the avatar's background, for what the browser draws."""
        if self._drawn is not None or not self.size[0]:
            colour = (avatar.background.clamp(0, 1) * 255).round().byte().cpu().numpy()
            self._client.scene.set_background_image(np.tile(colour, (4, 4, 1)), "png")
            self._drawn, self.size = None, (1, 1)
