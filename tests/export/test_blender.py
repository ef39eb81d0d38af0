"""Blender scenes, opened by Blender; what needs none is tested without."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from any_motion import any_motion

from dynhair.errors import DynhairError
from dynhair.export.alembic import write_alembic
from dynhair.export.blender import SCENE, VARIABLE, Z_UP, blender_program, write_blend
from dynhair.export.colours import linear_colours
from dynhair.export.strand_motion import StrandMotion
from dynhair.export.usd import write_usd
from tiny_avatars import front_camera

INSPECTION = Path(__file__).with_name("blender_inspection.py")


@pytest.fixture
def blender() -> list[str]:
    """The command that runs a script of ours in Blender, but for the script and its arguments."""
    try:
        command = blender_program()
    except DynhairError as error:
        pytest.skip(error.message)
    return [str(INSPECTION) if part == str(SCENE) else part for part in command]


def inspected(blender: list[str], path: Path) -> dict[str, np.ndarray]:
    """What Blender finds in a file, frame by frame."""
    found = path.with_suffix(".npz")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    subprocess.run([*blender, str(path), str(found)], env=environment, check=True, capture_output=True)
    with np.load(found, allow_pickle=False) as arrays:
        return dict(arrays)


def assert_plays(found: dict[str, np.ndarray], motion: StrandMotion, within: float = 1e-6) -> None:
    frames = list(motion)
    strands = np.stack([frame.strands.reshape(-1, 3) @ Z_UP.T for frame in frames])
    np.testing.assert_allclose(found["hair"], strands, atol=within)
    heads = np.stack([frame.head @ Z_UP.T for frame in frames if frame.head is not None])
    np.testing.assert_allclose(found["head"], heads, atol=within)
    np.testing.assert_array_equal(found["counts"], motion.widths.shape[1])


@pytest.mark.slow
@pytest.mark.parametrize(("fps", "height"), [(25.0, 40), (29.97, 80)])
def test_the_scene_plays_the_motion(blender: list[str], fps: float, height: int, tmp_path: Path) -> None:
    motion = any_motion(fps=fps)
    camera = replace(front_camera(60), K=torch.tensor([[70.0, 0, 33], [0, 90, 17], [0, 0, 1]]), height=height)
    write_blend(tmp_path / "scene.blend", motion, camera)
    found = inspected(blender, tmp_path / "scene.blend")
    assert_plays(found, motion)
    np.testing.assert_allclose(found["fps"], fps, rtol=1e-6)
    assert found["range"].tolist() == [0, 2]
    halfway = (found["hair"][0] + found["hair"][1]) / 2
    np.testing.assert_allclose(found["halfway"], halfway, atol=1e-6)
    np.testing.assert_allclose(found["radius"], motion.widths.flatten() / 2, rtol=1e-6)
    np.testing.assert_allclose(found["colour"], linear_colours(motion.colours).reshape(-1, 3), atol=1e-6)
    assert motion.head_colours is not None
    np.testing.assert_allclose(found["head_colour"], linear_colours(motion.head_colours), atol=1e-6)
    np.testing.assert_allclose(found["surface_uv_coordinate"], motion.root_uvs, atol=1e-6)
    assert np.array_equal(found["strand_id"], motion.ids)
    turned = np.eye(4)
    turned[:3, :3] = Z_UP
    np.testing.assert_allclose(found["head_pose"], turned @ motion.head_transforms, atol=1e-5)
    # Blender projects points to where our camera does: shares of the image from its lower left
    points = next(iter(motion)).strands.reshape(-1, 3)
    pixels = camera.project(torch.from_numpy(points))[0].numpy()
    shares = np.stack([pixels[:, 0] / camera.width, 1 - pixels[:, 1] / camera.height], 1)
    np.testing.assert_allclose(found["projected"], shares, rtol=1e-4, atol=1e-4)
    assert sorted(tmp_path.iterdir()) == [tmp_path / "scene.blend", tmp_path / "scene.npz"]


@pytest.mark.slow
def test_a_scene_without_head_mesh_or_camera_plays(blender: list[str], tmp_path: Path) -> None:
    motion = any_motion(mesh=False)
    write_blend(tmp_path / "scene.blend", motion)
    found = inspected(blender, tmp_path / "scene.blend")
    assert "head" not in found
    assert found["hair"].shape == (3, 20, 3)
    assert ((found["projected"] > 0) & (found["projected"] < 1)).all()


@pytest.mark.slow
@pytest.mark.parametrize(("ending", "write"), [("usdc", write_usd), ("abc", write_alembic)])
def test_blender_plays_our_other_scenes(
    blender: list[str], ending: str, write: Callable[[Path, StrandMotion], None], tmp_path: Path
) -> None:
    motion = any_motion(fps=24.0)  # that of Blender's empty scene, by which Alembic's seconds become frames
    write(tmp_path / f"scene.{ending}", motion)
    assert_plays(inspected(blender, tmp_path / f"scene.{ending}"), motion, within=1e-5)


@pytest.mark.slow
def test_blenders_failure_is_told(blender: list[str], tmp_path: Path) -> None:
    motion = any_motion(mesh=False)
    with pytest.raises(DynhairError, match="Blender failed"):
        write_blend(tmp_path / "scene.blend", replace(motion, fps=0.0))
    assert not list(tmp_path.iterdir())


def test_blender_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "blender"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setenv(VARIABLE, str(program))
    assert blender_program()[0] == str(program)
    assert blender_program()[-2:] == [str(SCENE), "--"]
    monkeypatch.setenv(VARIABLE, sys.executable)
    assert blender_program() == [sys.executable, str(SCENE)]
    monkeypatch.setenv(VARIABLE, str(tmp_path / "none"))
    with pytest.raises(DynhairError, match="no program"):
        blender_program()
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert blender_program()[0] == str(program)


def test_a_machine_without_blender_is_told_how_to_get_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("dynhair.export.blender.find_spec", lambda name: None)
    with pytest.raises(DynhairError, match="there is no Blender") as caught:
        write_blend(tmp_path / "scene.blend", any_motion())
    assert caught.value.mend is not None
    assert VARIABLE in caught.value.mend


def test_a_blender_that_fails_leaves_no_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "blender"
    program.write_text("#!/bin/sh\necho out of order\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setenv(VARIABLE, str(program))
    with pytest.raises(DynhairError, match="out of order"):
        write_blend(tmp_path / "scene.blend", any_motion())
    assert list(tmp_path.iterdir()) == [program]
