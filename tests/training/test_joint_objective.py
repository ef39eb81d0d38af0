"""Which terms the joint objective adds up, when, and with which weights."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from dynhair.avatar import Avatar, Hair
from dynhair.capture import Capture
from dynhair.config import DeformerConfig, HeadConfig, LossWeights, TrainingConfig
from dynhair.losses import PerceptualDistance
from dynhair.motion import SignalNormalizer
from dynhair.training.batches import Batches
from dynhair.training.frames import training_segments
from dynhair.training.head_start import start_head
from dynhair.training.objective import SETTLING_EVERY, JointObjective
from synthetic import write_synthetic_capture

SETTINGS = TrainingConfig(iterations=8, image_size=48, penetration_points=10_000, perceptual_crop=32)
DEFORMER = DeformerConfig(hidden=8, width=16, history=2, knots=0)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    path = write_synthetic_capture(tmp_path_factory.mktemp("data") / "capture", frames=3, views=2, size=48)
    return Capture.open(path)


def make_objective(
    capture: Capture,
    settings: TrainingConfig,
    perceptual: PerceptualDistance | None = None,
    *,
    along: float = 0.05,
    deformer: DeformerConfig = DEFORMER,
) -> JointObjective:
    torch.manual_seed(0)
    head = HeadConfig(gaussians=600, mouth_gaussians=20, features=4, deformation_width=8, appearance_width=8)
    started = start_head(capture, head, 0)
    roots = started.head.means.detach()[-10:, None]
    strands = roots + torch.linspace(0, along, 6)[None, :, None] * torch.tensor([0.0, -1.0, 0.0])
    hair = Hair(strands, 0.002, torch.full((3,), 0.3), deformer)
    avatar = Avatar(hair, started.head, SignalNormalizer(deformer), torch.zeros(3))
    return JointObjective(avatar, capture, training_segments(capture), started.points, settings, perceptual)


def batches(capture: Capture) -> Batches:
    return Batches(capture, training_segments(capture), views=2, image_size=48, seed=0)


def random_network() -> PerceptualDistance:
    distance = PerceptualDistance("vgg16")
    generator = torch.Generator().manual_seed(0)
    for parameter in distance.parameters():
        parameter.copy_(0.05 * torch.rand(parameter.shape, generator=generator))
    return distance.eval()


def test_the_perceptual_term_comes_every_so_many_steps_and_is_raised_late(capture: Capture) -> None:
    weights = LossWeights(perceptual=0.5, perceptual_raised=2.0)
    settings = replace(SETTINGS, weights=weights, perceptual_every=2, perceptual_raised_from=0.75)
    objective, plain = (make_objective(capture, settings, network) for network in (random_network(), None))
    batch = batches(capture).batch(0)
    for step, weight in ((0, 0.5), (1, None), (4, 0.5), (6, 2.0), (7, None)):
        result, without = objective(batch, step), plain(batch, step)
        assert ("perceptual" in result.terms) == (weight is not None)
        added = 0.0 if weight is None else 2 * weight * float(result.terms["perceptual"])
        assert float((result.loss - without.loss).detach()) == pytest.approx(added, abs=1e-5)
    assert not any("perceptual" in name for name, _ in objective.named_parameters())
    assert not any("stages" in name for name in objective.state_dict())


def test_the_network_takes_no_gradient(capture: Capture) -> None:
    network = random_network()
    settings = replace(SETTINGS, weights=LossWeights(perceptual=1.0, perceptual_raised=1.0), perceptual_every=1)
    make_objective(capture, settings, network)(batches(capture).batch(0), 0).loss.backward()
    assert all(parameter.grad is None for parameter in network.parameters())


def test_terms_without_weight_are_left_out_where_they_cost_something(capture: Capture) -> None:
    weights = LossWeights(colour_gradient=0.0, colour_spatial=0.0, colour_consistency=0.0)
    batch = batches(capture).batch(0)
    without = make_objective(capture, replace(SETTINGS, weights=weights))(batch, 0).terms
    assert not {"colour_gradient", "colour_spatial", "colour_consistency", "reach"} & set(without)
    settings = replace(SETTINGS, weights=replace(LossWeights(), reach=1.0))
    full = make_objective(capture, settings)(batch, 0).terms
    assert {"colour_gradient", "colour_spatial", "colour_consistency", "reach"} <= set(full)


def test_dynamics_are_asked_to_settle_every_so_many_steps(capture: Capture) -> None:
    strands = DeformerConfig("strands", history=10, guides=4, turn=True)
    batch = batches(capture).batch(0)
    settings = replace(SETTINGS, weights=replace(LossWeights(), settling=3.0))
    asked, without = (make_objective(capture, each, deformer=strands) for each in (settings, SETTINGS))
    for step in (0, 1, SETTLING_EVERY):
        result, plain = asked(batch, step), without(batch, step)
        assert ("settling" in result.terms) == (step % SETTLING_EVERY == 0)
        assert "settling" not in plain.terms
        added = SETTLING_EVERY * 3.0 * float(result.terms.get("settling", 0.0))
        assert float((result.loss - plain.loss).detach()) == pytest.approx(added, abs=1e-5)
    # others have nothing that could come to rest elsewhere
    assert "settling" not in make_objective(capture, settings)(batch, 0).terms


def test_missing_hair_moves_the_deformer(capture: Capture) -> None:
    nothing = LossWeights(**dict.fromkeys(LossWeights.__dataclass_fields__, 0.0))
    settings = replace(SETTINGS, weights=replace(nothing, reach=1.0))
    objective = make_objective(capture, settings)
    result = objective(batches(capture).batch(0), 0)
    assert float(result.terms["reach"]) > 0
    result.loss.backward()
    gradient = objective.avatar.hair.strands.grad
    assert gradient is not None
    assert float(gradient.abs().sum()) > 0


def test_a_step_is_the_same_however_often_it_is_computed(capture: Capture) -> None:
    settings = replace(SETTINGS, weights=replace(LossWeights(), reach=10.0))
    batch = batches(capture).batch(0)
    first, again = (make_objective(capture, settings)(batch, 3) for _ in range(2))
    assert {name: float(term) for name, term in first.terms.items()} == {
        name: float(term) for name, term in again.terms.items()
    }
    other = make_objective(capture, settings)(batch, 4)
    assert float(first.terms["reach"]) != float(other.terms["reach"])


def test_a_handful_of_points_still_sees_a_pixel(capture: Capture) -> None:
    settings = replace(SETTINGS, weights=replace(LossWeights(), reach=1.0), reach_points=3)
    assert float(make_objective(capture, settings)(batches(capture).batch(0), 0).terms["reach"]) > 0
