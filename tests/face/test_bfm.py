"""Reading the Basel Face Model of 2009, as it is published and as others store it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from disguise import Disguise, assert_sees_through, disguise
from scipy.io import savemat

from dynhair.errors import DynhairError
from dynhair.face import face_model, open_head, register
from dynhair.face.bfm import LANDMARKS68


@pytest.fixture(scope="module")
def truth() -> Disguise:
    head = open_head()
    return disguise(len(head.mean), tuple(head.landmarks68.tolist()))


@pytest.fixture
def fields(truth: Disguise) -> dict[str, np.ndarray]:
    return {
        "meanshape": 10 * truth.mean.reshape(1, -1),
        "idBase": 10 * truth.identity_modes.reshape(3, -1).T,
        "exBase": 10 * truth.expression_modes.reshape(2, -1).T,
        "tri": truth.faces[:, ::-1] + 1,  # wound the other way
        "keypoints": open_head().landmarks68.numpy()[None] + 1,
        "skinmask": np.ones((1, 3)),
    }


def test_the_file_with_expressions_is_read(tmp_path: Path, truth: Disguise, fields: dict[str, np.ndarray]) -> None:
    savemat(tmp_path / "BFM09_model_info.mat", fields)
    model = face_model(f"bfm:{tmp_path}/BFM09_model_info.mat")
    assert_sees_through(model, truth)
    np.testing.assert_allclose(model.expression_modes.numpy(), truth.expression_modes, atol=1e-6)
    assert model.expression_names == ("expression00", "expression01")
    assert (model.expression_range, model.expression_deviation) == ((-3, 3), 1)
    assert register(model.mean[model.landmarks66], model).landmark_distance < 1e-5


def test_the_original_file_is_read(tmp_path: Path) -> None:
    truth = disguise(53490, tuple(vertex - 1 for vertex in LANDMARKS68))
    deviations = np.array([3.0, 2.0, 0.5])
    unit = truth.identity_modes.reshape(3, -1).T / deviations
    savemat(
        tmp_path / "01_MorphableModel.mat",
        {
            "shapeMU": (1e6 * truth.mean.reshape(-1, 1)).astype(np.float32),
            "shapePC": (1e6 * unit).astype(np.float32),
            "shapeEV": deviations[:, None],
            "tl": truth.faces + 1,
        },
    )
    model = face_model(f"bfm:{tmp_path}/01_MorphableModel.mat")
    assert_sees_through(model, truth)
    assert model.expression_modes.shape == (0, 53490, 3)
    assert model.expression_names == ()


def test_other_files_are_refused(tmp_path: Path, fields: dict[str, np.ndarray]) -> None:
    path = tmp_path / "model.mat"
    with pytest.raises(DynhairError, match="missing"):
        face_model(f"bfm:{path}")
    path.write_bytes(b"no MATLAB file, but long enough to hold a header of one" * 10)
    with pytest.raises(DynhairError, match="no MATLAB file"):
        face_model(f"bfm:{path}")
    savemat(path, {name: array for name, array in fields.items() if name != "exBase"})
    with pytest.raises(DynhairError, match="exBase"):
        face_model(f"bfm:{path}")


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("meanshape", lambda array: 10 * array),
        ("meanshape", lambda array: array.reshape(-1, 3)[:, [0, 2, 1]].reshape(1, -1)),
        ("keypoints", lambda array: array[:, ::-1]),
        ("keypoints", lambda array: array + 10_000),
        ("tri", lambda array: array - 1),
        ("idBase", lambda array: array * np.nan),
        ("idBase", lambda array: array[:-3]),
    ],
    ids=["unit", "axes", "order of landmarks", "landmarks beyond", "counted from 0", "nan", "vertices"],
)
def test_arrays_that_are_no_face_are_refused(
    tmp_path: Path, fields: dict[str, np.ndarray], name: str, change: Callable[[np.ndarray], np.ndarray]
) -> None:
    fields[name] = change(fields[name])
    savemat(tmp_path / "model.mat", fields)
    with pytest.raises(DynhairError, match=r"no face|one face"):
        face_model(f"bfm:{tmp_path}/model.mat")
