from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from dynhair.preprocess.sources import read_calibration

# COLMAP's parameters in their order, K's fx fy cx cy, OpenCV's coefficients, whether they are a fisheye's
MODELS: dict[str, tuple[int, list[float], list[float], list[float], bool]] = {
    "SIMPLE_PINHOLE": (0, [90, 22, 33], [90, 90, 22, 33], [], False),
    "PINHOLE": (1, [90, 91, 22, 33], [90, 91, 22, 33], [], False),
    "SIMPLE_RADIAL": (2, [90, 22, 33, 0.1], [90, 90, 22, 33], [0.1, 0, 0, 0], False),
    "RADIAL": (3, [90, 22, 33, 0.1, 0.2], [90, 90, 22, 33], [0.1, 0.2, 0, 0], False),
    "OPENCV": (4, [90, 91, 22, 33, 0.1, 0.2, 0.3, 0.4], [90, 91, 22, 33], [0.1, 0.2, 0.3, 0.4], False),
    "OPENCV_FISHEYE": (5, [90, 91, 22, 33, 0.1, 0.2, 0.3, 0.4], [90, 91, 22, 33], [0.1, 0.2, 0.3, 0.4], True),
    "FULL_OPENCV": (
        6,
        [90, 91, 22, 33, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8],
        [90, 91, 22, 33],
        [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8],
        False,
    ),
    "SIMPLE_RADIAL_FISHEYE": (8, [90, 22, 33, 0.1], [90, 90, 22, 33], [0.1, 0, 0, 0], True),
    "RADIAL_FISHEYE": (9, [90, 22, 33, 0.1, 0.2], [90, 90, 22, 33], [0.1, 0.2, 0, 0], True),
}


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("model", MODELS)
def test_every_model_is_expressed_in_opencvs_terms(model: str, binary: bool, tmp_path: Path) -> None:
    number, parameters, (fx, fy, cx, cy), distortion, fisheye = MODELS[model]
    quaternion = [0.5, 0.5, 0.5, 0.5]  # w first: turns x to y, y to z, z to x
    if binary:
        lens = struct.pack(f"<QIiQQ{len(parameters)}d", 1, 3, number, 44, 64, *parameters)
        image = struct.pack("<QI7dI", 1, 1, *quaternion, 1.0, 2.0, 3.0, 3) + b"front.jpg\0" + struct.pack("<Q", 0)
        (tmp_path / "cameras.bin").write_bytes(lens)
        (tmp_path / "images.bin").write_bytes(image)
    else:
        (tmp_path / "cameras.txt").write_text(f"# a comment\n3 {model} 44 64 {' '.join(map(str, parameters))}\n")
        (tmp_path / "images.txt").write_text(f"1 {' '.join(map(str, quaternion))} 1 2 3 3 front.jpg\n\n")

    camera = read_calibration(tmp_path, tmp_path).cameras["front"]

    np.testing.assert_array_equal(camera.K, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    np.testing.assert_array_equal(camera.distortion, distortion)
    assert (camera.fisheye, camera.size) == (fisheye, (44, 64))
    np.testing.assert_allclose(camera.w2c, [[0, 0, 1, 1], [1, 0, 0, 2], [0, 1, 0, 3]], atol=1e-12)
