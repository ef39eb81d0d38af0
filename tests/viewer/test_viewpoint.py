from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.viewer.viewpoint import Viewpoint, field_of_view

TURN = Rotation.from_euler("xyz", (0.2, 2.8, 0.1))
W, X, Y, Z = TURN.as_quat(scalar_first=True)
SEEN = Viewpoint((W, X, Y, Z), (0.3, 0.8, 1.1), 0.7, (1280, 800))


def test_the_camera_stands_where_the_browsers_stands() -> None:
    camera = SEEN.camera(400)
    np.testing.assert_allclose(camera.centre.numpy(), SEEN.position, atol=1e-6)
    np.testing.assert_allclose(camera.w2c[:, :3].numpy(), TURN.as_matrix().T, atol=1e-6)
    assert (camera.width, camera.height) == (640, 400)
    assert field_of_view(camera) == pytest.approx(0.7)


@given(height=st.integers(8, 1080), multiple=st.sampled_from([1, 2, 8]), wide=st.integers(100, 3000))
def test_a_corner_of_the_page_is_a_corner_of_the_picture(height: int, multiple: int, wide: int) -> None:
    seen = Viewpoint(SEEN.wxyz, SEEN.position, SEEN.fov, (wide, 800))
    camera = seen.camera(height, multiple)
    assert camera.width % multiple == camera.height % multiple == 0
    half = math.tan(seen.fov / 2)
    corner = TURN.apply([half * wide / 800, half, 1.0]) + seen.position
    pixel, depth = camera.project(torch.from_numpy(corner).float())
    np.testing.assert_allclose(pixel.numpy(), [camera.width, camera.height], rtol=1e-4)
    assert float(depth) == pytest.approx(1.0, abs=1e-5)


def test_a_page_without_area_still_has_a_picture() -> None:
    camera = Viewpoint(SEEN.wxyz, SEEN.position, SEEN.fov, (1, 1)).camera(1)
    assert (camera.width, camera.height) == (1, 1)
