"""Joint training that meets bad steps, damaged images, a full disk and a lack of memory."""

from __future__ import annotations

import errno
import math
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from quick_runs import CONFIG, assert_same_avatar, begin, branch_off, go_on, with_training
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from dynhair.capture import Capture
from dynhair.config import HairConfig
from dynhair.errors import DynhairError
from dynhair.storage import atomic_file
from dynhair.training import checkpoint as checkpoints
from dynhair.training import joint_training
from dynhair.training.batches import Batch
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.joint_training import JointTraining
from dynhair.training.objective import JointObjective, StepResult
from dynhair.training.run import Run
from synthetic import write_synthetic_capture

Change = Callable[[StepResult], StepResult]


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "capture"
    return write_synthetic_capture(path, frames=6, views=3, size=32, static_views=4)


@pytest.fixture(scope="module")
def begun(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return begin(capture, tmp_path_factory.mktemp("runs") / "begun")


@pytest.fixture(scope="module")
def trained(capture: Path, begun: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = branch_off(begun, tmp_path_factory.mktemp("runs") / "trained")
    go_on(capture, out)
    return out


def spoil(patch: pytest.MonkeyPatch, change: Change, steps: range) -> None:
    """Change what some steps compute."""
    original = JointObjective.forward

    def forward(self: JointObjective, batch: Batch, step: int) -> StepResult:
        result = original(self, batch, step)
        return change(result) if step in steps else result

    patch.setattr(JointObjective, "forward", forward)


def not_finite(result: StepResult) -> StepResult:
    return result._replace(loss=result.loss * math.nan, terms=result.terms | {"ssim": torch.tensor(math.nan)})


def exploding(result: StepResult) -> StepResult:
    return result._replace(loss=result.loss * 1e5)


def everything(training: JointTraining) -> dict[str, torch.Tensor]:
    state = Checkpoint.of(0, training.objective, training.optimizer)
    tensors = {f"model.{name}": value for name, value in state.model.items()}
    return {name: value.clone() for name, value in (tensors | state.optimizer).items()}


@pytest.mark.parametrize(("change", "steps"), [(not_finite, range(3, 5)), (exploding, range(22, 23))])
def test_a_bad_step_changes_nothing_and_is_counted(
    change: Change, steps: range, capture: Path, begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original, unchanged = JointTraining._advance, []

    def advance(self: JointTraining, outcome: joint_training.Outcome, step: int, batch: Batch) -> None:
        before = everything(self)
        original(self, outcome, step, batch)
        after = everything(self)
        if before.keys() == after.keys() and all(torch.equal(value, after[name]) for name, value in before.items()):
            unchanged.append(step)

    monkeypatch.setattr(JointTraining, "_advance", advance)
    spoil(monkeypatch, change, steps)
    out = branch_off(begun, tmp_path / "run", with_training(iterations=24))
    said = go_on(capture, out)
    assert unchanged == list(steps)
    assert f"{len(steps)} skipped" in said
    events = EventAccumulator(str(out / "log"))
    events.Reload()
    assert events.Scalars("skipped steps")[-1].value == len(steps)
    assert {"loss", "iterations per second", "learning-rate factor", "gradient norm"} <= set(events.Tags()["scalars"])
    assert {"terms/rgb", "terms/elastic", "terms/orientation"} <= set(events.Tags()["scalars"])
    record = Checkpoint.read(Run.open(out).checkpoint).record
    assert (record["skipped"], record["in_a_row"]) == (len(steps), 0)


def test_too_many_bad_steps_stop_the_run_with_a_diagnosis_and_it_can_be_resumed(
    capture: Path, begun: Path, trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = branch_off(begun, tmp_path / "run", with_training(bad_steps=2))
    with monkeypatch.context() as patched:
        spoil(patched, not_finite, range(6, 12))
        with pytest.raises(DynhairError) as caught:
            go_on(capture, out)
    said = str(caught.value)
    for part in (
        "3 steps were skipped",
        "step 8",
        "the loss is not finite",
        "Terms, without weights: not finite ssim",
        "Frame ",
    ):
        assert part in said
    for part in (
        "views 0",
        "Gradients: not finite strands",
        "last checkpoint is of step 5",
        "--resume",
        "training.rates",
    ):
        assert part in said
    assert caught.value.path == Run.open(out).checkpoint
    go_on(capture, out)
    assert_same_avatar(out, trained)


@pytest.mark.slow
def test_a_run_interrupted_after_bad_steps_remembers_them(
    capture: Path, begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spoil(monkeypatch, not_finite, range(2, 4))
    whole, out = branch_off(begun, tmp_path / "whole"), branch_off(begun, tmp_path / "run")
    go_on(capture, whole)

    def interrupting(result: StepResult) -> StepResult:
        signal.raise_signal(signal.SIGINT)
        return not_finite(result)

    with monkeypatch.context() as patched:
        spoil(patched, interrupting, range(3, 4))
        with pytest.raises(KeyboardInterrupt):
            go_on(capture, out)
    stopped = Checkpoint.read(Run.open(out).checkpoint)
    assert (stopped.step, stopped.record["skipped"], stopped.record["in_a_row"]) == (4, 2, 2)
    go_on(capture, out)
    assert_same_avatar(out, whole)
    assert Checkpoint.read(Run.open(out).checkpoint).record == Checkpoint.read(Run.open(whole).checkpoint).record


@pytest.mark.slow
def test_a_damaged_image_is_named_once_and_a_resumed_run_agrees(
    begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_synthetic_capture(tmp_path / "capture", frames=6, views=3, size=32, static_views=4)
    whole, out = (branch_off(begun, tmp_path / name, with_training(iterations=14)) for name in ("whole", "run"))
    for run in (whole, out):
        description = (run / "run.json").read_text().replace(str(Run.open(run).capture), str(path.resolve()))
        (run / "run.json").write_text(description)
    data = Capture.open(path)
    image = data.layout.find_image(data.layout.frame_images(data.segments[0].start + 2), "image", "01")
    assert image is not None
    image.write_bytes(image.read_bytes()[:100])
    said = go_on(path, whole)
    assert said.count(image.name) == 1
    assert "damaged" in said

    with monkeypatch.context() as patched:
        spoil(patched, interrupted, range(8, 9))
        with pytest.raises(KeyboardInterrupt):
            go_on(path, out)
    go_on(path, out)
    assert_same_avatar(out, whole)


def interrupted(result: StepResult) -> StepResult:
    signal.raise_signal(signal.SIGINT)
    return result


def full_disk(*_arguments: object, **_named: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_checkpoint_that_cannot_be_written_stops_the_run_and_the_one_before_is_kept(
    capture: Path, begun: Path, trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = branch_off(begun, tmp_path / "run")
    with monkeypatch.context() as patched:
        original = checkpoints.atomic_file
        written: list[Path] = []

        def once(path: Path) -> object:
            written.append(path)
            return atomic_file(path) if len(written) == 1 else full_disk()

        patched.setattr(checkpoints, "atomic_file", once)
        with pytest.raises(DynhairError, match=r"step 10 cannot be written .*No space.* that of step 5 is whole"):
            go_on(capture, out)
    assert checkpoints.atomic_file is original
    go_on(capture, out)
    assert_same_avatar(out, trained)


def test_an_avatar_that_cannot_be_written_is_not_lost(
    capture: Path, begun: Path, trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = branch_off(begun, tmp_path / "run")
    with monkeypatch.context() as patched:
        patched.setattr("dynhair.avatar.model_folder.atomic_folder", full_disk)
        with pytest.raises(DynhairError, match="avatar cannot be written"):
            go_on(capture, out)
    go_on(capture, out)
    assert_same_avatar(out, trained)


def test_a_full_disk_ends_previews_and_log_but_not_training(
    capture: Path, begun: Path, trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(joint_training, "write_preview", full_disk)
    monkeypatch.setattr("torch.utils.tensorboard.writer.SummaryWriter.add_scalar", full_disk)
    out = branch_off(begun, tmp_path / "run")
    said = go_on(capture, out)
    assert_same_avatar(out, trained)
    assert said.count("the log ends here") == 1
    assert "preview of step 6 cannot be written" in said


def test_a_lack_of_memory_names_what_to_lower(
    capture: Path, begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def greedy(result: StepResult) -> StepResult:
        return result._replace(loss=torch.empty(1 << 55))

    spoil(monkeypatch, greedy, range(7, 8))
    with pytest.raises(DynhairError, match="does not suffice for the joint training") as caught:
        go_on(capture, branch_off(begun, tmp_path / "run"))
    assert "training.views (2), training.image_size (32)" in (caught.value.mend or "")
    assert "hair.strands (60)" in (caught.value.mend or "")


def test_rigid_hair_trains(capture: Path, begun: Path, tmp_path: Path) -> None:
    still = HairConfig(strands=60, points=10, deformer=CONFIG.hair.deformer, dynamic=False)
    config = with_training(iterations=4)
    out = branch_off(begun, tmp_path / "run", type(config)(**{**vars(config), "hair": still}))
    go_on(capture, out)
    assert (out / "avatar").exists()
