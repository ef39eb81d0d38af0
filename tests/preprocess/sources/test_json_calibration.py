from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from dynhair.preprocess.sources import World, read_calibration

DOCUMENTATION = Path(__file__).parents[3] / "docs" / "preprocess_inputs.md"


def test_the_documented_example_is_read(tmp_path: Path) -> None:
    match = re.search(r"```json\n(.*?)```", DOCUMENTATION.read_text(), re.DOTALL)
    assert match is not None
    path = tmp_path / "calibration.json"
    path.write_text(match[1])

    calibration = read_calibration(None, tmp_path)

    left, right = calibration.cameras["left"], calibration.cameras["right"]
    assert calibration.world == World(metres_per_unit=0.001, up="z")
    assert (left.size, left.fisheye, len(left.distortion)) == ((1920, 1080), False, 5)
    assert (right.size, right.fisheye, len(right.distortion)) == (None, True, 4)
    metres = calibration.world.to_metres(right.w2c)  # 1.2 m before the origin, level, looking at it
    np.testing.assert_allclose(metres @ [0, 0, 0, 1], [0, 0, 1.2], atol=1e-12)
    np.testing.assert_allclose(metres[:, 1], [0, -1, 0], atol=1e-12)


def test_a_fisheye_without_coefficients_is_a_fisheye_still(tmp_path: Path) -> None:
    camera = {"fx": 90, "fy": 90, "cx": 22, "cy": 32, "model": "fisheye", "world_to_camera": np.eye(4).tolist()}
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps({"cameras": {"front": camera}}))
    front = read_calibration(path, tmp_path).cameras["front"]
    np.testing.assert_array_equal(front.distortion, [0, 0, 0, 0])
    assert front.fisheye
