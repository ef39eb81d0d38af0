from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynhair.errors import DynhairError
from dynhair.preprocess.landmarks import FaceLandmarks, load_landmarks, save_landmarks


def some_face() -> FaceLandmarks:
    generator = np.random.default_rng(0)
    draw = lambda *shape: generator.uniform(size=shape).astype(np.float32)  # noqa: E731
    return FaceLandmarks(draw(478, 3) * 200, draw(478), 0.75, draw(52))


def test_a_face_comes_back_as_it_was(tmp_path: Path):
    face = some_face()
    save_landmarks(tmp_path / "0000" / "00.npz", face)
    read = load_landmarks(tmp_path / "0000" / "00.npz")
    assert read is not None
    np.testing.assert_array_equal(read.points, face.points)
    np.testing.assert_array_equal(read.visibility, face.visibility)
    np.testing.assert_array_equal(read.blendshapes, face.blendshapes)
    assert read.score == face.score
    assert [path.name for path in (tmp_path / "0000").iterdir()] == ["00.npz"]


def test_a_miss_comes_back_as_a_miss(tmp_path: Path):
    save_landmarks(tmp_path / "00.npz", some_face())
    save_landmarks(tmp_path / "00.npz", None)
    assert load_landmarks(tmp_path / "00.npz") is None
    with np.load(tmp_path / "00.npz") as arrays:
        assert arrays["score"] == 0
        assert arrays["points"].shape == (0, 3)


def test_damaged_files(tmp_path: Path):
    path = tmp_path / "00.npz"
    with pytest.raises(DynhairError, match="missing"):
        load_landmarks(path)
    np.savez(path, points=np.zeros((3, 3)), visibility=np.zeros(478), blendshapes=np.zeros(52), score=1.0)
    with pytest.raises(DynhairError, match="'points': 3"):
        load_landmarks(path)
    np.savez(path, points=np.full((478, 3), np.nan), visibility=np.zeros(478), blendshapes=np.zeros(52), score=1.0)
    with pytest.raises(DynhairError):
        load_landmarks(path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(DynhairError):
        load_landmarks(path)
