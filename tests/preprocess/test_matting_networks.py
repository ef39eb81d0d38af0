"""What mattings give to their networks and make of the answers; the real networks under `slow`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx_files import write_convolution

from dynhair.errors import DynhairError
from dynhair.preprocess.matting import Matting, fast_matting, modnet_matting, quality_matting
from dynhair.preprocess.matting.modnet import modnet_size
from dynhair.preprocess.matting.networks import fast_network, onnx_network

THIRD = [1 / 3, 1 / 3, 1 / 3]


class Recorder:
    """A network whose matte is what it is given, brought from ``low..high`` to 0..1: its mean over channels."""

    def __init__(self, low: float, high: float) -> None:
        self.low, self.high = low, high
        self.given: np.ndarray

    def __call__(self, image: np.ndarray) -> np.ndarray:
        assert image.dtype == np.float32
        self.given = image
        return (image.mean(-1) - self.low) / (self.high - self.low)


def picture(height: int, width: int) -> np.ndarray:
    """A smooth picture: red grows to the right, green downwards."""
    y, x = np.mgrid[:height, :width]
    return np.stack([40 + 200 * x / width, 30 + 200 * y / height, np.full(x.shape, 90)], -1).astype(np.uint8)


def as_matte(image: np.ndarray) -> np.ndarray:
    return image.mean(-1)


@pytest.mark.parametrize(("height", "width"), [(256, 256), (300, 500), (700, 250), (40, 90), (1, 9)])
def test_fast_matting_letterboxes(height: int, width: int) -> None:
    network, image = Recorder(0, 1), picture(height, width)
    matte = fast_matting(network)(image)
    assert network.given.shape == (256, 256, 3)
    assert network.given.min() >= 0
    assert network.given.max() <= 1
    rows, columns = np.nonzero(network.given.any(-1))
    sides = np.ptp(rows) + 1, np.ptp(columns) + 1
    assert max(sides) == 256
    assert abs(sides[0] / sides[1] - height / width) * min(sides) < 2 * max(1, height / width)
    assert abs(rows.min() - (255 - rows.max())) <= 1
    assert abs(columns.min() - (255 - columns.max())) <= 1
    assert matte.shape == (height, width)
    assert np.abs(matte - as_matte(image)).mean() < 3


def test_quality_matting_stretches_to_its_range() -> None:
    network, image = Recorder(-0.5, 127 / 256), picture(60, 90)
    matte = quality_matting(network)(image)
    assert network.given.shape == (1024, 1024, 3)
    middle = network.given[512, 512]
    np.testing.assert_allclose(middle, (image[30, 45] - 128.0) / 256, atol=2 / 256)
    assert np.abs(matte - as_matte(image)).max() < 3


@pytest.mark.parametrize("make", [fast_matting, quality_matting])
def test_alpha_out_of_range_is_clipped(make: type) -> None:
    image = picture(20, 30)
    assert (make(lambda given: np.full(given.shape[:2], 1.3, np.float32))(image) == 255).all()
    assert (make(lambda given: np.full(given.shape[:2], -0.2, np.float32))(image) == 0).all()


@given(st.integers(1, 4000), st.integers(1, 4000))
def test_modnet_sees_multiples_of_32(height: int, width: int) -> None:
    rows, columns = modnet_size(height, width)
    assert rows % 32 == columns % 32 == 0
    assert min(rows, columns) >= 32
    if min(height, width) >= 512:
        assert min(rows, columns) == 512
        assert abs(rows * width - columns * height) <= 32 * max(height, width)


@pytest.mark.parametrize(
    ("size", "expected"),
    [((1080, 1920), (512, 896)), ((256, 256), (512, 512)), ((400, 800), (384, 800)), ((512, 512), (512, 512))],
)
def test_modnet_sizes(size: tuple[int, int], expected: tuple[int, int]) -> None:
    assert modnet_size(*size) == expected


def test_modnet_is_given_values_around_zero(tmp_path: Path) -> None:
    # its answer is the mean of the input's channels, brought from -1..1 to 0..1
    matting = modnet_matting(write_convolution(tmp_path / "modnet.onnx", [1 / 6, 1 / 6, 1 / 6], 0.5))
    for image in (picture(600, 720), picture(90, 300)):
        assert np.abs(matting(image) - as_matte(image)).max() < 3


def test_modnet_of_fixed_size_is_given_that_size(tmp_path: Path) -> None:
    matting = modnet_matting(write_convolution(tmp_path / "modnet.onnx", [1 / 6, 1 / 6, 1 / 6], 0.5, (64, 96)))
    image = picture(80, 70)
    assert np.abs(matting(image) - as_matte(image)).max() < 5


def test_onnx_network_keeps_the_order_of_channels(tmp_path: Path) -> None:
    predict, fixed = onnx_network(write_convolution(tmp_path / "red.onnx", [1, 0, 0], 0))
    assert fixed is None
    image = np.random.default_rng(0).random((5, 7, 3), np.float32)
    np.testing.assert_allclose(predict(image), image[..., 0], rtol=1e-6)


def test_checkpoints_of_modnet_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "modnet_photographic_portrait_matting.ckpt"
    path.write_bytes(b"PK")
    with pytest.raises(DynhairError, match="ONNX export"):
        modnet_matting(path)


def test_files_that_are_no_such_network_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="missing"):
        modnet_matting(tmp_path / "none.onnx")
    damaged = tmp_path / "damaged.onnx"
    damaged.write_bytes(write_convolution(tmp_path / "whole.onnx", THIRD, 0).read_bytes()[:-20])
    with pytest.raises(DynhairError, match="not readable"):
        modnet_matting(damaged)
    with pytest.raises(DynhairError, match="one float image"):
        modnet_matting(write_convolution(tmp_path / "grey.onnx", [1], 0, channels=1))


def astronaut() -> np.ndarray:
    from skimage import data

    return data.astronaut()


def check_astronaut(matting: Matting) -> None:
    image = astronaut()
    matte = matting(image)
    assert matte.shape == image.shape[:2]
    assert matte[60:170, 180:270].mean() > 245  # face
    assert matte[280:480, 90:220].mean() > 240  # suit
    assert matte[20:200, 310:500].mean() < 15  # shuttle
    assert matte[:80, :80].mean() < 15  # flag
    wide = matting(np.pad(image, ((0, 0), (200, 200), (0, 0)), mode="edge"))
    assert np.abs(wide[40:480, 360:480].astype(float) - matte[40:480, 160:280]).mean() < 12


@pytest.mark.slow
def test_fast_matting_finds_a_person() -> None:
    check_astronaut(fast_matting())


@pytest.mark.slow
def test_quality_matting_finds_a_person() -> None:
    check_astronaut(quality_matting())


@pytest.mark.slow
def test_networks_run_repeatedly() -> None:

    predict = fast_network()
    first, second = np.zeros((256, 256, 3), np.float32), np.ones((256, 256, 3), np.float32)
    before = predict(first)
    predict(second)
    np.testing.assert_array_equal(predict(first), before)
