"""Whose expression coefficients a capture holds: written, read, guessed, checked."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat
from tests.face.disguise import disguise

from dynhair.capture import Capture, CaptureWriter, ExpressionBasis, HeadTrack, Manifest, Segment
from dynhair.capture.check import check_capture, run_check
from dynhair.capture.manifest import parse_manifest
from dynhair.errors import DynhairError
from dynhair.face import face_model, open_head

MANIFEST = Manifest(30.0, (8, 8), ("00",), (Segment("nod", 0, 2, "train"),))
FACES = ExpressionBasis("faces", ("jaw", "smile", "blink", "brow"))


def set_basis(capture: Path, value: object) -> None:
    path = capture / "capture.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"expression_basis": value}))


def set_coefficients(capture: Path, count: int) -> None:
    for path in capture.glob("params/*/params.npz"):
        np.savez(path, **{**np.load(path), "exp_coeff": np.zeros((1, count), np.float32)})


names = st.text(min_size=1).filter(str.strip)


@given(name=names, coefficients=st.lists(names | st.just(""), unique_by=lambda name: name or object()).map(tuple))
def test_a_manifest_keeps_it(name: str, coefficients: tuple[str, ...]) -> None:
    manifest = replace(MANIFEST, expression_basis=ExpressionBasis(name, coefficients))
    read = parse_manifest(json.loads(json.dumps(manifest.to_json())), Path("capture.json"))
    assert read.expression_basis == manifest.expression_basis


@pytest.mark.parametrize("basis", [None, FACES, ExpressionBasis("faces")])
def test_what_is_written_comes_with_the_capture_and_its_tracks(basis: ExpressionBasis | None, tmp_path: Path) -> None:
    with CaptureWriter.create(tmp_path / "c", replace(MANIFEST, expression_basis=basis)) as writer:
        for frame in range(2):
            writer.write_head(frame, np.eye(3), np.zeros(3), np.arange(4.0))
    capture = Capture.open(tmp_path / "c")
    assert capture.expression_basis == basis
    track = capture.track(capture.segments[0])
    assert track.expression_basis == basis
    np.testing.assert_array_equal(track.expressions, [[0, 1, 2, 3]] * 2)


def test_a_writer_refuses_coefficients_that_have_no_names(tmp_path: Path) -> None:
    def write() -> None:
        with CaptureWriter.create(tmp_path / "c", replace(MANIFEST, expression_basis=FACES)) as writer:
            writer.write_head(0, np.eye(3), np.zeros(3), np.zeros(5))

    with pytest.raises(DynhairError, match="4 names, and `exp_coeff` has 5 coefficients"):
        write()
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize("value", [None, "absent"])
def test_captures_need_not_tell(value: str | None, broken: Path) -> None:
    if value is None:
        set_basis(broken, None)
    capture = Capture.open(broken)
    assert capture.expression_basis is None
    assert capture.track(capture.segments[0]).expression_basis is None
    assert check_capture(broken) == []


def test_tracks_need_not_tell() -> None:
    track = HeadTrack(np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 4), np.float32), 30.0, np.zeros(3))
    assert track.expression_basis is None


@pytest.mark.parametrize(
    ("value", "found"),
    [
        ("BFM 2009", "`expression_basis` is 'BFM 2009'"),
        (["jaw"], r"`expression_basis` is \['jaw'\]"),
        ({}, "`name` is missing"),
        ({"name": 64}, "`name` is 64"),
        ({"name": " "}, "`name` is ' '"),
        ({"name": "faces", "names": "jaw"}, "`names` is 'jaw'"),
        ({"name": "faces", "names": ["a", "b", "c", 4]}, "`names` is"),
        ({"name": "faces", "names": ["a", "b", "c", ["d"]]}, "`names` is"),
        ({"name": "faces", "names": ["a", "b", "c", " "]}, "`names` is"),
        ({"name": "faces", "names": ["a", "", "", "a"]}, "`names` is"),
        ({"name": "faces", "names": ["a", "b", "c", "a"]}, "`names` is"),
    ],
)
def test_what_is_no_basis_is_refused(value: object, found: str, broken: Path) -> None:
    set_basis(broken, value)
    with pytest.raises(DynhairError, match=found) as caught:
        Capture.open(broken)
    assert caught.value.path == broken / "capture.json"
    assert caught.value.expected
    (finding,) = check_capture(broken)
    assert (finding.severity, finding.file) == ("error", Path("capture.json"))


def test_names_and_coefficients_must_be_as_many(broken: Path) -> None:
    set_basis(broken, {"name": "faces", "names": ["jaw", "smile", "blink"]})
    capture = Capture.open(broken)
    with pytest.raises(DynhairError, match="3 names, and `exp_coeff` has 4 coefficients") as caught:
        capture.track(capture.segments[0])
    assert caught.value.path == broken / "capture.json"
    assert caught.value.expected == "4 names, or none"
    (finding,) = check_capture(broken)
    assert (finding.severity, finding.file, finding.count) == ("error", Path("capture.json"), 1)
    assert run_check(broken) == 1


@pytest.mark.parametrize(
    ("basis", "says"),
    [
        ({"name": "faces"}, "4 expression coefficients of the face model `faces`"),
        (None, "4 expression coefficients of a face model that is not named"),
    ],
)
def test_a_check_shows_it(basis: object, says: str, broken: Path, capsys: pytest.CaptureFixture[str]) -> None:
    set_basis(broken, basis)
    assert run_check(broken) == 0
    assert says in capsys.readouterr().out


def test_64_coefficients_of_gaussian_head_avatar_are_the_basel_face_models(gha_folder: Path, tmp_path: Path) -> None:
    assert Capture.open(gha_folder).expression_basis is None, "it has 4"
    set_coefficients(gha_folder, 64)
    capture = Capture.open(gha_folder)
    basis = capture.track(capture.segments[0]).expression_basis
    assert basis is not None

    head = open_head()
    like = disguise(len(head.mean), tuple(head.landmarks68.tolist()))
    file = tmp_path / "BFM09_model_info.mat"
    savemat(
        file,
        {
            "meanshape": 10 * like.mean.reshape(1, -1),
            "idBase": 10 * like.identity_modes.reshape(3, -1).T,
            "exBase": np.zeros((like.mean.size, 64)),
            "tri": like.faces + 1,
            "keypoints": head.landmarks68.numpy()[None] + 1,
        },
    )
    model = face_model(f"bfm:{file}")
    assert basis.matches(ExpressionBasis(model.name, model.expression_names))


def test_a_folder_without_parameters_still_opens(gha_folder: Path) -> None:
    shutil.rmtree(gha_folder / "params" / "0000")
    assert Capture.open(gha_folder).expression_basis is None


def test_bases_match_as_far_as_both_tell() -> None:
    unnamed, reordered = ExpressionBasis("faces"), ExpressionBasis("faces", FACES.names[::-1])
    for one, other, expected in (
        (FACES, FACES, True),
        (FACES, unnamed, True),
        (unnamed, unnamed, True),
        (FACES, reordered, False),
        (FACES, replace(FACES, name="others"), False),
        (unnamed, ExpressionBasis("others"), False),
        (FACES, ExpressionBasis("faces", ("jaw", "", "blink", "")), True),
        (FACES, ExpressionBasis("faces", ("jaw", "", "smile", "")), False),
        (FACES, ExpressionBasis("faces", (*FACES.names, "")), False),
    ):
        assert one.matches(other) is expected
        assert other.matches(one) is expected
