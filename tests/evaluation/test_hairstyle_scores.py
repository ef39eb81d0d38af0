"""The figures of a hairstyle at rest, on a tiny capture whose true strands are known."""

from __future__ import annotations

import itertools
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from dynhair.avatar import head_pose
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.evaluation.hairstyle import HairstyleScores, hairstyle_scores
from dynhair.training.frames import rest_frame
from dynhair.training.static_scene import render_hair, surface_gaussians
from dynhair.training.static_views import RestViews, rest_views
from synthetic import HEAD_ORIGIN, HEAD_RADIUS, write_synthetic_capture

SIZE = 64
WIDTH = 0.004
STATIC_VIEWS = 12  # of which two are held out


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "capture"
    write_synthetic_capture(path, frames=2, views=2, size=SIZE, static_views=STATIC_VIEWS)
    np.savez(path / "gt" / "strands_frame0_all.npz", strands=np.load(path / "gt" / "turn.npz")["strands"][0])
    return path


@pytest.fixture(scope="module")
def truth(path: Path) -> torch.Tensor:
    """The true strands in the head frame: at rest the head is not turned."""
    strands = np.load(path / "gt" / "strands_frame0_all.npz")["strands"] - HEAD_ORIGIN
    return torch.from_numpy(strands).float()


@pytest.fixture(scope="module")
def true_scores(path: Path, truth: torch.Tensor) -> HairstyleScores:
    return hairstyle_scores(Capture.open(path), truth, width=WIDTH)


@pytest.fixture
def copy(path: Path, tmp_path: Path) -> Path:
    return shutil.copytree(path, tmp_path / "capture")


def views_and_body(capture: Capture, *, held_out: bool) -> tuple[RestViews, object]:
    segment, index = rest_frame(capture)
    pose = head_pose(capture.track(segment), index)
    assert capture.mesh is not None
    vertices = torch.from_numpy(capture.vertices(0)) - pose.translation
    body = surface_gaussians(vertices, torch.from_numpy(capture.mesh.faces))
    return rest_views(capture, 0, pose, held_out=held_out), body


@pytest.mark.parametrize("held_out", [False, True])
def test_figures_of_views_agree_with_loops_over_their_pixels(path: Path, truth: torch.Tensor, held_out: bool) -> None:
    hair = truth + 0.003 * torch.randn(truth.shape, generator=torch.Generator().manual_seed(0))
    scores = hairstyle_scores(Capture.open(path), hair, width=WIDTH)
    figures = scores.held_out if held_out else scores.seen
    views, body = views_and_body(Capture.open(path), held_out=held_out)
    drawn = render_hair(hair, WIDTH, body, views.cameras)  # pyright: ignore[reportArgumentType]
    coverages, hairs = drawn.coverage.tolist(), views.hair.tolist()
    drawn_directions, directions = drawn.direction.tolist(), views.direction.tolist()
    overlaps, angles = [], []
    for v, y in itertools.product(range(len(views)), range(SIZE)):
        if y == 0:
            overlaps.append([0, 0])
        for x in range(SIZE):
            ours, theirs = coverages[v][y][x] > 0.5, hairs[v][y][x] > 0.5
            overlaps[v][0] += ours and theirs
            overlaps[v][1] += ours or theirs
            found, known = complex(*drawn_directions[v][y][x]), complex(*directions[v][y][x])
            if ours and theirs and abs(known) > 0.5 * hairs[v][y][x]:
                difference = np.degrees(np.angle(found) - np.angle(known)) / 2 % 180
                angles.append(min(difference, 180 - difference))
    assert figures.views == len(views) == (2 if held_out else STATIC_VIEWS)
    assert figures.iou == pytest.approx(np.mean([both / either for both, either in overlaps]))
    assert figures.orientation_pixels == len(angles)
    assert figures.orientation_error == pytest.approx(np.mean(angles), abs=1e-3)


def test_the_true_hair_scores_well(true_scores: HairstyleScores) -> None:
    for figures in (true_scores.seen, true_scores.held_out):
        assert figures.iou is not None
        assert figures.orientation_error is not None
        assert figures.iou > 0.7
        assert figures.orientation_error < 10
        assert figures.orientation_pixels > 100
    assert true_scores.strands is not None
    assert all(score.f == 1 for score in true_scores.strands)
    assert true_scores.inside < 0.05


def test_wrong_hair_scores_worse(path: Path, truth: torch.Tensor, true_scores: HairstyleScores) -> None:
    turned = (truth - truth[:, :1]).flip(-1) + truth[:, :1] + torch.tensor([0.05, 0.05, 0.0])
    wrong = hairstyle_scores(Capture.open(path), turned, width=WIDTH)
    for bad, good in ((wrong.seen, true_scores.seen), (wrong.held_out, true_scores.held_out)):
        assert bad.iou is not None and good.iou is not None and bad.iou < good.iou - 0.2  # noqa: PT018
        assert bad.orientation_error is not None and good.orientation_error is not None  # noqa: PT018
        assert bad.orientation_error > good.orientation_error + 5
    assert wrong.strands is not None
    assert wrong.strands[0].f < 0.5


def test_points_inside_the_head_are_counted_without_roots(path: Path) -> None:
    """Three points a strand: a root inside, one point inside, one outside."""
    radii = torch.tensor([0.5, 0.8, 1.5]) * HEAD_RADIUS
    directions = torch.nn.functional.normalize(
        torch.tensor([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, -1.0]]), dim=1
    )
    scores = hairstyle_scores(Capture.open(path), directions[:, None] * radii[:, None], width=WIDTH)
    assert scores.inside == 0.5


def test_the_width_is_that_of_training_if_not_given(path: Path, truth: torch.Tensor) -> None:
    """160 strands are drawn as wide as a strand may be, 4 mm."""
    assert hairstyle_scores(Capture.open(path), truth) == hairstyle_scores(Capture.open(path), truth, width=0.004)


def test_what_the_capture_does_not_hold_is_not_measured(copy: Path, truth: torch.Tensor) -> None:
    (copy / "gt" / "strands_frame0_all.npz").unlink()
    for orientation in copy.rglob("orient_*"):
        orientation.unlink()
    for image in (copy / "static360" / "images").iterdir():
        image.unlink()
    scores = hairstyle_scores(Capture.open(copy), truth, width=WIDTH)
    assert scores.strands is None
    assert (scores.seen.views, scores.seen.orientation_error, scores.seen.orientation_pixels) == (2, None, 0)
    assert scores.seen.iou is not None
    assert (scores.held_out.views, scores.held_out.iou, scores.held_out.orientation_error) == (0, None, None)
    assert json.loads(json.dumps(scores.to_json()))["held_out"]["iou"] is None


def test_a_capture_without_hair_masks_is_refused(copy: Path, truth: torch.Tensor) -> None:
    for mask in copy.rglob("hair_*"):
        mask.unlink()
    with pytest.raises(DynhairError, match="no hair masks"):
        hairstyle_scores(Capture.open(copy), truth)


def test_damaged_true_strands_are_reported(copy: Path, truth: torch.Tensor) -> None:
    np.savez(copy / "gt" / "strands_frame0_all.npz", strands=np.zeros((3, 3)))
    with pytest.raises(DynhairError, match="strands"):
        hairstyle_scores(Capture.open(copy), truth)


def test_scores_become_json(true_scores: HairstyleScores) -> None:
    written = json.loads(json.dumps(true_scores.to_json()))
    assert written["seen"]["iou"] == true_scores.seen.iou
    assert written["held_out"]["views"] == 2
    assert written["inside"] == true_scores.inside
    assert [score["distance"] for score in written["strands"]] == [0.002, 0.003, 0.004]
