"""The canonical hairstyle from a tiny capture."""

from __future__ import annotations

import io
import shutil
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from rich.console import Console

from dynhair.avatar import head_pose
from dynhair.capture import Capture
from dynhair.config import Config, HairConfig, StaticConfig
from dynhair.errors import DynhairError
from dynhair.losses import PerceptualDistance
from dynhair.progress import StageProgress
from dynhair.strands import MeshDistance, segment_lengths
from dynhair.strands.files import write_strands
from dynhair.training import static_hair, static_objective
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.frames import head_frame, rest_frame
from dynhair.training.rest_scene import RestScene
from dynhair.training.run import Run, read_hair
from dynhair.training.static_hair import StaticStage, strand_width
from dynhair.training.static_model import DisplacedHair
from dynhair.training.static_objective import StaticObjective, StaticStep
from dynhair.training.static_scene import render_hair, surface_gaussians
from dynhair.training.static_views import rest_views
from synthetic import write_synthetic_capture


@pytest.fixture(scope="module")
def capture_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "capture"
    return write_synthetic_capture(path, frames=2, views=3, size=48, static_views=4)


@pytest.fixture
def config(small_prior: Path) -> Config:
    return Config(
        hair=HairConfig(strands=60, points=10),
        static=StaticConfig(prior=str(small_prior), encoder_iterations=2, iterations=8, checkpoint_every=3),
    )


def fit(path: Path, out: Path, config: Config, hair_init: Path | None = None, *, resume: bool = False) -> torch.Tensor:
    capture = Capture.open(path)
    run = Run.open(out) if resume else Run.create(out, capture.path, config, hair_init)
    console = Console(file=io.StringIO())
    return StaticStage(run, capture, StageProgress(console), console).finish()


def with_steps(config: Config, encoders: int, strands: int, seed: int = 0) -> Config:
    static = replace(config.static, encoder_iterations=encoders, iterations=strands)
    return replace(config, static=static, training=replace(config.training, seed=seed))


def rest_vertices(capture: Capture) -> torch.Tensor:
    segment, index = rest_frame(capture)
    vertices = torch.from_numpy(capture.vertices(segment.start + index))
    return head_frame(capture.track(segment), index)(vertices)


def uncovered_hair(capture: Capture, strands: torch.Tensor) -> float:
    assert capture.mesh is not None
    segment, index = rest_frame(capture)
    views = rest_views(capture, segment.start + index, head_pose(capture.track(segment), index))
    body = surface_gaussians(rest_vertices(capture), torch.from_numpy(capture.mesh.faces))
    images = render_hair(strands, strand_width(len(strands)), body, views.cameras)
    return float((views.hair - images.coverage).clamp_min(0).sum() / views.hair.sum())


def test_strands_grow_on_the_scalp_outside_of_the_head(capture_path: Path, config: Config, tmp_path: Path) -> None:
    capture = Capture.open(capture_path)
    strands = fit(capture_path, tmp_path / "run", config)
    assert capture.mesh is not None
    assert strands.shape == (60, 200, 3)
    assert torch.isfinite(strands).all()
    vertices, faces = rest_vertices(capture), torch.from_numpy(capture.mesh.faces)
    distance, _ = MeshDistance(vertices, faces).query(strands[:, 1:].flatten(0, 1))
    assert (distance < 0).float().mean() < 0.005
    scalp = MeshDistance(vertices, faces[torch.from_numpy(capture.mesh.scalp)])
    # The scalp is rounder than its triangles.
    assert scalp.query(strands[:, 0])[0].abs().max() < 4e-3
    lengths = segment_lengths(strands)
    assert (lengths.amax(1) / lengths.amin(1)).median() < 1.2


def test_the_stage_leaves_a_first_guess_and_a_picture(capture_path: Path, config: Config, tmp_path: Path) -> None:
    fit(capture_path, tmp_path / "run", config)
    run = Run.open(tmp_path / "run")
    guess = read_hair(run.first_guess)
    assert guess is not None
    assert guess.shape == (60, 200, 3)
    picture = np.asarray(Image.open(run.hairstyle_preview))
    assert picture.shape[1] > 7 * 48


def test_a_seed_decides_the_result_bit_for_bit(capture_path: Path, config: Config, tmp_path: Path) -> None:
    first = fit(capture_path, tmp_path / "a", config)
    assert torch.equal(fit(capture_path, tmp_path / "b", config), first)
    assert not torch.equal(fit(capture_path, tmp_path / "c", with_steps(config, 2, 8, seed=1)), first)


def test_ground_truth_and_held_out_views_are_not_read(capture_path: Path, config: Config, tmp_path: Path) -> None:
    copy = tmp_path / "capture"
    shutil.copytree(capture_path, copy)
    shutil.rmtree(copy / "gt")
    held_out = sorted((copy / "static360" / "images").glob("*_03.*"))
    assert held_out
    for picture in held_out:
        Image.fromarray(np.zeros_like(np.asarray(Image.open(picture)))).save(picture)
    assert torch.equal(fit(copy, tmp_path / "a", config), fit(capture_path, tmp_path / "b", config))


@pytest.mark.parametrize("stopped_after", [1, 5])
def test_an_interrupted_stage_goes_on_to_the_same_strands(
    capture_path: Path, config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stopped_after: int
) -> None:
    whole = fit(capture_path, tmp_path / "whole", config)
    calls = 0
    original = StaticObjective.__call__

    def interrupted(self: StaticObjective, *arguments: object) -> StaticStep:
        nonlocal calls
        calls += 1
        if calls == stopped_after:
            signal.raise_signal(signal.SIGINT)
        return original(self, *arguments)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        patched.setattr(static_objective.StaticObjective, "__call__", interrupted)
        with pytest.raises(KeyboardInterrupt):
            fit(capture_path, tmp_path / "run", config)
    assert calls == stopped_after
    assert torch.equal(fit(capture_path, tmp_path / "run", config, resume=True), whole)


def test_the_encoders_are_trained_on_the_views(capture_path: Path, config: Config, tmp_path: Path) -> None:
    fit(capture_path, tmp_path / "run", config)
    run = Run.open(tmp_path / "run")
    guess = read_hair(run.first_guess)
    start = Checkpoint.read(run.moved_strands).model["hair.start"]
    assert guess is not None
    assert not torch.equal(start, guess)
    assert torch.allclose(start, guess, atol=0.01)


def test_optimisation_covers_the_hair_that_is_seen(capture_path: Path, config: Config, tmp_path: Path) -> None:
    capture = Capture.open(capture_path)
    dense = replace(config, hair=HairConfig(strands=400, points=10))
    guessed = uncovered_hair(capture, fit(capture_path, tmp_path / "a", with_steps(dense, 0, 0)))
    moved = uncovered_hair(capture, fit(capture_path, tmp_path / "b", with_steps(dense, 0, 80)))
    assert moved < 0.6 * guessed


def test_a_groom_from_a_file_takes_the_place_of_the_guess(capture_path: Path, config: Config, tmp_path: Path) -> None:
    made = fit(capture_path, tmp_path / "a", config)
    # A groom in another program's units and axes: centimetres, z up.
    groom = 100 * torch.stack([made[..., 0], -made[..., 2], made[..., 1]], -1)
    write_strands(tmp_path / "groom.hair", groom[:, ::4])
    fit(capture_path, tmp_path / "b", with_steps(config, 0, 0), tmp_path / "groom.hair")
    guess = read_hair(Run.open(tmp_path / "b").first_guess)
    assert guess is not None
    assert guess.shape == (60, 200, 3)
    nearest = torch.cdist(guess[:, ::20].flatten(1), made[:, ::20].flatten(1)).amin(1)
    assert nearest.median() < 0.05


def test_what_looks_more_like_the_hair_begins(
    capture_path: Path, config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grown: list[torch.Tensor] = []

    def style(scene: RestScene, count: int, _: int, seed: int, progress: Callable[[int, float], None]) -> torch.Tensor:
        progress(1, 1.0)
        positions, normals = scene.roots(count, seed)
        grown.append(positions[:, None] + torch.linspace(0, 0.02, 200)[:, None] * normals[:, None])
        return grown[-1]

    monkeypatch.setattr(static_hair, "grown_style", style)
    misfits = iter([0.2, 0.1, 0.1, 0.2])
    monkeypatch.setattr(static_hair, "misfit_in_few_views", lambda *_: next(misfits))
    for name in "ab":
        fit(capture_path, tmp_path / name, with_steps(config, 0, 0))
    starts = [Checkpoint.read(Run.open(tmp_path / name).moved_strands).model["hair.start"] for name in "ab"]
    assert torch.equal(starts[0], grown[0])
    assert not torch.equal(starts[1], grown[1])


def test_orientations_and_static_views_are_optional(config: Config, tmp_path: Path) -> None:
    path = write_synthetic_capture(tmp_path / "c", frames=2, views=2, size=32)
    for orientation in path.glob("**/orient_*.png"):
        orientation.unlink()
    assert torch.isfinite(fit(path, tmp_path / "run", with_steps(config, 1, 2))).all()


def test_no_masks_and_no_hair_are_refused(capture_path: Path, config: Config, tmp_path: Path) -> None:
    bald = tmp_path / "bald"
    shutil.copytree(capture_path, bald)
    for mask in bald.glob("**/hair_*.png"):
        Image.fromarray(np.zeros((48, 48), np.uint8)).save(mask)
    with pytest.raises(DynhairError, match="shows hair"):
        fit(bald, tmp_path / "a", config)
    for mask in bald.glob("**/hair_*.png"):
        mask.unlink()
    with pytest.raises(DynhairError, match="no hair masks"):
        fit(bald, tmp_path / "b", config)


def test_the_perceptual_term_is_taken_where_it_has_a_weight(
    capture_path: Path, config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.manual_seed(0)
    monkeypatch.setattr(PerceptualDistance, "pretrained", lambda: PerceptualDistance("vgg16"))
    weighted = replace(config.static, weights=replace(config.static.weights, perceptual=10.0))
    without = fit(capture_path, tmp_path / "a", config)
    assert not torch.equal(fit(capture_path, tmp_path / "b", replace(config, static=weighted)), without)


def test_roots_that_are_seen_bare_are_dropped(capture_path: Path, tmp_path: Path) -> None:
    copy = tmp_path / "capture"
    shutil.copytree(capture_path, copy)
    for mask in copy.glob("**/hair_*.png"):
        hair = np.array(Image.open(mask))
        hair[: hair.shape[0] // 3] = 0
        Image.fromarray(hair).save(mask)
    whole = RestScene.of(Capture.open(capture_path), 512)
    cropped = RestScene.of(Capture.open(copy), 512)
    positions, normals = whole.roots(200, 0)
    assert cropped.bare(positions, normals).sum() > whole.bare(positions, normals).sum() + 10


def test_displaced_strands_begin_where_they_are_and_keep_their_roots() -> None:
    random = torch.Generator().manual_seed(0)
    start = torch.randn(40, 200, 3, generator=random).cumsum(1) * 0.01
    model = DisplacedHair(start)
    assert torch.allclose(model(200), start)
    with torch.no_grad():
        model.own.add_(0.1)
        model.shared.add_(0.1)
    moved = model(200)
    assert torch.equal(moved[:, 0], start[:, 0])
    assert torch.allclose(moved[:, -1], start[:, -1] + 0.2, atol=1e-5)


def test_more_strands_are_thinner_within_limits() -> None:
    assert strand_width(500) == pytest.approx(3e-3)
    assert strand_width(2000) < strand_width(1000)
    assert (strand_width(10), strand_width(100_000)) == (4e-3, 1e-4)
