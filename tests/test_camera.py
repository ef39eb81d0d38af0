"""The pinhole camera against OpenCV's formulas."""

from __future__ import annotations

import torch
from scipy.spatial.transform import Rotation

from dynhair.camera import Camera


def camera() -> Camera:
    rotation = torch.from_numpy(Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix())
    w2c = torch.cat([rotation, torch.tensor([[0.1], [0.2], [1.5]], dtype=torch.float64)], 1)
    K = torch.tensor([[500.0, 0, 120], [0, 480, 90], [0, 0, 1]], dtype=torch.float64)
    return Camera(w2c, K, 240, 160)


def test_projection_is_opencvs() -> None:
    view, point = camera(), torch.tensor([0.05, -0.1, 0.2], dtype=torch.float64)
    x, y, z = view.w2c[:, :3] @ point + view.w2c[:, 3]
    pixels, depth = view.project(point)
    torch.testing.assert_close(pixels, torch.stack([500 * x / z + 120, 480 * y / z + 90]))
    torch.testing.assert_close(depth, z)


def test_centre_is_where_the_camera_stands() -> None:
    view = camera()
    torch.testing.assert_close(view.w2c[:, :3] @ view.centre + view.w2c[:, 3], torch.zeros(3, dtype=torch.float64))


def test_resizing_scales_pixels() -> None:
    view, point = camera(), torch.tensor([0.05, -0.1, 0.2], dtype=torch.float64)
    pixels, _ = view.project(point)
    smaller, _ = view.resized(120, 40).project(point)
    torch.testing.assert_close(smaller, pixels / torch.tensor([2.0, 4.0], dtype=torch.float64))
