from __future__ import annotations

import io
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageOps
from rich.console import Console

from dynhair.capture import Capture
from dynhair.capture.check import Finding, check_capture, contact_sheet, print_findings, run_check
from dynhair.capture.encoding import read_size
from dynhair.errors import DynhairError
from dynhair.training.frames import training_segments
from dynhair.training.rest import Rest

Damage = Callable[[Path], object]


def edit_json(change: Callable[[dict[str, Any]], None]) -> Damage:
    def apply(path: Path) -> None:
        raw = json.loads(path.read_text())
        change(raw)
        path.write_text(json.dumps(raw))

    return apply


def edit_npz(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    def apply(path: Path) -> None:
        arrays = dict(np.load(path))
        arrays[name] = change(arrays[name])
        np.savez(path, **arrays)

    return apply


def edit_npy(change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    return lambda path: np.save(path, change(np.load(path)))


def edit_image(change: Callable[[Image.Image], Image.Image]) -> Damage:
    return lambda path: change(Image.open(path).copy()).save(path)


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def pickle_inside(path: Path) -> None:
    np.savez(path, pose=np.array([{"a": 1}], dtype=object), exp_coeff=np.zeros((1, 4)))


def with_nan(array: np.ndarray) -> np.ndarray:
    return np.where(np.arange(array.size).reshape(array.shape) == 1, np.nan, array)


def behead(mask: Image.Image) -> Image.Image:
    mask.paste(0, (0, 0, 40, 22))
    return mask


def shifted(*by: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda array: array + np.array(by)


def inverted(extrinsic: np.ndarray) -> np.ndarray:
    rotation = extrinsic[:, :3].T
    return np.c_[rotation, -rotation @ extrinsic[:, 3]]


def set_segment(index: int, **values: object) -> Damage:
    return edit_json(lambda raw: raw["segments"][index].update(values))


MANIFEST, PARAMS, CAMERA = "capture.json", "params/0001/params.npz", "cameras/0001/camera_01.npz"

BREAKS: list[tuple[str, str, Damage, str]] = [
    # what is broken, the file, how, what the finding says
    ("no image", "images/0001/image_01.png", Path.unlink, "missing"),
    ("no mask", "images/0001/mask_01.png", Path.unlink, "missing"),
    ("no hair mask", "images/0001/hair_01.png", Path.unlink, "missing"),
    ("no camera", CAMERA, Path.unlink, "missing"),
    ("no params", PARAMS, Path.unlink, "missing"),
    ("no landmarks", "params/0001/lmk_3d.npy", Path.unlink, "missing"),
    ("no vertices", "params/0001/vertices.npy", Path.unlink, "missing"),
    ("truncated image", "images/0001/image_01.png", truncate, "damaged"),
    ("truncated orientation", "images/0001/orient_01.png", truncate, "damaged"),
    ("empty image", "images/0001/hair_01.png", lambda path: path.write_bytes(b""), "not an image"),
    ("text for an image", "images/0001/image_01.png", lambda path: path.write_text("hello"), "not an image"),
    ("mask of another size", "images/0001/mask_01.png", edit_image(lambda i: i.resize((20, 20))), "20 x 20"),
    ("image of another size", "images/0001/image_00.png", edit_image(lambda i: i.resize((41, 40))), "41 x 40"),
    (
        "orientation without alpha",
        "images/0001/orient_01.png",
        edit_image(lambda _: Image.new("L", (40, 40))),
        "mode L",
    ),
    ("shape of a pose", PARAMS, edit_npz("pose", lambda p: p[:, :5]), r"\(1, 5\)"),
    ("NaN in a pose", PARAMS, edit_npz("pose", with_nan), "NaN"),
    ("pickled params", PARAMS, pickle_inside, "pickled"),
    ("damaged params", PARAMS, truncate, "cannot be read"),
    ("a number less in exp_coeff", PARAMS, edit_npz("exp_coeff", lambda e: e[:, :3]), "3 coefficients here and 4"),
    ("NaN in landmarks", "params/0001/lmk_3d.npy", edit_npy(with_nan), "NaN"),
    ("landmarks in millimetres", "params/0001/lmk_3d.npy", edit_npy(lambda x: x * 1000), "span"),
    ("vertices of another mesh", "params/0001/vertices.npy", edit_npy(lambda v: v[:-1]), r"\(323, 3\)"),
    ("NaN in 2D landmarks", "landmarks/0001/lmk_01.npy", edit_npy(with_nan), "NaN"),
    ("2D landmarks elsewhere", "landmarks/0001/lmk_01.npy", edit_npy(shifted(9, 0, 0)), r"9\.0 px"),
    ("camera-to-world", CAMERA, edit_npz("extrinsic", inverted), "camera-to-world"),
    ("OpenGL axes", CAMERA, edit_npz("extrinsic", lambda e: e * [[1], [-1], [-1]]), "behind"),
    ("scaled rotation", CAMERA, edit_npz("extrinsic", lambda e: e * 2), "orthonormal"),
    ("mirrored camera", CAMERA, edit_npz("extrinsic", lambda e: e * [[-1], [1], [1]]), "reflection"),
    ("camera elsewhere", CAMERA, edit_npz("extrinsic", lambda e: e + np.outer([1, 0, 0], [0, 0, 0, 2.0])), "outside"),
    ("shape of a camera", CAMERA, edit_npz("extrinsic", lambda e: np.vstack([e, [[0, 0, 0, 1]]])), r"\(4, 4\)"),
    ("normalised K", CAMERA, edit_npz("intrinsic", lambda k: k / 40 + np.diag([0, 0, 0.975])), "focal"),
    ("skew", CAMERA, edit_npz("intrinsic", lambda k: k + np.eye(3, k=1)), "`intrinsic` is"),
    ("empty scalp", "mesh.npz", edit_npz("scalp", lambda s: s[:0]), "`scalp` is empty"),
    ("faces beyond the mesh", "mesh.npz", edit_npz("faces", lambda f: f + 1), "1 to 324"),
    ("truth of fewer frames", "gt/turn.npz", edit_npz("strands", lambda s: s[:2]), "2 frames"),
    ("static view", "static360/images/hair_01.png", truncate, "damaged"),
    ("static camera", "static360/cameras/camera_01.npz", edit_npz("extrinsic", inverted), "camera-to-world"),
    ("garbage manifest", MANIFEST, lambda path: path.write_bytes(b"\xff{]"), "not readable as JSON"),
    ("a list for a manifest", MANIFEST, lambda path: path.write_text("[]"), "JSON list"),
    ("future version", MANIFEST, edit_json(lambda raw: raw.update(version=2)), "`version` is 2"),
    ("no fps", MANIFEST, edit_json(lambda raw: raw.pop("fps")), "`fps` is None"),
    ("fps NaN", MANIFEST, edit_json(lambda raw: raw.update(fps=float("nan"))), "`fps` is nan"),
    ("background of bytes", MANIFEST, edit_json(lambda raw: raw.update(background=[0, 0, 255])), "`background`"),
    ("no cameras", MANIFEST, edit_json(lambda raw: raw.update(cameras={})), "`cameras`"),
    ("a camera name that leaves", MANIFEST, edit_json(lambda raw: raw.update(cameras=["../00"])), "`cameras`"),
    ("no segments", MANIFEST, edit_json(lambda raw: raw.update(segments=[])), "`segments`"),
    ("unsorted segments", MANIFEST, edit_json(lambda raw: raw["segments"].reverse()), "comes after"),
    ("overlapping segments", MANIFEST, set_segment(1, start=2), "overlap"),
    ("two of one name", MANIFEST, set_segment(1, motion="turn"), "two segments"),
    ("unknown split", MANIFEST, set_segment(1, split="val"), "`split` is 'val'"),
    ("a segment that is not one", MANIFEST, edit_json(lambda raw: raw.update(segments=[3])), r"segments\[0\]"),
    ("size of words", MANIFEST, edit_json(lambda raw: raw.update(image_size="large")), "`image_size`"),
]


@pytest.mark.parametrize(("file", "damage", "says"), [b[1:] for b in BREAKS], ids=[b[0] for b in BREAKS])
def test_what_is_broken_is_named(broken: Path, file: str, damage: Damage, says: str) -> None:
    damage(broken / file)
    findings = check_capture(broken)
    named = [f for f in findings if f.file == Path(file) and f.severity == "error"]
    assert named, findings
    assert any(re.search(says, f.found) for f in named), named
    assert all(f.expected or f.mend for f in named)
    assert {f.file for f in findings if f.severity == "error"} == {Path(file)}, "nothing else is blamed"


WARNINGS: list[tuple[str, str, Damage, str]] = [
    ("a jump", PARAMS, edit_npz("pose", shifted(0, 3, 0, 0, 0, 0)), "jumps"),
    ("pose of another frame", PARAMS, edit_npz("pose", shifted(0, 0, 0.3, 0, 0, 0)), "jumps|scalp"),
    ("vertices elsewhere", "params/0001/vertices.npy", edit_npy(lambda v: v + np.float32(0.05)), "scalp"),
    ("empty mask", "images/0001/mask_01.png", edit_image(lambda i: i.point(lambda _: 0)), "empty"),
    ("full mask", "images/0001/mask_01.png", edit_image(lambda i: i.point(lambda _: 255)), "whole image"),
    ("headless mask", "images/0001/mask_00.png", edit_image(behead), "landmarks fall on"),
    ("one colour", "images/0001/image_01.png", edit_image(lambda i: i.point(lambda _: 9)), "one colour"),
    ("hair elsewhere", "images/0001/hair_01.png", edit_image(lambda i: i.point(lambda v: 255 - v)), "outside"),
    ("no orientation", "images/0001/orient_01.png", edit_image(lambda _: Image.new("LA", (40, 40))), "no orientation"),
    ("faces inside out", "mesh.npz", edit_npz("faces", lambda f: np.vstack([f[:1, ::-1], f[1:]])), "opposite"),
    (
        "another background",
        "images/0001/image_01.png",
        edit_image(ImageOps.invert),
        "outside the mask",
    ),
]


@pytest.mark.parametrize(("file", "damage", "says"), [w[1:] for w in WARNINGS], ids=[w[0] for w in WARNINGS])
def test_what_is_suspicious_is_warned_of(broken: Path, file: str, damage: Damage, says: str) -> None:
    damage(broken / file)
    findings = check_capture(broken)
    assert all(f.severity != "error" for f in findings), findings
    assert any(re.search(says, f.found) for f in findings if f.severity == "warning"), findings


def test_a_sound_capture_has_no_findings(pristine: Path) -> None:
    assert check_capture(pristine) == []


def test_a_capture_for_tests_alone_is_noted_and_opens(broken: Path) -> None:
    set_segment(0, split="test")(broken / MANIFEST)
    assert [(f.severity, str(f.file)) for f in check_capture(broken)] == [("note", MANIFEST)]
    capture = Capture.open(broken)
    with pytest.raises(DynhairError, match="no segment has the split `train`"):
        training_segments(capture)
    assert Rest.of(capture).segment == capture.segments[0]


def test_the_bundled_capture_has_no_findings() -> None:
    capture = Path(__file__).parents[2] / "data" / "sample_capture"
    assert check_capture(capture) == []


def test_a_gaussian_head_avatar_folder_is_usable(gha_folder: Path) -> None:
    findings = check_capture(gha_folder)
    assert {(f.severity, str(f.file)) for f in findings} == {("warning", "mesh.npz"), ("note", "capture.json")}


def test_a_fault_of_many_files_is_one_finding(broken: Path) -> None:
    for path in broken.glob("images/*/mask_*.png"):
        truncate(path)
    (finding,) = [f for f in check_capture(broken) if "mask" in f.file.name]
    assert (finding.file, finding.count) == (Path("images/0000/mask_00.png"), 12)


def test_missing_and_spare_frames(broken: Path) -> None:
    shutil.rmtree(broken / "images" / "0001")
    set_segment(1, count=2)(broken / MANIFEST)
    missing, spare = check_capture(broken)
    assert (missing.severity, missing.file) == ("error", Path("images/0001"))
    assert (spare.severity, spare.file) == ("note", Path("images/0005"))


def test_every_problem_of_a_manifest_is_found_at_once(broken: Path) -> None:
    def change(raw: dict[str, Any]) -> None:
        raw.update(fps=-1, gravity=[0, 1])
        raw["segments"][0]["split"] = "val"

    edit_json(change)(broken / MANIFEST)
    truncate(broken / "images" / "0002" / "mask_00.png")
    found = " ".join(f.found for f in check_capture(broken))
    for word in ("fps", "gravity", "split", "damaged"):
        assert word in found


@pytest.mark.parametrize("case", [b for b in BREAKS if b[1] == MANIFEST], ids=lambda b: b[0])
def test_a_broken_manifest_does_not_open(broken: Path, case: tuple[str, str, Damage, str]) -> None:
    case[2](broken / MANIFEST)
    with pytest.raises(DynhairError, match=case[3]) as caught:
        Capture.open(broken)
    assert caught.value.path == broken / MANIFEST


def test_folders_that_are_no_capture(tmp_path: Path) -> None:
    for path in (tmp_path / "nowhere", tmp_path):
        (finding,) = check_capture(path)
        assert finding.severity == "error"
        assert run_check(path) == 1


@settings(max_examples=10)
@given(data=st.data())
def test_random_damage_never_raises(
    data: st.DataObject, pristine: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("damaged") / "capture"
    shutil.copytree(pristine, folder)
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    for path in data.draw(st.lists(st.sampled_from(files), min_size=1, max_size=8)):
        content = bytearray(path.read_bytes())
        for position in data.draw(st.lists(st.integers(0, len(content) - 1), max_size=6)) if content else ():
            content[position] = data.draw(st.integers(0, 255))
        path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    check_capture(folder)
    shutil.rmtree(folder)


def test_the_exit_code_and_the_table(broken: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_check(broken, tmp_path / "sheet.png") == 0
    assert "no findings" in capsys.readouterr().out
    assert read_size(tmp_path / "sheet.png")[0] > 400
    truncate(broken / "images" / "0001" / "mask_00.png")
    assert run_check(broken, tmp_path / "sheet.png") == 1, "a sheet is drawn of what can be read"
    assert "1 error" in capsys.readouterr().out


def test_markup_in_a_finding_is_printed_as_it_is() -> None:
    output = io.StringIO()
    finding = Finding("error", Path("[red]x"), "`a[0]` is [/bold]", "[b]", "", 3)
    print_findings([finding], Console(file=output, width=120))
    for text in ("[red]x", "and 2 more", "`a[0]` is [/bold]", "[b]"):
        assert text in output.getvalue()


def test_a_sheet_of_many_views_and_segments_stays_small(pristine: Path, tmp_path: Path) -> None:
    contact_sheet(Capture.open(pristine), tmp_path / "sheet.png")
    width, height = read_size(tmp_path / "sheet.png")
    assert width < 2000
    assert height < 2500
