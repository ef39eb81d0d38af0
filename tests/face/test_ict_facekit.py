"""Reading ICT-FaceKit's folder of OBJ files."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from disguise import Disguise, assert_sees_through, disguise

from dynhair.errors import DynhairError
from dynhair.face import face_model
from dynhair.face.ict_facekit import FILES, LANDMARKS68, VERTICES
from dynhair.face.wavefront import read_triangles, read_vertices

SHELL = 100  # vertices of the shells that are left out


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    lines = ["# comment", "mtllib some.mtl", *(f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices)]
    lines += ["vt 0.5 0.5", "vn 0 0 1", *(f"f {a + 1}/1 {b + 1}/1 {c + 1}/1" for a, b, c in faces)]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def truth() -> Disguise:
    return disguise(VERTICES, LANDMARKS68)


@pytest.fixture(scope="module")
def folder(truth: Disguise, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ict") / "FaceXModel"
    folder.mkdir()
    vertices = np.concatenate([100 * truth.mean, np.ones((SHELL, 3))])
    shells = VERTICES + np.arange(SHELL - 2)[:, None] + np.arange(3)
    write_obj(folder / "generic_neutral_mesh.obj", vertices, np.concatenate([truth.faces, shells]))
    for index, mode in enumerate(truth.identity_modes):
        write_obj(folder / f"identity{index:03d}.obj", 100 * (truth.mean + mode), truth.faces[:1])
    neutral = (folder / "generic_neutral_mesh.obj").read_text()
    for name in FILES.values():
        (folder / name).write_text(neutral)
    write_obj(folder / "jawOpen.obj", 100 * (truth.mean + truth.expression_modes[1]), truth.faces[:1])
    return folder


def test_the_folder_is_read(folder: Path, truth: Disguise) -> None:
    model = face_model(f"ict:{folder}")
    assert_sees_through(model, truth)
    assert len(model.expression_names) == len(model.expression_modes) == 53
    jaw = model.expression_names.index("jawOpen")
    np.testing.assert_allclose(model.expression_modes[jaw].numpy(), truth.expression_modes[1], atol=1e-7)
    assert {"mouthSmileLeft", "mouthSmileRight", "browInnerUpLeft", "jawLeft"} < set(model.expression_names)
    others = [index for index in range(53) if index != jaw]
    assert not model.expression_modes[others].any()
    assert (model.expression_range, model.expression_deviation) == ((0, 1), 0.3)


def test_missing_and_wrong_files_are_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="generic_neutral_mesh"):
        face_model(f"ict:{tmp_path}")
    copy = tmp_path / "copy"
    copy.mkdir()
    shutil.copy(folder / "generic_neutral_mesh.obj", copy)
    with pytest.raises(DynhairError, match="identity000"):
        face_model(f"ict:{copy}")
    shutil.copy(folder / "identity000.obj", copy)
    with pytest.raises(DynhairError, match=r"browDown_L\.obj"):
        face_model(f"ict:{copy}")
    write_obj(copy / "identity001.obj", np.zeros((5, 3)), np.zeros((0, 3)))
    with pytest.raises(DynhairError, match=r"identity001\.obj: it has 5 vertices"):
        face_model(f"ict:{copy}")


def test_obj_files_are_read_in_their_order(tmp_path: Path) -> None:
    path = tmp_path / "some.obj"
    path.write_text("o thing\nv 1 2 3\r\nv 4 5 6 0.5 0.5 0.5\nvn 9 9 9\nv -7e-1 8 9\nf 1 2 3\nf 3//1 2/1/1 1/2 2\n")
    np.testing.assert_array_equal(read_vertices(path, 2), [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(read_vertices(path, 3)[2], [-0.7, 8, 9])
    np.testing.assert_array_equal(read_triangles(path), [[0, 1, 2], [2, 1, 0], [2, 0, 1]])


@pytest.mark.parametrize("content", ["v 1 2\n", "v a b c\n", "v 1 2 3\n", ""])
def test_obj_files_without_the_vertices_are_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "some.obj"
    path.write_text(content)
    with pytest.raises(DynhairError, match="vertices"):
        read_vertices(path, 2)


def test_faces_without_numbers_and_missing_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "some.obj"
    path.write_text("f a b c\n")
    with pytest.raises(DynhairError, match="faces"):
        read_triangles(path)
    with pytest.raises(DynhairError, match="cannot be read"):
        read_triangles(tmp_path / "none.obj")
