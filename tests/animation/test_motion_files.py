"""Motion files: what is written is what is read, and what is wrong is named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from recordings import smooth_motion
from scipy.spatial.transform import Rotation

from dynhair.animation import RestPose, TimedMotion, read_motion, write_motion
from dynhair.animation.motion_files import MOTION_SUFFIXES
from dynhair.animation.procedural import PIVOT
from dynhair.capture import ExpressionBasis, HeadTrack
from dynhair.errors import DynhairError

QUATERNIONS = [[1.0, 0, 0, 0], [0, 1.0, 0, 0]]
SOUND = {"time": [0.0, 0.5], "rotation": QUATERNIONS, "translation": [[0.0, 0, 0], [0.1, 0, 0]]}

_finite = st.floats(-1.5, 1.5, allow_subnormal=False)


@st.composite
def parts(draw: st.DrawFn) -> dict[str, Any]:
    """What a motion is made of; the first row of poses is its rest."""
    frames, count = draw(st.integers(2, 5)), draw(st.integers(0, 3))
    steps = draw(arrays.arrays(np.float64, frames, elements=st.floats(1e-3, 10.0)))
    vectors = draw(arrays.arrays(np.float64, (frames + 1, 3), elements=_finite))
    coefficients = draw(arrays.arrays(np.float32, (frames + 1, count), elements=st.floats(-1, 1, width=32)))
    translations = draw(arrays.arrays(np.float64, (frames + 1, 3), elements=_finite))
    words = st.text("abcXYZ_ é,;\"'#", min_size=1, max_size=6).map(str.strip).filter(bool)
    names = draw(st.lists(words | st.just(""), min_size=count, max_size=count, unique_by=lambda name: name or object()))
    taken = {"time", "qw", "qx", "qy", "qz", "tx", "ty", "tz"}
    named = any(names) and not taken & set(names)
    return {
        "times": np.cumsum(steps) - 5,
        "vectors": vectors,
        "translations": translations,
        "coefficients": coefficients,
        "gravity": draw(arrays.arrays(np.float64, 3, elements=st.floats(-10, 10))),
        "names": draw(st.sampled_from([None, (), tuple(names)] if named else [None, ()])),
    }


def motion_of(made: dict[str, Any]) -> TimedMotion:
    rotations = Rotation.from_rotvec(made["vectors"]).as_matrix()
    translations, coefficients, names = made["translations"], made["coefficients"], made["names"]
    return TimedMotion(
        times=made["times"],
        rotations=rotations[1:],
        translations=translations[1:],
        expressions=coefficients[1:],
        rest=RestPose(rotations[0], translations[0], coefficients[0]),
        gravity=made["gravity"],
        expression_basis=None if names is None else ExpressionBasis("ARKit 52", names),
    )


def assert_same(found: TimedMotion, motion: TimedMotion) -> None:
    np.testing.assert_allclose(found.rotations, motion.rotations, atol=1e-12)
    np.testing.assert_allclose(found.rest.rotation, motion.rest.rotation, atol=1e-12)
    for name in ("times", "translations", "expressions", "gravity", "expression_basis"):
        np.testing.assert_array_equal(getattr(found, name), getattr(motion, name), strict=True)
    np.testing.assert_array_equal(found.rest.translation, motion.rest.translation)
    np.testing.assert_array_equal(found.rest.expression, motion.rest.expression)


@pytest.mark.parametrize("suffix", MOTION_SUFFIXES)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(made=parts())
def test_what_is_written_is_read_again(tmp_path: Path, suffix: str, made: dict[str, Any]) -> None:
    motion = motion_of(made)
    write_motion(tmp_path / f"motion{suffix}", motion)
    assert_same(read_motion(tmp_path / f"motion{suffix}"), motion)


@pytest.mark.parametrize("suffix", MOTION_SUFFIXES)
def test_a_track_begins_at_0_s_and_at_rest(tmp_path: Path, suffix: str) -> None:
    motion = smooth_motion(np.arange(4) / 25)
    track = HeadTrack(motion.rotations, motion.translations, motion.expressions, 25.0, motion.gravity)
    write_motion(tmp_path / f"motion{suffix}", track)
    assert_same(read_motion(tmp_path / f"motion{suffix}"), TimedMotion.of(track))
    assert [path.name for path in tmp_path.iterdir()] == [f"motion{suffix}"]


@pytest.mark.parametrize("name", ["tx", "qw", "r00", "rx", "time", " smile", "jaw\nopen"])
def test_a_name_that_a_header_cannot_hold_is_refused(tmp_path: Path, name: str) -> None:
    motion = replace(smooth_motion(np.arange(4) / 25), expression_basis=ExpressionBasis("any", ("a", name, "b")))
    path = tmp_path / "motion.csv"
    with pytest.raises(DynhairError, match="an expression is called") as caught:
        write_motion(path, motion)
    assert caught.value.path == path
    assert not path.exists()
    write_motion(tmp_path / "motion.json", motion)
    assert read_motion(tmp_path / "motion.json").expression_basis == motion.expression_basis


def written(path: Path, **columns: Any) -> Path:
    """Columns in the format that the path names; None leaves one out."""
    kept = {name: value for name, value in columns.items() if value is not None}
    if path.suffix == ".npz":
        np.savez(path, **{name: np.array(value) for name, value in kept.items()})  # pyright: ignore[reportArgumentType]
    else:
        path.write_text(json.dumps(kept), encoding="utf-8")
    return path


@pytest.mark.parametrize("suffix", [".npz", ".json"])
@pytest.mark.parametrize(
    "rotation",
    [
        Rotation.from_euler("xyz", [[0, 0, 0], [0.1, 0.2, 0.3]]).as_matrix(),
        Rotation.from_euler("xyz", [[0, 0, 0], [0.1, 0.2, 0.3]]).as_rotvec(),
    ],
)
def test_matrices_and_rotation_vectors_are_read_too(tmp_path: Path, suffix: str, rotation: np.ndarray) -> None:
    path = written(tmp_path / f"motion{suffix}", fps=25, rotation=rotation.tolist())
    found = read_motion(path)
    expected = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix()
    np.testing.assert_allclose(found.rotations, [np.eye(3), expected], atol=1e-12)
    np.testing.assert_array_equal(found.times, [0, 1 / 25])


def test_without_translations_the_head_turns_about_the_neck(tmp_path: Path) -> None:
    found = read_motion(written(tmp_path / "motion.json", fps=10, rotation=QUATERNIONS))
    np.testing.assert_allclose(found.rotations @ PIVOT + found.translations, [PIVOT, PIVOT], atol=1e-12)
    np.testing.assert_array_equal(found.gravity, [0, -9.81, 0])
    assert found.expressions.shape == (2, 0)
    np.testing.assert_array_equal(found.rest.rotation, np.eye(3))


def test_a_table_as_spreadsheets_and_trackers_write_it(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    text = "\ufeff# made by hand\n# gravity: 0 0 -9.8\n# rest_rotation: 1 0 0 0\ntime, rx,ry,rz , jawOpen\n"
    path.write_text(text + "1.0,0,0,0,0.25\n\n1.5,0,0.5,0,1e-1\n", encoding="utf-8")
    found = read_motion(path)
    np.testing.assert_array_equal(found.times, [1.0, 1.5])
    np.testing.assert_array_equal(found.gravity, [0, 0, -9.8])
    np.testing.assert_allclose(found.rotations[1], Rotation.from_rotvec([0, 0.5, 0]).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(found.expressions[:, 0], [0.25, 0.1])
    assert found.expression_basis is not None
    assert found.expression_basis.names == ("jawOpen",)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"rotation": None}, "there is no `rotation`"),
        ({"time": None}, "neither `time` nor `fps`"),
        ({"time": None, "fps": 0}, "`fps` is 0"),
        ({"time": [0.5, 0.5]}, "goes from 0.5 s to 0.5 s in frame 1"),
        ({"time": [0.0, 0.5, 1.0]}, "`time` has 3 rows"),
        ({"time": [0.0, float("nan")]}, "not finite, first in row 1"),
        ({"time": ["a", "b"]}, "`time` holds"),
        ({"rotation": [[1.0, 0, 0, 0], [0, 3.0, 0, 0]]}, "row 1 of `rotation` is no rotation"),
        ({"rotation": [np.eye(3).tolist(), np.diag([1.0, 1, -1]).tolist()]}, "right-handed"),
        ({"rotation": [[1.0, 0], [0, 1.0]]}, r"expected: \(frames, 4\) or \(frames, 3\)"),
        ({"rotation": [], "time": [], "translation": []}, "shape"),
        ({"translation": [[0.0, 0, 0], [350.0, 0, 0]]}, "travels 350 m"),
        ({"rest_translation": [0.0, 1600.0, 0.0]}, "travels 1600 m, from rest"),
        ({"expression": [[1.0], [0.0]], "rest_expression": [0.0, 0.0]}, "2 coefficients"),
        ({"expression": [[1.0], [0.0]], "expression_names": ["a", "b"]}, "2 names"),
        ({"expression": [[1.0, 0, 0]] * 2, "expression_names": ["", "a", "a"]}, "two of `expression_names` are 'a'"),
        ({"gravity": [0.0, -9.81]}, "`gravity` has the shape"),
        ({"expression_basis": 3.0}, "expected: text"),
    ],
)
@pytest.mark.parametrize("suffix", [".npz", ".json"])
def test_what_is_wrong_is_named(tmp_path: Path, suffix: str, columns: dict[str, Any], said: str) -> None:
    path = written(tmp_path / f"motion{suffix}", **{**SOUND, **columns})
    with pytest.raises(DynhairError, match=said) as caught:
        read_motion(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,qw,qx,qy,qz\n0,1,0,0\n", "frame 1 has 4 values"),
        ("time,qw,qx,qy,qz\n0,1,0,0,zero\n1,1,0,0,0\n", "no number"),
        ("time,time\n0,1\n", "two columns have one name"),
        ("# gravity: down\ntime,rx,ry,rz\n0,0,0,0\n", "no row of numbers"),
        ("time,rx,ry,rz\n", "holds no frames"),
        ("time,rx,ry,rz\n0,0,0,0\n", "a single frame"),
        ("time,yaw\n0,0\n1,0\n", "there is no `rotation`"),
    ],
)
def test_what_is_wrong_with_a_table_is_named(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "motion.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DynhairError, match=said):
        read_motion(path)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="no such file"):
        read_motion(tmp_path / "missing.npz")
    (tmp_path / "motion.bvh").write_text("HIERARCHY")
    with pytest.raises(DynhairError, match=r"\.npz or \.json or \.csv"):
        read_motion(tmp_path / "motion.bvh")
    for suffix in MOTION_SUFFIXES:
        (tmp_path / f"noise{suffix}").write_bytes(bytes(range(256)))
        with pytest.raises(DynhairError, match="not readable"):
            read_motion(tmp_path / f"noise{suffix}")


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    np.savez(tmp_path / "motion.npz", rotation=np.array([object()], dtype=object))
    with pytest.raises(DynhairError, match="not readable"):
        read_motion(tmp_path / "motion.npz")


_leaves = st.none() | st.booleans() | st.floats() | st.text(max_size=3)
_anything = st.recursive(_leaves, lambda inner: st.lists(inner, max_size=4), max_leaves=8)


@given(values=st.dictionaries(st.sampled_from(["time", "rotation", "fps"]), _anything))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_json_is_more_than_an_error(tmp_path: Path, values: dict[str, Any]) -> None:
    path = tmp_path / "motion.json"
    path.write_text(json.dumps(values), encoding="utf-8")
    with pytest.raises(DynhairError):
        read_motion(path)
