"""Cross-reenactment: where another person's motion goes, and what is measured of the avatar in it."""

from __future__ import annotations

import dataclasses
import io
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console
from scipy.spatial.transform import Rotation
from stand_ins import StandInCapture
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, ExpressionBasis, HeadTrack, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation import run as evaluation_run
from dynhair.evaluation.reenactment import NO_TRUTH, OWN_FIGURES
from dynhair.evaluation.retargeting import Retargeting, another_person
from dynhair.presets import preset
from dynhair.storage import read_json
from dynhair.training.run import Run
from synthetic import HEAD_ORIGIN, POINTS, write_synthetic_capture


class Moved(StandInCapture):
    """The stand-in's motion in another world, of a head whose expressions have another basis."""

    turn = Rotation.from_rotvec([0.3, -1.1, 0.4]).as_matrix()
    basis: ExpressionBasis | None = None
    coefficients = 1

    def track(self, segment: Segment) -> HeadTrack:
        track = super().track(segment)
        return dataclasses.replace(
            track,
            rotations=self.turn @ track.rotations,
            translations=track.translations @ self.turn.T + [4.0, -2.0, 1.0],
            expressions=np.repeat(track.expressions, self.coefficients, axis=1),
            expression_basis=self.basis,
        )


def test_a_motion_in_another_world_is_brought_to_the_avatar() -> None:
    own, driver = StandInCapture(), Moved()
    retargeting = Retargeting(own, driver)
    for segment in own.segments:
        expected, found = own.track(segment), retargeting.track(segment)
        np.testing.assert_allclose(found.rotations, expected.rotations, atol=1e-12)
        np.testing.assert_allclose(found.translations, expected.translations, atol=1e-12)
        np.testing.assert_array_equal(found.expressions, expected.expressions)
    assert retargeting.expressions == "the driver's coefficients"


def test_another_neutral_pose_does_not_tilt_the_avatar() -> None:
    """The driver's head frame is tilted within its head; at rest the avatar is at its own rest all the same."""

    class Tilted(StandInCapture):
        def track(self, segment: Segment) -> HeadTrack:
            track = super().track(segment)
            return dataclasses.replace(track, rotations=track.rotations @ Moved.turn)

    own = StandInCapture()
    found = Retargeting(own, Tilted()).track(own.segments[0])
    np.testing.assert_allclose(found.rotations[0], own.track(own.segments[0]).rotations[0], atol=1e-12)


@pytest.mark.parametrize(("coefficients", "basis"), [(3, None), (1, ExpressionBasis("FLAME"))])
def test_expressions_that_do_not_match_are_neutral(coefficients: int, basis: ExpressionBasis | None) -> None:
    own, driver = StandInCapture(), Moved()
    driver.coefficients, driver.basis = coefficients, basis

    class Named(StandInCapture):
        def track(self, segment: Segment) -> HeadTrack:
            return dataclasses.replace(super().track(segment), expression_basis=ExpressionBasis("Anny"))

    retargeting = Retargeting(Named(), driver)
    track = retargeting.track(own.segments[1])
    assert track.expressions.shape == (own.segments[1].count, 1)
    assert not track.expressions.any()
    assert track.expression_basis == ExpressionBasis("Anny")
    assert retargeting.expressions.startswith("neutral throughout: the driver")


class SwingingHead:
    """Hair that swings in the head with the frame's number."""

    def __init__(self, rest: np.ndarray, *, strands: bool) -> None:
        self.rest, self.has_strands = rest, strands

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> Posed:
        swing = 0.0 if rigid_hair else 0.01 * np.sin(frame) * np.linspace(0, 1, POINTS)[:, None] * [1.0, 0.0, 0.0]
        world = (self.rest + swing) @ track.rotations[frame].T + track.translations[frame]
        points = torch.from_numpy(world).float()
        return Posed(points, None) if self.has_strands else Posed(None, points.flatten(0, 1))

    def draw(self, posed: Posed, cameras: Sequence[Camera]) -> Images:
        black = torch.zeros(len(cameras), cameras[0].height, cameras[0].width)
        return Images(black[..., None].expand(-1, -1, -1, 3), None)


@dataclasses.dataclass(frozen=True)
class Posed:
    strands: Tensor | None
    means: Tensor | None


@dataclasses.dataclass(frozen=True)
class Images:
    rgb: Tensor
    hair: Tensor | None


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Of a person, and of one with a larger face."""
    folder = tmp_path_factory.mktemp("captures")
    own, other = (write_synthetic_capture(folder / name, frames=3, views=2) for name in ("own", "other"))
    for path in other.rglob("vertices.npy"):
        vertices = np.load(path)
        np.save(path, (1.1 * vertices).astype(np.float32))
    return own, other


def test_persons_are_told_apart_by_their_shape(captures: tuple[Path, Path], tmp_path: Path) -> None:
    own, other = (Capture.open(path) for path in captures)
    assert another_person(own, other)
    assert not another_person(own, Capture.open(captures[0]))
    copy = tmp_path / "copy"
    copy.symlink_to(captures[0])
    assert not another_person(own, Capture.open(copy))
    assert not another_person(StandInCapture(), own)  # neither mesh nor landmarks to compare


@pytest.mark.parametrize("strands", [True, False])
@pytest.mark.parametrize("alike", [True, False])
def test_the_command_measures_motion_alone(
    alike: bool, strands: bool, captures: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = captures[1]
    if alike:  # then it has to be told
        driver = tmp_path / "twin"
        shutil.copytree(captures[0], driver)
    run = Run.create(tmp_path / "run", captures[0], preset("tiny"))
    run.avatar.mkdir()
    hair = np.load(captures[0] / "gt" / "turn.npz")["strands"][0] - HEAD_ORIGIN
    monkeypatch.setattr(evaluation_run, "open_driven_head", lambda path, device: SwingingHead(hair, strands=strands))
    output = io.StringIO()
    out = tmp_path / "out"
    evaluation_run.run_evaluation(run.path, driver, out, reenact=alike, console=Console(file=output, width=80))
    assert sorted(path.name for path in out.iterdir()) == ["cross_nod.mp4", "metrics.json", "series.npz"]
    written = json.loads(json.dumps(read_json(out / "metrics.json"), allow_nan=False))
    measured = {name for name in written["definitions"] if written[name] is not None}
    kinds = {"settling_s", "penetration_depth_mm"}
    assert measured - kinds == (set(OWN_FIGURES) - kinds if strands else {"hair_velocity", "hair_acceleration"})
    assert written["reasons"]["psnr"] == NO_TRUTH
    assert written["rigid"] is None
    assert written["held_out_views"] == {"views": [], "reason": NO_TRUTH}
    assert written["protocol"]["drive"].startswith("cross-reenactment")
    assert list(written["segments"]) == ["nod"]
    with np.load(out / "series.npz") as series:
        assert np.isfinite(series["nod/tip_speed"][1:]).all() == strands
    printed = output.getvalue()
    assert "cross-reenactment" in printed
    assert max(len(line) for line in printed.splitlines() if not line.startswith("wrote")) <= 80


def test_what_drives_an_avatar_is_not_its_own_capture(
    captures: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run.create(tmp_path / "run", captures[0], preset("tiny"))
    run.avatar.mkdir()
    hair = np.load(captures[0] / "gt" / "turn.npz")["strands"][0] - HEAD_ORIGIN
    monkeypatch.setattr(evaluation_run, "open_driven_head", lambda path, device: SwingingHead(hair, strands=True))
    with pytest.raises(DynhairError, match="the one that should drive it"):
        evaluation_run.run_evaluation(run.path, captures[0], tmp_path / "out", reenact=True)
    assert not (tmp_path / "out").exists()
