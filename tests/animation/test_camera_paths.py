"""Cameras: where they stand, what they look at, and what is said of files that are not sound."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from recordings import FPS, ORIGIN, REST, make_recording

from dynhair.animation.cameras import camera_path, names_camera
from dynhair.camera import Camera
from dynhair.errors import DynhairError


def seen(camera: Camera, point: np.ndarray) -> tuple[np.ndarray, float]:
    pixels, depth = camera.project(torch.from_numpy(point).float()[None])
    return pixels[0].numpy(), float(depth[0])


def written(path: Path, value: Any) -> Path:
    path.write_text(json.dumps(value), encoding="utf-8")
    return path


def test_the_front_camera_stays_and_takes_the_size() -> None:
    recording = make_recording()
    cameras = camera_path("front", recording, 4, 20)
    assert [(camera.width, camera.height) for camera in cameras] == [(20, 15)] * 4
    own, small = seen(recording.camera, ORIGIN)[0], seen(cameras[3], ORIGIN)[0]
    np.testing.assert_allclose(small, own / 2, rtol=1e-5)


@pytest.mark.parametrize(("spec", "turn"), [("orbit", 90.0), ("orbit:-60", -60 * 3 / FPS)])
def test_an_orbit_keeps_the_heads_place_in_the_image(spec: str, turn: float) -> None:
    recording = make_recording()
    cameras = camera_path(spec, recording, 12)
    first = seen(recording.camera, ORIGIN)
    for camera in cameras:
        pixel, depth = seen(camera, ORIGIN)
        np.testing.assert_allclose(pixel, first[0], atol=1e-3)
        assert depth == pytest.approx(first[1], abs=1e-5)
        assert float(camera.centre[1]) == pytest.approx(float(recording.camera.centre[1]), abs=1e-5)
    arms = [(cameras[index].centre.numpy() - ORIGIN)[[2, 0]] for index in (0, 3)]
    angle = np.degrees(np.arctan2(*arms[1][::-1]) - np.arctan2(*arms[0][::-1]))
    assert angle == pytest.approx(turn, abs=1e-3)


def test_a_path_passes_through_its_key_frames_upright_and_looks_at_its_targets(tmp_path: Path) -> None:
    keys = [
        {"time": 0.0, "position": [0.0, 0.1, 1.0], "field_of_view": 40},
        {"time": 0.5, "position": [0.8, 0.3, 0.6], "target": [0.0, 0.05, 0.0]},
        {"time": 1.0, "position": [0.0, 0.1, 0.7]},
    ]
    path = written(tmp_path / "path.json", {"keyframes": keys})
    cameras = camera_path(path, make_recording(), 61)
    for key, index in zip(keys, (0, 15, 30), strict=True):
        position = REST @ np.array(key["position"]) + ORIGIN
        np.testing.assert_allclose(cameras[index].centre.numpy(), position, atol=1e-5)
        pixel, depth = seen(cameras[index], REST @ np.array(key.get("target", [0.0, 0, 0])) + ORIGIN)
        np.testing.assert_allclose(pixel, [20, 15], atol=1e-3)
        assert depth > 0
    for camera in cameras:
        rotation = camera.w2c[:, :3].double().numpy()
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        assert np.linalg.det(rotation) == pytest.approx(1)
        assert rotation[0] @ [0, 1, 0] == pytest.approx(0, abs=1e-6)  # the image's rows are level
        assert rotation[1] @ [0, 1, 0] < 0  # and its columns go down
    top = seen(cameras[0], cameras[0].centre.double().numpy() + np.array(_ray(cameras[0], 20.0)))[0]
    assert top[1] == pytest.approx(0, abs=1e-3)
    np.testing.assert_allclose(cameras[60].centre, cameras[30].centre)


def _ray(camera: Camera, degrees: float) -> np.ndarray:
    """A direction above the optical axis."""
    angle = np.radians(degrees)
    return camera.w2c[:, :3].double().numpy().T @ [0, -np.sin(angle), np.cos(angle)]


def test_a_single_key_frame_in_the_world_is_a_camera_that_stays(tmp_path: Path) -> None:
    key = {"position": [0.2, 3.0, -0.4], "target": ORIGIN.tolist()}  # from straight above
    cameras = camera_path(written(tmp_path / "top.json", {"space": "world", "keyframes": [key]}), make_recording(), 3)
    assert len(cameras) == 3
    np.testing.assert_allclose(cameras[2].centre.numpy(), key["position"], atol=1e-5)
    np.testing.assert_allclose(seen(cameras[2], ORIGIN)[0], [20, 15], atol=1e-3)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ({}, "no `keyframes`"),
        ({"keyframes": [3]}, "no `keyframes`"),
        ({"space": "screen", "keyframes": [{"position": [0, 0, 1]}]}, "`space`"),
        ({"keyframes": [{"position": [0, 1]}]}, "`position` of key frame 0"),
        ({"keyframes": [{"position": ["a", 0, 1]}]}, "`position` of key frame 0"),
        ({"keyframes": [{"position": [0, 0, 1]}, {"position": [0, 0, 2]}]}, "`time` of key frame 0 is None"),
        (
            {"keyframes": [{"time": 1, "position": [0, 0, 1]}, {"time": 1, "position": [0, 0, 2]}]},
            "goes from 1 s to 1 s in key frame 1",
        ),
        ({"keyframes": [{"position": [0, 0, 0]}]}, "key frame 0 is where it looks at"),
        ({"keyframes": [{"position": [0, 0, 1], "field_of_view": 180}]}, "`field_of_view` of key frame 0 is 180"),
        ({"keyframes": [{"position": [0, 0, 1], "fov": 40}]}, "key frame 0 has a `fov`"),
        ({"keyframes": [{"position": ["0", "0", "1"]}]}, "`position` of key frame 0"),
        ({"keyframes": [{"position": [0, [0], 1]}]}, "`position` of key frame 0"),
        ({"keyframes": [{"position": [0, 0, 1], "field_of_view": True}]}, "`field_of_view` of key frame 0 is True"),
        ({"keyframes": [{"position": [0, 0, 10**400]}]}, "`position` of key frame 0"),
        (
            {"keyframes": [{"time": 0, "position": [0, 0, 1]}, {"time": 4 / FPS, "position": [0, 0, -1]}]},
            "passes through what it looks at",
        ),
        ({"space": "world", "keyframes": [{"position": [0, 0, 1]}]}, "`target` of key frame 0"),
    ],
)
def test_a_path_that_is_not_sound_is_refused(tmp_path: Path, value: Any, said: str) -> None:
    path = written(tmp_path / "path.json", value)
    with pytest.raises(DynhairError, match=said) as caught:
        camera_path(path, make_recording(), 3)
    assert str(path) in str(caught.value)


def test_names_that_mean_nothing_are_refused() -> None:
    with pytest.raises(DynhairError, match="front, orbit"):
        camera_path("left", make_recording(), 3)
    for rate in ("fast", "nan", "inf"):
        with pytest.raises(DynhairError, match=f"`{rate}` degrees a second"):
            camera_path(f"orbit:{rate}", make_recording(), 3)
    with pytest.raises(DynhairError, match="0 pixels"):
        camera_path("front", make_recording(), 3, 0)


def test_only_a_bare_name_wants_a_capture(tmp_path: Path) -> None:
    assert names_camera("03")
    assert not any(map(names_camera, ("front", "orbit", "orbit:20", "path.json", f"{tmp_path}:03")))
