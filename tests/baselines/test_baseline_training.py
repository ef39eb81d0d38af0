"""Training of the baselines without strands: it learns, and it resumes exactly."""

from __future__ import annotations

import io
import signal
from dataclasses import replace
from pathlib import Path

import pytest
import safetensors.torch
import torch
from rich.console import Console

from dynhair.baselines import BaselineName, open_driven_head, train_baseline
from dynhair.baselines.objective import PhotometricObjective, StepResult
from dynhair.baselines.start import start_bound_gaussians
from dynhair.capture import Capture
from dynhair.config import Config, HairConfig, HeadConfig, TrainingConfig
from dynhair.errors import DynhairError
from dynhair.losses import PerceptualDistance
from dynhair.training.batches import Batch, Batches
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.frames import training_segments
from dynhair.training.run import Run
from synthetic import write_synthetic_capture

CONFIG = Config(
    hair=HairConfig(strands=40, points=6),
    head=HeadConfig(gaussians=300, mouth_gaussians=20, features=4, deformation_width=8, appearance_width=8),
    training=TrainingConfig(
        iterations=12, views=2, image_size=32, precision="float32", checkpoint_every=5, preview_every=6
    ),
)
both = pytest.mark.parametrize("name", ["gha", "ga"])


def quiet() -> Console:
    return Console(file=io.StringIO(), width=200)


def with_training(**settings: int) -> Config:
    return replace(CONFIG, training=replace(CONFIG.training, **settings))


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "capture"
    return write_synthetic_capture(path, frames=6, views=3, size=32, static_views=4)


@pytest.fixture(scope="module")
def trained(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folders: dict[str, Path] = {}
    for name in ("gha", "ga"):
        folders[name] = tmp_path_factory.mktemp("runs") / name
        train_baseline(name, capture, folders[name], CONFIG, console=quiet())
    return folders


def assert_same_head(one: Path, other: Path) -> None:
    a, b = (safetensors.torch.load_file(folder / "avatar" / "avatar.safetensors") for folder in (one, other))
    assert a.keys() == b.keys()
    assert all(torch.equal(value, b[name]) for name, value in a.items())


@both
def test_a_run_leaves_a_head_a_checkpoint_a_log_and_a_preview(
    name: BaselineName, capture: Path, trained: dict[str, Path]
) -> None:
    data, out = Capture.open(capture), trained[name]
    head = open_driven_head(out)  # a run's folder stands for its head
    segment = data.segment("nod")
    posed = head.pose(data.track(segment), 3)
    images = head.draw(posed, [data.camera(segment.start + 3, view) for view in data.camera_names])
    assert posed.strands is None
    assert images.rgb.shape == (3, 32, 32, 3)
    assert images.rgb.isfinite().all()
    assert images.alpha.max() > 0.9
    assert Run.open(out).preview.exists()
    assert list(Run.open(out).log.glob("events.*"))
    assert Checkpoint.read(Run.open(out).checkpoint).step == 12
    assert not list(out.glob(".*"))


@both
def test_an_interrupted_run_goes_on_to_the_same_head(
    name: BaselineName, capture: Path, trained: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = Batches.batch

    def interrupted(self: Batches, step: int) -> Batch:
        if step == 8:
            signal.raise_signal(signal.SIGINT)
        return original(self, step)

    out = tmp_path / "run"
    with monkeypatch.context() as patched:
        patched.setattr(Batches, "batch", interrupted)
        patched.setattr(Batches, "from_step", lambda self, step, stop: map(self.batch, range(step, stop)))
        with pytest.raises(KeyboardInterrupt):
            train_baseline(name, capture, out, CONFIG, console=quiet())
    assert not Run.open(out).avatar.exists()
    assert Checkpoint.read(Run.open(out).checkpoint).step == 9
    train_baseline(name, capture, out, CONFIG, resume=True, console=quiet())
    assert_same_head(out, trained[name])


@both
def test_a_run_whose_time_is_up_has_a_head_and_can_go_on(
    name: BaselineName, capture: Path, trained: dict[str, Path], tmp_path: Path
) -> None:
    out = tmp_path / "run"
    train_baseline(name, capture, out, CONFIG, minutes=0.0, console=quiet())
    assert Checkpoint.read(Run.open(out).checkpoint).step == 1
    open_driven_head(out)
    train_baseline(name, capture, out, CONFIG, resume=True, console=quiet())
    assert_same_head(out, trained[name])


@pytest.mark.slow
@both
def test_training_brings_the_head_closer_to_the_images(name: BaselineName, capture: Path, tmp_path: Path) -> None:
    data = Capture.open(capture)
    segment = training_segments(data)[0]

    def error(iterations: int) -> float:
        out = tmp_path / str(iterations)
        train_baseline(name, capture, out, with_training(iterations=iterations, static_every=0), console=quiet())
        head, total = open_driven_head(out), 0.0
        for index in range(segment.count):
            cameras = [data.camera(segment.start + index, view) for view in data.camera_names]
            with torch.no_grad():
                rgb = head.draw(head.pose(data.track(segment), index), cameras).rgb
            truth = torch.stack([data.view(segment.start + index, view).rgb for view in data.camera_names])
            total += float((rgb - truth).abs().mean())
        return total / segment.count

    assert error(80) < 0.8 * error(1)  # it begins in the colours of the views


def test_runs_of_others_are_refused(capture: Path, trained: dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="something already"):
        train_baseline("gha", capture, trained["gha"], CONFIG, console=quiet())
    with pytest.raises(DynhairError, match="trains 'gha'"):
        train_baseline("ga", capture, trained["gha"], CONFIG, resume=True, console=quiet())
    other = write_synthetic_capture(tmp_path / "other", frames=2, views=2, size=16)
    with pytest.raises(DynhairError, match="trained on"):
        train_baseline("gha", other, trained["gha"], CONFIG, resume=True, console=quiet())


def test_steps_that_are_not_finite_stop_the_training(
    capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = PhotometricObjective.forward

    def spoiled(self: PhotometricObjective, batch: Batch, step: int) -> StepResult:
        result = original(self, batch, step)
        return result._replace(loss=result.loss * float("nan"))

    monkeypatch.setattr(PhotometricObjective, "forward", spoiled)
    with pytest.raises(DynhairError, match=r"3 steps were skipped.*the loss is not finite"):
        train_baseline("ga", capture, tmp_path / "run", with_training(bad_steps=2), console=quiet())


def test_the_objective_adds_up_its_terms_and_compares_crops_now_and_then(capture: Path) -> None:
    data = Capture.open(capture)
    segments = training_segments(data)
    weights = replace(CONFIG.training.weights, perceptual=0.1, perceptual_raised=0.6)
    config = replace(CONFIG.training, weights=weights, perceptual_every=4, perceptual_crop=32)
    head = start_bound_gaussians(data, CONFIG)
    torch.manual_seed(0)
    objective = PhotometricObjective(head, data, segments, config, PerceptualDistance("alexnet").eval())
    batch = Batches(data, segments, views=2, image_size=32, seed=0).batch(0)
    for step, raised in ((4, 0.1), (8, 0.1), (9, None), (11, None)):
        result = objective(batch, step)
        expected = {"rgb": weights.rgb, "ssim": weights.ssim, "coverage": weights.body}
        expected |= {name: weight for name, (weight, _) in head.regularizers(config).items()}
        if raised is not None:
            expected["perceptual"] = 4 * (raised if step < 9 else 0.6)
        assert result.terms.keys() == expected.keys()
        total = sum(weight * result.terms[name].item() for name, weight in expected.items())
        assert result.loss.item() == pytest.approx(total, rel=1e-5)
    result.loss.backward()
    corrected = [parameter.grad is not None for parameter in objective.pose_corrections]
    assert sum(corrected) == 1  # that of the batch's frame
    assert corrected[batch.index]
