"""All of preprocessing on a small recording, with a stand-in for the landmark network alone."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from rich.console import Console
from scipy.spatial.transform import Rotation

from dynhair.camera import Camera
from dynhair.capture import Capture, ExpressionBasis
from dynhair.errors import DynhairError
from dynhair.face import face_anchors, open_head
from dynhair.preprocess.landmarks import FaceLandmarks
from dynhair.preprocess.options import ImportOptions, PreprocessOptions
from dynhair.preprocess.pipeline import preprocess
from dynhair.preprocess.steps import landmarks as landmark_step
from dynhair.preprocess.steps.orientation import OrientationStep
from dynhair.preprocess.workspace import ViewId, Workspace
from synthetic import HEAD_ORIGIN, write_synthetic_capture

FRAMES = 6
MISSED = (5, "01")


class SeenFaces:
    """Stands in for the following of a face: it knows the pictures, and where the open head is in each."""

    def __init__(self, capture: Capture) -> None:
        self.capture = capture
        self.looked_at: list[int] = []
        self._frames = [frame for segment in capture.segments for frame in segment.frames]
        self._pictures = {
            frame: np.stack([np.asarray(_picture(capture.path, frame, name)) for name in capture.camera_names])
            for frame in self._frames
        }
        head, anchors = open_head(), face_anchors(open_head())
        self._points = anchors.points
        self._anchors = anchors.positions(head.mean.numpy(), head.faces.numpy())

    def follow(self, images: list[np.ndarray], cameras: list[Camera]) -> list[FaceLandmarks | None]:
        seen = np.stack(images).astype(float)
        if len(images) != len(self.capture.camera_names):  # the static ring
            return [None] * len(images)
        frame = min(self._frames, key=lambda f: np.abs(self._pictures[f] - seen).mean())
        self.looked_at.append(frame)
        segment = next(s for s in self.capture.segments if frame in s.frames)
        rotation = self.capture.track(segment).rotations[frame - segment.start]
        world = self._anchors @ rotation.T + HEAD_ORIGIN
        return [
            None if (frame, name) == MISSED else self._face(camera, world)
            for name, camera in zip(self.capture.camera_names, cameras, strict=True)
        ]

    def _face(self, camera: Camera, world: np.ndarray) -> FaceLandmarks:
        pixels, depth = camera.project(torch.from_numpy(world).float())
        points = np.zeros((478, 3), np.float32)
        points[:] = np.append(pixels.mean(0), 0)
        points[self._points] = np.c_[pixels, depth]
        visibility = np.zeros(478, np.float32)
        visibility[self._points] = 1
        return FaceLandmarks(points, visibility, 0.99, np.zeros(52, np.float32))


def _picture(root: Path, frame: int, name: str) -> Image.Image:
    return Image.open(root / f"images/{frame:04d}/image_{name}.png")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pictures, cameras, masks and hair masks: everything else is to be found."""
    root = write_synthetic_capture(
        tmp_path_factory.mktemp("recording") / "raw", frames=FRAMES, views=3, size=64, with_gt=False, static_views=2
    )
    for found in ("params", "landmarks"):
        shutil.move(root / found, root.parent / found)
    (root / "mesh.npz").unlink()
    for path in root.rglob("orient_*"):
        path.unlink()
    return root


@pytest.fixture(scope="module")
def faces(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SeenFaces]:
    whole = tmp_path_factory.mktemp("whole") / "capture"
    shutil.copytree(recording, whole)
    for found in ("params", "landmarks"):
        shutil.copytree(recording.parent / found, whole / found)
    seen = SeenFaces(Capture.open(whole))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(landmark_step, "FaceTrack", lambda landmarker: seen)
        patched.setattr(landmark_step, "FaceLandmarker", lambda: None)
        patched.setattr(landmark_step, "asset_path", Path)
        yield seen


@pytest.fixture(scope="module")
def finished(recording: Path, faces: SeenFaces, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("finished") / "capture"
    run(recording, out)
    return out


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    """A finished capture of one's own; times of change are copied too."""
    shutil.copytree(finished, tmp_path / "capture")
    return tmp_path / "capture"


def run(
    recording: Path, out: Path, options: PreprocessOptions | None = None, importing: ImportOptions | None = None
) -> str:
    text = io.StringIO()
    preprocess(recording, out, importing, options, console=Console(file=text, width=200))
    return text.getvalue()


def times(out: Path, pattern: str) -> dict[str, int]:
    return {str(path.relative_to(out)): path.stat().st_mtime_ns for path in out.glob(pattern)}


def test_a_recording_becomes_a_capture_with_the_true_motion(finished: Path, faces: SeenFaces) -> None:
    capture = Capture.open(finished)
    assert [(s.name, s.split) for s in capture.segments] == [("turn", "train"), ("nod", "test")]
    assert len(capture.static_names) == 2
    assert capture.expression_basis == ExpressionBasis("open", open_head().expression_names)
    for segment in capture.segments:
        found, true = capture.track(segment), faces.capture.track(segment)
        turned = Rotation.from_matrix(found.rotations) * Rotation.from_matrix(true.rotations).inv()
        assert np.degrees(turned.magnitude()).max() < 2
        assert np.linalg.norm(found.translations - HEAD_ORIGIN, axis=1).max() < 0.01
        for frame in segment.frames:
            assert capture.landmarks_3d(frame).shape == (66, 3)
            assert len(capture.vertices(frame)) == len(open_head().mean)
    view, truth = capture.view(3, "01"), faces.capture.view(3, "01")
    assert view.orientation is not None
    assert view.coherence is not None
    assert truth.hair is not None
    assert float((view.mask - truth.mask).abs().max()) == 0
    assert float(view.coherence[truth.hair == 0].max()) == 0
    landmarks = capture.landmarks_2d(*MISSED)
    assert landmarks is not None
    assert not landmarks[:, 2].any(), "a face that was missed has no score"


def test_the_page_shows_all_steps_and_motions(finished: Path) -> None:
    page = (finished / "preprocess/report.html").read_text()
    for title in ("Matting", "Landmarks", "Hair masks", "Hair orientation", "Head tracking", "turn", "nod"):
        assert title in page
    assert page.count("<svg") == 4, "motion and residuals of two segments"
    for sheet in ("mask", "landmarks", "hair", "orient", "tracking"):
        assert f"sheets/{sheet}.jpg" in page
        with Image.open(finished / f"preprocess/sheets/{sheet}.jpg") as picture:
            assert min(picture.size) > 256


def test_a_second_run_does_nothing_and_a_mended_mask_only_what_hangs_on_it(
    recording: Path, faces: SeenFaces, out: Path
) -> None:
    everything = "[!p]*/**/*.*"
    before, looked_at = times(out, everything), len(faces.looked_at)
    run(recording, out)
    assert times(out, everything) == before
    assert len(faces.looked_at) == looked_at

    workspace = Workspace(out)
    view = ViewId(2, "00")
    workspace.write_mask(view, "hair", np.zeros((64, 64), np.uint8))
    run(recording, out)
    changed = {path for path, time in times(out, everything).items() if time != before[path]}
    assert changed == {"images/0002/hair_00.png", "images/0002/orient_00.png"}
    assert not workspace.mask(view, "hair").any(), "what the user mended stays"


def test_another_option_redoes_its_step_and_those_after_it_alone(recording: Path, faces: SeenFaces, out: Path) -> None:
    before = times(out, "images/*/*")
    run(recording, out, PreprocessOptions(matting="plate", backdrop=(0, 0, 0)))
    changed = {Path(path).stem.split("_")[0] for path, time in times(out, "images/*/*").items() if time != before[path]}
    assert changed == {"mask"}, "hair masks were given, and hang on nothing"


def test_after_a_kill_the_rest_is_done(
    recording: Path, faces: SeenFaces, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "capture"
    worker = OrientationStep.worker
    done: list[ViewId] = []

    def dying(self: OrientationStep):
        work = worker(self)

        def work_or_die(view: ViewId) -> None:
            if len(done) == 5:
                raise KeyboardInterrupt
            work(view)
            done.append(view)

        return work_or_die

    with monkeypatch.context() as patched:
        patched.setattr(OrientationStep, "worker", dying)
        with pytest.raises(KeyboardInterrupt):
            run(recording, out)
    assert not (out / "capture.json").exists(), "it is no capture before it is whole"
    survived = times(out, "images/*/orient_*")
    assert 5 <= len(survived) < 6 * FRAMES
    run(recording, out)
    after = times(out, "images/*/orient_*")
    assert {path: after[path] for path in survived} == survived
    assert len(after) == 6 * FRAMES
    Capture.open(out)


def test_fewer_frames_leave_none_behind(recording: Path, faces: SeenFaces, out: Path) -> None:
    run(recording, out, importing=ImportOptions(stop=4))
    capture = Capture.open(out)
    assert [segment.count for segment in capture.segments] == [4, 4]
    assert len(list((out / "images").iterdir())) == 8


def test_a_folder_that_holds_something_else_is_left_alone(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "photos"
    out.mkdir()
    (out / "cat.jpg").write_bytes(b"cat")
    with pytest.raises(DynhairError, match="something already"):
        run(recording, out)
    assert [path.name for path in out.iterdir()] == ["cat.jpg"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (PreprocessOptions(matting="modnet"), "needs your file"),
        (PreprocessOptions(hair_masks=Path("no/masks")), "no/masks"),
        (PreprocessOptions(backdrop=(0, 0, 300)), "backdrop"),
        (PreprocessOptions(face_model="imaginary"), "imaginary"),
    ],
)
def test_options_that_cannot_work_are_refused_before_anything_is_done(
    recording: Path, tmp_path: Path, options: PreprocessOptions, message: str
) -> None:
    with pytest.raises(DynhairError, match=message):
        run(recording, tmp_path / "capture", options)
    assert not (tmp_path / "capture").exists()


def test_the_wrong_folder_of_hair_masks_names_the_file(recording: Path, faces: SeenFaces, tmp_path: Path) -> None:
    (tmp_path / "masks").mkdir()
    with pytest.raises(DynhairError, match=r"masks.0000.00\.png"):
        run(recording, tmp_path / "capture", replace(PreprocessOptions(), hair_masks=tmp_path / "masks"))
