from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynhair.preprocess.landmarks.square import FaceSquare, square_around

squares = st.builds(
    FaceSquare,
    st.tuples(st.floats(-50, 300), st.floats(-50, 300)),
    st.floats(5, 400),
    st.floats(-np.pi, np.pi),
)


@given(squares, st.integers(0, 2**32 - 1))
def test_mapping_to_the_image_and_back(square: FaceSquare, seed: int):
    points = np.random.default_rng(seed).uniform(-1, 2, (7, 2))
    np.testing.assert_allclose(square.from_image(square.to_image(points)), points, atol=1e-9)


def test_corners_of_a_turned_square():
    square = FaceSquare((10.0, 20.0), 4.0, np.pi / 2)  # its +x axis points down in the image
    np.testing.assert_allclose(square.to_image(np.array([[0.0, 0.0], [1, 0], [0, 1]])), [[12, 18], [12, 22], [8, 18]])


def test_crop_of_whole_pixels_is_a_slice():
    image = np.random.default_rng(0).integers(0, 256, (40, 50, 3), np.uint8)
    np.testing.assert_array_equal(FaceSquare((24.0, 18.0), 16.0).crop(image, 16), image[10:26, 16:32])


@pytest.mark.parametrize("side", [20.0, 64.0, 200.0, 900.0])
@pytest.mark.parametrize("angle", [0.0, 0.4, -2.0])
def test_a_crop_shows_each_place_where_the_mapping_says(side: float, angle: float):
    # The colour of a gradient image tells the place, whatever the resampling.
    height, width = 700, 900
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    image = np.stack([x / 4, y / 4, 0 * x], -1).round().astype(np.uint8)
    square = FaceSquare((450.0, 350.0), side, angle)
    centres = (np.stack(np.meshgrid(np.arange(64), np.arange(64)), -1) + 0.5) / 64
    expected = square.to_image(centres)
    margin = 2 * max(1, side / 64)
    inside = ((expected > margin) & (expected < [width - margin, height - margin])).all(-1)
    shown = square.crop(image, 64)[..., :2].astype(float) * 4
    assert inside.any()
    errors = (shown - expected)[inside]
    assert np.abs(errors).max() < 4.5  # a level of the gradient is 4 pixels
    assert np.abs(errors.mean(0)).max() < 0.2


def test_shrinking_averages_instead_of_skipping():
    stripes = np.zeros((512, 512, 3), np.uint8)
    stripes[:, ::4] = 255
    crop = FaceSquare((256.0, 256.0), 512.0).crop(stripes, 64)
    assert np.ptp(crop[2:-2, 2:-2].astype(int)) <= 1
    assert abs(int(crop[32, 32, 0]) - 64) <= 1


def test_beyond_the_image_is_black():
    white = np.full((30, 30, 3), 255, np.uint8)
    for side in (20.0, 500.0):
        assert not FaceSquare((-2000.0, 15.0), side).crop(white, 16).any()
    crop = FaceSquare((0.0, 15.0), 20.0).crop(white, 20)
    assert not crop[:, :9].any()
    assert (crop[:, 11:] == 255).all()


@given(squares)
def test_square_around_turns_with_the_face(turned: FaceSquare):
    face = np.array([[0.2, 0.4], [0.8, 0.4], [0.5, 0.1], [0.5, 0.9]])  # 0.6 wide, 0.8 high
    square = square_around(turned.to_image(face), right=0, left=1)
    assert square.side == pytest.approx(1.5 * 0.8 * turned.side)
    np.testing.assert_allclose(square.centre, turned.to_image(np.array([0.5, 0.5])), atol=1e-6)
    assert np.cos(square.angle - turned.angle) == pytest.approx(1)
