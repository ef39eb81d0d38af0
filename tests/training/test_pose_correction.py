"""Each training frame's pose has a correction of its own."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest
import torch

from dynhair.avatar import Avatar, Hair
from dynhair.capture import Capture
from dynhair.config import DeformerConfig, HeadConfig, LossWeights, TrainingConfig
from dynhair.motion import SignalNormalizer
from dynhair.training.batches import Batches
from dynhair.training.frames import training_segments
from dynhair.training.head_start import start_head
from dynhair.training.objective import JointObjective
from synthetic import write_synthetic_capture

SETTINGS = TrainingConfig(iterations=10, image_size=48, penetration_points=50)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    return Capture.open(
        write_synthetic_capture(tmp_path_factory.mktemp("data") / "capture", frames=3, views=2, size=48)
    )


def make_objective(capture: Capture, settings: TrainingConfig = SETTINGS) -> tuple[JointObjective, Batches]:
    torch.manual_seed(0)
    segments = training_segments(capture)
    head = HeadConfig(gaussians=600, mouth_gaussians=20, features=4, deformation_width=8, appearance_width=8)
    started = start_head(capture, head, 0)
    strands = started.head.means.detach()[-10:, None] + torch.linspace(0, 0.05, 6)[None, :, None]
    hair = Hair(strands, 0.002, torch.full((3,), 0.3), DeformerConfig(hidden=8, width=16, history=2))
    avatar = Avatar(hair, started.head, SignalNormalizer(), torch.zeros(3))
    batches = Batches(capture, segments, views=2, image_size=48, seed=0)
    return JointObjective(avatar, capture, segments, started.points, settings), batches


def test_a_step_corrects_the_pose_of_its_own_frame_alone(capture: Capture) -> None:
    objective, batches = make_objective(capture)
    segments = training_segments(capture)
    assert len(objective.pose_corrections) == sum(segment.count for segment in segments)
    batch = batches.batch(1)
    objective(batch, 0).loss.backward()
    place = sum(segment.count for segment in segments[: batch.segment]) + batch.index
    for number, correction in enumerate(objective.pose_corrections):
        if number != place:
            assert correction.grad is None
            continue
        assert correction.grad is not None
        assert correction.grad.isfinite().all()
        assert correction.grad.abs().sum() > 0


def test_a_wrong_pose_is_corrected(capture: Capture) -> None:
    nothing = LossWeights(*(0.0,) * len(fields(LossWeights)))
    surface_alone = replace(SETTINGS, weights=replace(nothing, tracking=100.0))
    objective, batches = make_objective(capture, surface_alone)
    batch = batches.batch(0)
    place = sum(segment.count for segment in training_segments(capture)[: batch.segment]) + batch.index
    correction = objective.pose_corrections[place]
    wrong = torch.tensor([0.0, 0.03, 0.0, 0.006, -0.004, 0.0])
    correction.data.copy_(wrong)
    optimizer = torch.optim.Adam([correction], lr=2e-3)
    for _ in range(30):
        optimizer.zero_grad()
        objective(batch, 0).loss.backward()
        optimizer.step()
    assert correction.detach()[3:].norm() < 0.3 * wrong[3:].norm()
    assert correction.detach()[:3].norm() < 0.3 * wrong[:3].norm()
