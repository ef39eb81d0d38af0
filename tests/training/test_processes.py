"""Several processes take the steps of one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from quick_runs import assert_same_avatar, begin, branch_off, go_on, with_training
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch import Tensor

from dynhair.avatar import Avatar, Hair
from dynhair.capture import Capture
from dynhair.config import Config, DeformerConfig, HeadConfig, LossWeights, TrainingConfig
from dynhair.errors import DynhairError
from dynhair.losses import PerceptualDistance, orientation_weight
from dynhair.motion import SignalNormalizer
from dynhair.threads import thread_count
from dynhair.training.batches import Batches
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.frames import training_segments
from dynhair.training.head_start import start_head
from dynhair.training.objective import JointObjective, StepResult
from dynhair.training.processes import Processes, _take_share_of_threads
from dynhair.training.run import Run
from synthetic import write_synthetic_capture

ITERATIONS = 40
ROUNDING = 1e-4  # of parameters after that many steps: Adam divides small gradients by themselves


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "capture"
    return write_synthetic_capture(path, frames=6, views=4, size=48, static_views=4)


def test_a_process_alone_has_everything() -> None:
    processes = Processes()
    assert (processes.count, processes.rank, processes.first) == (1, 0, True)
    assert list(range(5))[processes.share(5)] == list(range(5))
    assert processes.balance(torch.tensor(3.0)) == 1
    value = torch.arange(3.0)
    processes.average([value])
    processes.wait()
    assert torch.equal(value, torch.arange(3.0))


def test_views_are_shared_out_evenly_or_not_at_all() -> None:
    processes = Processes()
    processes.count = 3
    seen = []
    for processes.rank in range(3):
        seen += list(range(6))[processes.share(6)]
    assert seen == list(range(6))
    with pytest.raises(DynhairError, match="4 views a step cannot be shared out among 3 processes") as caught:
        processes.share(4)
    assert "training.views" in (caught.value.mend or "")


def test_processes_need_a_gpu_each_where_there_are_gpus(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("TORCHELASTIC_RUN_ID", "1"), ("WORLD_SIZE", "4"), ("LOCAL_WORLD_SIZE", "4")):
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 3)
    with pytest.raises(DynhairError, match="4 processes on 3 GPUs"):
        Processes()


@pytest.mark.parametrize(("given", "threads"), [("1", 3), ("5", 2)])
def test_a_process_takes_its_share_of_the_cores(given: str, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    before = torch.get_num_threads()
    monkeypatch.setenv("OMP_NUM_THREADS", given)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(7)), raising=False)
    torch.set_num_threads(2)
    try:
        _take_share_of_threads(2)
        assert thread_count() == threads  # what the user asked for is left
    finally:
        torch.set_num_threads(before)


def test_processes_agree_on_tensors_that_lie_in_any_order(monkeypatch: pytest.MonkeyPatch) -> None:
    theirs = torch.arange(12.0).view(3, 4)

    def broadcast(tensor: Tensor, src: int) -> None:
        assert src == 0
        assert tensor.is_contiguous()  # NCCL refuses others
        tensor.copy_(theirs.view(tensor.shape))

    monkeypatch.setattr(torch.distributed, "broadcast", broadcast)
    module = torch.nn.Module()
    module.strewn = torch.nn.Parameter(torch.zeros(4, 3).T)
    module.register_buffer("plain", torch.zeros(3, 4))
    processes = Processes()
    processes.count = 2
    processes.agree(module)
    assert torch.equal(module.strewn, theirs)
    assert torch.equal(module.get_buffer("plain"), theirs)


def test_the_steps_of_processes_average_to_the_step_of_one(capture: Path) -> None:
    data = Capture.open(capture)
    segments = training_segments(data)
    settings = TrainingConfig(
        iterations=8,
        views=4,
        image_size=48,
        perceptual_every=1,
        perceptual_crop=24,
        weights=LossWeights(perceptual=0.5, perceptual_raised=0.5),
    )
    head = HeadConfig(gaussians=300, features=4, deformation_width=16, appearance_width=8)
    torch.manual_seed(0)
    started = start_head(data, head, 0)
    strands = started.head.means.detach()[-40:, None] + torch.linspace(0, 0.08, 6)[None, :, None]
    hair = Hair(strands, 0.006, torch.full((3,), 0.3), DeformerConfig(hidden=8, width=16, history=2))
    avatar = Avatar(hair, started.head, SignalNormalizer(), torch.zeros(3))
    perceptual = PerceptualDistance("vgg16")

    weights: list[Tensor] = []

    def balance(weight: Tensor) -> Tensor:
        return weight / (sum(weights, torch.tensor(0.0)) / len(weights)) if weights else torch.ones_like(weight)

    objective = JointObjective(avatar, data, segments, started.points, settings, perceptual, balance)

    def source(share: slice) -> Batches:
        return Batches(data, segments, views=4, image_size=48, seed=0, share=lambda _: share)

    def taken(share: slice, step: int) -> tuple[StepResult, list[Tensor]]:
        objective.zero_grad()
        result = objective(source(share).batch(step), step)
        result.loss.backward()
        return result, [torch.zeros_like(p) if p.grad is None else p.grad.clone() for p in objective.parameters()]

    halves = [slice(0, 2), slice(2, 4)]
    for step in (2, 5):
        weights.clear()
        whole, gradient = taken(slice(0, 4), step)
        assert whole.terms["orientation"] > 0
        assert whole.terms["perceptual"] > 0
        for half in halves:
            batch = source(half).batch(step)
            images = objective(batch, step).images
            weights.append(orientation_weight(images.hair, batch.hair, batch.coherence).sum())
        assert (weights[0] / weights[1] - 1).abs() > 0.01  # a mean of means would be wrong
        parts = [taken(half, step) for half in halves]
        for name, term in whole.terms.items():
            mean = (parts[0][0].terms[name] + parts[1][0].terms[name]) / 2
            torch.testing.assert_close(mean, term, rtol=1e-4, atol=1e-9, msg=name)
        for expected, one, other in zip(gradient, parts[0][1], parts[1][1], strict=True):
            scale = float(expected.abs().max()) if expected.numel() else 0.0
            torch.testing.assert_close((one + other) / 2, expected, rtol=1e-3, atol=1e-4 * scale + 1e-12)


@pytest.fixture(scope="module")
def begun(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return begin(capture, tmp_path_factory.mktemp("runs") / "begun")


@pytest.fixture(scope="module")
def alone(capture: Path, begun: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = branch_off(begun, tmp_path_factory.mktemp("runs") / "alone", settings())
    go_on(capture, out)
    return out


def settings() -> Config:
    return with_training(iterations=ITERATIONS, views=4, checkpoint_every=10)


def command(capture: Path, run: Path, processes: int) -> list[str]:
    torchrun = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", str(processes)]
    return [*torchrun, "-m", "dynhair", "train", str(capture), "--out", str(run), "--resume"]


def launch(capture: Path, run: Path, processes: int = 2) -> str:
    done = subprocess.run(command(capture, run, processes), capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def losses(run: Path) -> dict[str, list[float]]:
    events = EventAccumulator(str(run / "log"))
    events.Reload()
    names = [name for name in events.Tags()["scalars"] if name.startswith("terms/") or name == "loss"]
    return {name: [event.value for event in events.Scalars(name)] for name in names}


@pytest.mark.slow
def test_two_processes_train_like_one(capture: Path, begun: Path, alone: Path, tmp_path: Path) -> None:
    out = branch_off(begun, tmp_path / "run", settings())
    said = launch(capture, out)
    assert said.count(f"{ITERATIONS} of {ITERATIONS}") == 1  # only the first process shows progress
    expected, found = losses(alone), losses(out)
    assert expected.keys() == found.keys()
    for name, values in expected.items():
        assert found[name] == pytest.approx(values, rel=1e-4), name
    assert_same_avatar(out, alone, ROUNDING)
    assert not list(out.glob(".*"))


@pytest.mark.slow
@pytest.mark.parametrize("together_first", [True, False])
def test_a_run_goes_on_with_another_number_of_processes(
    together_first: bool, capture: Path, begun: Path, alone: Path, tmp_path: Path
) -> None:
    out = branch_off(begun, tmp_path / "run", settings())
    checkpoint = Run.open(out).checkpoint
    interrupt_after_a_checkpoint(capture, out, 2 if together_first else 1)
    assert 10 <= Checkpoint.read(checkpoint).step < ITERATIONS
    if together_first:
        go_on(capture, out)
    else:
        launch(capture, out)
    assert_same_avatar(out, alone, ROUNDING)


def interrupt_after_a_checkpoint(capture: Path, run: Path, processes: int) -> None:
    """Ctrl-C, as a terminal gives it to torchrun or to a process alone."""
    whole = command(capture, run, processes)
    started = whole if processes > 1 else [sys.executable, *whole[whole.index("dynhair") - 1 :]]
    process = subprocess.Popen(started, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 200
    while not Run.open(run).checkpoint.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=100)
    assert process.returncode != 0, said


@pytest.mark.slow
def test_views_that_cannot_be_shared_are_refused(capture: Path, begun: Path, tmp_path: Path) -> None:
    out = branch_off(begun, tmp_path / "run", with_training(views=3))
    done = subprocess.run(command(capture, out, 2), capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode != 0
    assert "3 views a step cannot be shared out among 2 processes" in done.stderr
