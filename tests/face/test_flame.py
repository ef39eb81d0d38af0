"""Reading FLAME, and what becomes of its jaw."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from disguise import Disguise, assert_sees_through, disguise
from scipy.sparse import csc_matrix
from scipy.spatial.transform import Rotation

from dynhair.errors import DynhairError
from dynhair.face import face_model, open_head
from dynhair.face.flame import LANDMARKS68, VERTICES

NECK = np.array([0.1, 1.5, -0.2])  # of the file's head joint, from its origin
JAW = NECK + np.array([0.0, 0.0, 0.02])


@pytest.fixture(scope="module")
def truth() -> Disguise:
    return disguise(VERTICES, LANDMARKS68)


@pytest.fixture(scope="module")
def fields(truth: Disguise) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(0)
    template = truth.mean + NECK
    shapes = np.zeros((VERTICES, 3, 400), dtype=np.float32)
    shapes[:, :, :3] = np.moveaxis(truth.identity_modes, 0, 2)
    shapes[:, :, 300:302] = np.moveaxis(truth.expression_modes, 0, 2)
    # A regressor that finds the joints among the vertices, as least squares does.
    joints = np.stack([NECK - [0, 0.1, 0], NECK, JAW, NECK, NECK])
    used = np.arange(0, VERTICES, 50)
    regressor = np.zeros((5, VERTICES))
    regressor[:, used] = joints @ np.linalg.pinv(template[used])
    weights = np.zeros((VERTICES, 5))
    jaw = np.clip(-20 * (truth.mean[:, 1] + 0.02), 0, 1) * (truth.mean[:, 2] > 0.05)
    weights[:, 0] = 1 - truth.head_weight
    weights[:, 2] = np.minimum(jaw, truth.head_weight)
    weights[:, 1] = truth.head_weight - weights[:, 2]
    return {
        "v_template": template,
        "shapedirs": shapes,
        "posedirs": 0.01 * generator.normal(size=(VERTICES, 3, 36)),
        "J_regressor": regressor,
        "weights": weights,
        "f": truth.faces.astype(np.uint32),
    }


def write(path: Path, fields: dict[str, np.ndarray]) -> str:
    regressor = csc_matrix(fields["J_regressor"])
    path.write_bytes(pickle.dumps({**fields, "J_regressor": regressor, "bs_type": "lrotmin"}, protocol=2))
    return f"flame:{path}"


def write_npz(path: Path, fields: dict[str, np.ndarray]) -> None:
    np.savez(path, **fields)  # pyright: ignore[reportArgumentType]


def test_pickle_and_npz_are_read(tmp_path: Path, truth: Disguise, fields: dict[str, np.ndarray]) -> None:
    model = face_model(write(tmp_path / "generic_model.pkl", fields))
    assert_sees_through(model, truth)
    np.testing.assert_allclose(model.expression_modes[:2].numpy(), truth.expression_modes, atol=1e-7)
    np.testing.assert_allclose(model.head_weight.numpy(), truth.head_weight, atol=1e-6)
    assert len(model.identity_modes) == 100
    assert len(model.expression_modes) == len(model.expression_names) == 52
    assert (model.expression_range, model.expression_deviation) == ((-3, 3), 1)
    write_npz(tmp_path / "flame.npz", fields)
    again = face_model(f"flame:{tmp_path}/flame.npz")
    for name in ("mean", "identity_modes", "expression_modes", "faces", "scalp", "head_weight"):
        np.testing.assert_allclose(getattr(again, name).numpy(), getattr(model, name).numpy(), atol=1e-7)


def posed(fields: dict[str, np.ndarray], turn: list[float]) -> np.ndarray:
    """FLAME with its jaw turned, vertex by vertex: correctives, then linear blend skinning."""
    rotation = Rotation.from_rotvec(turn).as_matrix()
    features = np.zeros(36)
    features[9:18] = (rotation - np.eye(3)).ravel()
    corrected = fields["v_template"] + fields["posedirs"] @ features
    joint = fields["J_regressor"][2] @ fields["v_template"]
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, joint - rotation @ joint
    vertices = np.empty_like(corrected)
    for index, vertex in enumerate(corrected):
        weight = fields["weights"][index, 2]
        blended = weight * transform + (1 - weight) * np.eye(4)
        vertices[index] = (blended @ [*vertex, 1])[:3]
    return vertices - NECK


def test_the_jaw_opens_along_a_line(tmp_path: Path, fields: dict[str, np.ndarray]) -> None:
    model = face_model(write(tmp_path / "generic_model.pkl", fields))
    for name, turn in (("jawPitch", [0.3, 0, 0]), ("jawYaw", [0, 0.1, 0])):
        strength = 2.0 * np.eye(52, dtype=np.float32)[model.expression_names.index(name)]
        moved = model.mean.numpy() + np.tensordot(strength, model.expression_modes.numpy(), axes=1)
        np.testing.assert_allclose(moved, posed(fields, turn), atol=1e-5)


def test_the_line_stays_near_the_joints_circle(tmp_path: Path, fields: dict[str, np.ndarray]) -> None:
    still = {**fields, "posedirs": np.zeros_like(fields["posedirs"])}
    model = face_model(write(tmp_path / "generic_model.pkl", still))
    chin = int(model.landmarks68[8])
    start, mode = model.mean[chin].numpy(), model.expression_modes[-2, chin].numpy()
    assert mode[1] < 0  # positive opens
    assert model.expression_modes[-1, chin, 0] > 0  # to the person's left
    truth = posed(still, [np.radians(30), 0, 0])[chin]
    error = np.linalg.norm(start + np.radians(30) / 0.15 * mode - truth)
    assert error < 0.12 * np.linalg.norm(truth - start)


@pytest.mark.parametrize("name", ["v_template", "shapedirs", "weights"])
def test_other_sizes_and_missing_fields_are_refused(tmp_path: Path, fields: dict[str, np.ndarray], name: str) -> None:
    with pytest.raises(DynhairError, match=r"size|components"):
        face_model(write(tmp_path / "model.pkl", {**fields, name: fields[name][..., :2]}))
    write_npz(tmp_path / "model.npz", {key: fields[key] for key in fields if key != name})
    with pytest.raises(DynhairError, match=name):
        face_model(f"flame:{tmp_path}/model.npz")


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    for name in ("model.npz", "model.pkl"):
        with pytest.raises(DynhairError, match="readable"):
            face_model(f"flame:{tmp_path}/{name}")
        (tmp_path / name).write_bytes(b"something else")
        with pytest.raises(DynhairError, match="readable"):
            face_model(f"flame:{tmp_path}/{name}")


def test_words_choose_the_model() -> None:
    assert face_model() is face_model("open") is open_head()
    for spec in ("", "closed", "flame", "bfm:", "open:file"):
        with pytest.raises(DynhairError, match="no face model"):
            face_model(spec)
