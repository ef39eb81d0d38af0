from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.preprocess.options import Crop, Size
from dynhair.preprocess.sources.geometry import Rectifier
from dynhair.preprocess.sources.recording import SourceCamera

STORED = (320, 240)
K = np.array([[300.0, 0, 158.2], [0, 305, 121.7], [0, 0, 1]])
W2C = np.c_[np.eye(3), np.zeros(3)]
PINHOLE_DISTORTION = (-0.2, 0.08, 0.002, -0.003, 0.01)
FISHEYE_DISTORTION = (-0.05, 0.02, -0.01, 0.003)


def camera(distortion: tuple[float, ...] = (), *, fisheye: bool = False) -> SourceCamera:
    return SourceCamera(W2C, K, np.array(distortion), fisheye)


def distorted(direction: np.ndarray, distortion: tuple[float, ...], *, fisheye: bool) -> np.ndarray:
    """Where the lens shows a direction: Brown's and Kannala's models, written out."""
    x, y = direction[:2] / direction[2]
    r2 = x * x + y * y
    if not distortion:
        u, v = x, y
    elif fisheye:
        r = np.sqrt(r2)
        theta = np.arctan(r)
        k1, k2, k3, k4 = distortion
        scale = theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8) / max(r, 1e-12)
        u, v = x * scale, y * scale
    else:
        k1, k2, p1, p2, k3 = distortion
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.array([K[0, 0] * u + K[0, 2], K[1, 1] * v + K[1, 2]])


def spot(centre: np.ndarray) -> np.ndarray:
    columns, rows = np.meshgrid(np.arange(STORED[0]) + 0.5, np.arange(STORED[1]) + 0.5)
    squared = (columns - centre[0]) ** 2 + (rows - centre[1]) ** 2
    return np.round(255 * np.exp(-squared / (2 * 2.5**2))).astype(np.uint8)


def centroid(pixels: np.ndarray) -> np.ndarray:
    rows, columns = np.indices(pixels.shape) + 0.5
    return np.array([(columns * pixels).sum(), (rows * pixels).sum()]) / pixels.sum()


@pytest.mark.parametrize("lens", ["none", "pinhole", "fisheye", "plain_fisheye"])
@pytest.mark.parametrize(
    ("crop", "size"),
    [(None, None), ((30, 20, 261, 187), None), ("square", 120), ((30, 20, 250, 200), (125, 100)), (None, 500)],
)
def test_a_point_stays_on_its_feature(lens: str, crop: Crop, size: Size) -> None:
    distortion = {"none": (), "pinhole": PINHOLE_DISTORTION, "fisheye": FISHEYE_DISTORTION}.get(lens, (0.0,) * 4)
    rectify = Rectifier(camera(distortion, fisheye=lens.endswith("fisheye")), STORED, crop, size)
    for x, y in [(0.0, 0.0), (0.25, -0.2), (-0.22, 0.15), (0.1, 0.22)]:
        direction = np.array([x, y, 1.0])
        result = rectify(spot(distorted(direction, distortion, fisheye=lens.endswith("fisheye"))))
        assert result.shape[1::-1] == rectify.size
        enlarged = max(1, rectify.size[0] / STORED[0])
        np.testing.assert_allclose(centroid(result), (rectify.K @ direction)[:2], atol=0.05 * enlarged)


@given(
    x=st.integers(0, 100),
    y=st.integers(0, 80),
    width=st.integers(20, 200),
    height=st.integers(20, 160),
    side=st.integers(10, 300),
)
def test_corners_of_the_crop_become_those_of_the_result(x: int, y: int, width: int, height: int, side: int) -> None:
    rectify = Rectifier(camera(), STORED, (x, y, width, height), side)
    to_result = rectify.K @ np.linalg.inv(K)
    np.testing.assert_allclose(to_result @ [x, y, 1], [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(to_result @ [x + width, y + height, 1], [*rectify.size, 1], atol=1e-9)


def test_undistortion_agrees_with_opencv() -> None:
    generator = np.random.default_rng(0)
    pixels = generator.integers(0, 255, (*STORED[::-1], 3), np.uint8)
    centred = K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    expected = cv2.undistort(pixels, centred, np.array(PINHOLE_DISTORTION))
    result = Rectifier(camera(PINHOLE_DISTORTION), STORED)(pixels)
    assert np.abs(result.astype(int) - expected).mean() < 1  # its tables are in fixed point


def test_a_crop_shows_the_same_pixels_as_the_whole() -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (*STORED[::-1], 3), np.uint8)
    for distortion in ((), PINHOLE_DISTORTION):
        whole = Rectifier(camera(distortion), STORED)(pixels)
        cropped = Rectifier(camera(distortion), STORED, (40, 30, 100, 50))(pixels)
        assert np.abs(whole[30:80, 40:140].astype(int) - cropped).max() <= 1


def test_K_is_scaled_to_the_stored_size() -> None:
    calibrated = SourceCamera(W2C, K, size=(640, 480))
    np.testing.assert_allclose(Rectifier(calibrated, STORED).K, np.diag([0.5, 0.5, 1]) @ K)


def test_pictures_that_need_nothing_are_recognised() -> None:
    assert Rectifier(camera((0.0, 0.0, 0.0, 0.0)), STORED).is_identity
    assert not Rectifier(camera(), STORED, size=100).is_identity
    assert not Rectifier(camera(PINHOLE_DISTORTION), STORED).is_identity


def test_what_the_lens_did_not_see_is_black() -> None:
    pincushion = camera((0.3, 0.0, 0.0, 0.0))
    result = Rectifier(pincushion, STORED)(np.full((*STORED[::-1], 3), 200, np.uint8))
    assert not result[0, 0].any()
    assert (result[120, 160] == 200).all()


@pytest.mark.parametrize(
    ("crop", "size", "message"),
    [
        ((0, 0, 321, 240), None, "is not inside pictures of 320 x 240"),
        ((-1, 0, 10, 10), None, "is not inside"),
        (None, (100, 100), "would stretch pictures of 320 x 240"),
    ],
)
def test_impossible_geometry_is_refused(crop: Crop, size: Size, message: str) -> None:
    with pytest.raises(DynhairError, match=message):
        Rectifier(camera(), STORED, crop, size)


def test_a_calibration_of_another_shape_is_refused() -> None:
    with pytest.raises(DynhairError, match="do not fit a calibration for 400 x 400"):
        Rectifier(SourceCamera(W2C, K, size=(400, 400)), STORED)
