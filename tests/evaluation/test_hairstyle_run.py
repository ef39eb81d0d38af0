"""The hair at rest as the command evaluates it: of a run's stages, of an avatar alone, and where it cannot be."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from rich.console import Console

from dynhair.avatar import Hair
from dynhair.camera import Camera
from dynhair.capture import Capture, HeadTrack
from dynhair.editing import Thin, Trim, Width
from dynhair.errors import DynhairError
from dynhair.evaluation import run as evaluation_run
from dynhair.evaluation.hairstyle import HairstyleScores, hairstyle_scores
from dynhair.evaluation.run import RunEvaluation, run_evaluation
from dynhair.presets import preset
from dynhair.storage import read_json
from dynhair.training.run import Run, write_hair
from synthetic import HEAD_ORIGIN, write_synthetic_capture
from tiny_avatars import SMALL, make_avatar


class RigidAvatar:
    """Its hair stands still in the head; it renders black."""

    def __init__(self, strands: torch.Tensor) -> None:
        self.canonical_strands = strands

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> SimpleNamespace:
        rotation, translation = torch.from_numpy(track.rotations[frame]), torch.from_numpy(track.translations[frame])
        return SimpleNamespace(strands=(self.canonical_strands.double() @ rotation.T + translation).float())

    def draw(self, posed: SimpleNamespace, cameras: Sequence[Camera]) -> SimpleNamespace:
        black = torch.zeros(len(cameras), cameras[0].height, cameras[0].width)
        return SimpleNamespace(rgb=black[..., None].expand(-1, -1, -1, 3), hair=black)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = write_synthetic_capture(
        tmp_path_factory.mktemp("data") / "capture", frames=2, views=2, size=48, static_views=4
    )
    np.savez(path / "gt" / "strands_frame0_all.npz", strands=np.load(path / "gt" / "turn.npz")["strands"][0])
    return path


@pytest.fixture(scope="module")
def truth(capture: Path) -> torch.Tensor:
    return torch.from_numpy(np.load(capture / "gt" / "strands_frame0_all.npz")["strands"] - HEAD_ORIGIN).float()


@pytest.fixture
def run(capture: Path, truth: torch.Tensor, tmp_path: Path) -> Run:
    """A run whose static stage is done, and found the true hair."""
    run = Run.create(tmp_path / "run", capture, preset("tiny"))
    write_hair(truth, run.canonical_hair)
    return run


def evaluate(path: Path, capture: Path, out: Path) -> tuple[RunEvaluation, str]:
    output = io.StringIO()
    return run_evaluation(path, capture, out, console=Console(file=output, width=80)), output.getvalue()


@pytest.mark.parametrize("folder", ["", "avatar"])
def test_a_run_without_an_avatar_is_evaluated_at_rest(folder: str, run: Run, capture: Path, tmp_path: Path) -> None:
    """Also if asked for by the place where its avatar will be."""
    evaluation, printed = evaluate(run.path / folder, capture, tmp_path / "out")
    assert evaluation.motion is None
    assert evaluation.hairstyle is not None
    assert list(evaluation.hairstyle.scores) == ["canonical"]
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["metrics.json"]
    written = read_json(tmp_path / "out" / "metrics.json")
    assert written["avatar"] == (folder or "run")
    assert written["hairstyle"]["canonical"]["strands"][0]["f"] == 1
    assert written["hairstyle"]["canonical"]["held_out"]["views"] == 1
    assert written["hairstyle"]["protocol"]["true_strands"] == "all 160 of 12 points"
    assert "1.000 / 1.000 / 1.000" in printed
    assert "n/a" not in printed


def test_the_first_guess_stands_beside_the_result(run: Run, capture: Path, truth: torch.Tensor, tmp_path: Path) -> None:
    write_hair(truth * 1.3, run.first_guess)
    evaluation, printed = evaluate(run.path, capture, tmp_path / "out")
    assert evaluation.hairstyle is not None
    guess, result = evaluation.hairstyle.scores.values()
    assert guess.strands is not None and result.strands is not None  # noqa: PT018
    assert guess.strands[0].f < result.strands[0].f
    written = read_json(tmp_path / "out" / "metrics.json")["hairstyle"]
    assert written["first_guess"]["strands"][0]["f"] == guess.strands[0].f
    lines = [line for line in printed.splitlines() if not line.startswith("wrote")]
    assert max(map(len, lines)) <= 80
    assert "…" not in printed
    assert "first guess" in lines[0]
    assert lines[0].index("first guess") < lines[0].index("canonical")


def test_an_avatar_in_its_run_gets_both_parts(
    run: Run, capture: Path, truth: torch.Tensor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run.avatar.mkdir()
    monkeypatch.setattr(evaluation_run, "open_driven_head", lambda path, device: RigidAvatar(truth + 0.1))
    evaluations = [evaluate(path, capture, tmp_path / path.name)[0] for path in (run.path, run.avatar)]
    for evaluation in evaluations:
        assert evaluation.motion is not None
        assert evaluation.hairstyle is not None
        assert evaluation.hairstyle.scores["canonical"].strands is not None
        assert evaluation.hairstyle.scores["canonical"].strands[0].f == 1  # of the run's hair
    written = read_json(tmp_path / "avatar" / "metrics.json")
    assert {"psnr", "segments", "hairstyle"} < set(written)


def test_an_avatar_alone_brings_its_own_hair(
    capture: Path, truth: torch.Tensor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation_run, "open_driven_head", lambda path, device: RigidAvatar(truth))
    evaluation, _ = evaluate(tmp_path / "avatar", capture, tmp_path / "out")
    assert evaluation.hairstyle is not None
    assert evaluation.hairstyle.scores["canonical"].strands is not None
    assert evaluation.hairstyle.scores["canonical"].strands[0].f == 1


def test_hair_that_was_edited_is_measured_as_it_was_and_as_it_is(
    run: Run, capture: Path, truth: torch.Tensor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_hair(truth * 1.3, run.first_guess)
    run.avatar.mkdir()
    avatar = make_avatar()
    avatar.hair = Hair(truth, 0.003, torch.zeros(3), SMALL, dynamic=False)
    monkeypatch.setattr(
        evaluation_run, "open_driven_head", lambda path, device: avatar.edited(Trim(0.5), Thin(0.5), Width(2.0))
    )
    driven = evaluation_run.evaluate_avatar
    still = RigidAvatar(truth)  # what moves is not what is tested here, and expressions are of another face
    monkeypatch.setattr(evaluation_run, "evaluate_avatar", lambda _, *given, **named: driven(still, *given, **named))
    scores = read_scores(evaluate(run.path, capture, tmp_path / "out")[0])
    assert list(scores) == ["canonical", "edited"]
    whole, edited = (scores[name].strands for name in scores)
    assert whole is not None and edited is not None  # noqa: PT018
    assert whole[0].f == 1
    assert edited[0].recall < 0.6 < edited[0].precision
    thin = hairstyle_scores(Capture.open(capture), avatar.edited(Trim(0.5), Thin(0.5)).resting_strands, width=0.003)
    assert scores["edited"].inside == thin.inside
    assert scores["edited"].seen.orientation_pixels > thin.seen.orientation_pixels  # it is drawn as wide as it is


def read_scores(evaluation: RunEvaluation) -> Mapping[str, HairstyleScores]:
    assert evaluation.hairstyle is not None
    return evaluation.hairstyle.scores


def test_what_is_missing_is_named(truth: torch.Tensor, tmp_path: Path) -> None:
    bare = write_synthetic_capture(tmp_path / "bare", frames=2, views=1, size=48, with_gt=False)
    run = Run.create(tmp_path / "run", bare, preset("tiny"))
    write_hair(truth, run.canonical_hair)
    for orientation in bare.rglob("orient_*"):
        orientation.unlink()
    _, printed = evaluate(run.path, bare, tmp_path / "out")
    assert printed.count("n/a: ") == 3
    assert max(len(line) for line in printed.splitlines() if not line.startswith("wrote")) <= 80


def test_an_avatar_is_evaluated_in_motion_where_the_hair_at_rest_cannot_be(
    truth: torch.Tensor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = write_synthetic_capture(tmp_path / "bare", frames=2, views=1, size=48, with_gt=False)
    for mask in bare.rglob("hair_*"):
        mask.unlink()
    monkeypatch.setattr(evaluation_run, "open_driven_head", lambda path, device: RigidAvatar(truth))
    evaluation, printed = evaluate(tmp_path / "avatar", bare, tmp_path / "out")
    assert evaluation.motion is not None
    assert evaluation.hairstyle is None
    assert "n/a: the hair at rest: the capture has no hair masks" in printed
    assert "no hair masks" in read_json(tmp_path / "out" / "metrics.json")["hairstyle"]["reason"]

    run = Run.create(tmp_path / "run", bare, preset("tiny"))
    write_hair(truth, run.canonical_hair)
    with pytest.raises(DynhairError, match="no hair masks"):
        evaluate(run.path, bare, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_a_run_that_has_no_hair_yet_is_refused(capture: Path, tmp_path: Path) -> None:
    run = Run.create(tmp_path / "run", capture, preset("tiny"))
    with pytest.raises(DynhairError, match="there is no such folder"):
        evaluate(run.path, capture, tmp_path / "out")
