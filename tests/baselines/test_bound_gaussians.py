"""Gaussians bound to triangles: they move with the mesh exactly, and are kept near it."""

from __future__ import annotations

import math

import pytest
import torch
from bound_heads import (
    EXPRESSIONS,
    FRAMES,
    any_gaussians,
    bound_gaussians,
    camera,
    driven_tetrahedron,
    head_track,
    resting,
)
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from dynhair.avatar import head_pose
from dynhair.baselines.ga import COLOUR_WEIGHT, BoundGaussians, beyond
from dynhair.config import LossWeights, TrainingConfig
from dynhair.motion import so3_exp
from dynhair.render.reference import quaternion_matrix

angle = st.floats(-4, 4)
vectors = st.tuples(angle, angle, angle)


def assert_close(found: torch.Tensor, expected: torch.Tensor) -> None:
    torch.testing.assert_close(found, expected, atol=1e-6, rtol=1e-5)


def axes(quats: torch.Tensor) -> torch.Tensor:
    return quaternion_matrix(quats)


def test_in_the_rest_shape_they_are_what_they_began_as() -> None:
    torch.manual_seed(0)
    start, mesh = any_gaussians(30), driven_tetrahedron()
    head = BoundGaussians(mesh, torch.randint(4, (30,)), start, torch.zeros(3)).double()
    posed = head.bound(mesh.rest)
    assert_close(posed.means, start.means.double())
    assert_close(posed.scales, start.scales.double())
    assert_close(posed.opacities, start.opacities.double())
    assert_close(axes(posed.quats), axes(start.quats.double()))
    colours = head.colours(posed, [camera().to(dtype=torch.float64)])
    assert_close(colours[0], start.features.double())


@given(vectors, vectors, st.floats(0.2, 5))
def test_they_follow_every_motion_of_the_mesh_exactly(
    turn: tuple[float, ...], move: tuple[float, ...], grow: float
) -> None:
    head = bound_gaussians().double()
    rotation = so3_exp(torch.tensor(turn, dtype=torch.float64))
    offset = torch.tensor(move, dtype=torch.float64)
    before = head.bound(head.mesh.rest)
    after = head.bound(grow * head.mesh.rest @ rotation.T + offset)
    torch.testing.assert_close(after.means, grow * before.means @ rotation.T + offset)
    torch.testing.assert_close(after.scales, grow * before.scales)
    torch.testing.assert_close(axes(after.quats), rotation @ axes(before.quats))
    assert torch.equal(after.opacities, before.opacities)


def test_a_turned_head_carries_them_as_a_rigid_body() -> None:
    head, track = bound_gaussians(), head_track()
    track.expressions[:] = 0  # the mesh is bent by nothing
    rest, posed = head.posed(resting()), head.pose(track, FRAMES - 1)
    pose = head_pose(track, FRAMES - 1)
    expected = (rest.means - resting().translation) @ pose.rotation.T + pose.translation
    torch.testing.assert_close(posed.means, expected, atol=1e-6, rtol=1e-5)
    assert posed.strands is None


def test_the_expression_moves_those_of_the_triangles_that_it_moves() -> None:
    head = bound_gaussians()
    smiling = torch.zeros(EXPRESSIONS)
    smiling[0] = 1
    rest = resting()
    moved = head.posed(type(rest)(rest.rotation, rest.translation, rest.rotation_vector, smiling))
    distance = (moved.means - head.posed(rest).means).norm(dim=1)
    touched = (head.mesh.faces == 3).any(1)[head.triangle]
    assert (distance[~touched] == 0).all()
    assert (distance[touched] > 1e-3).all()


def test_images_have_no_hair_and_every_parameter_gets_a_gradient() -> None:
    head = bound_gaussians(basis=None)
    images = head.draw(head.pose(head_track(), 1), [camera(), camera()])
    assert images.hair is None
    assert images.rgb.shape == (2, 24, 24, 3)
    assert torch.equal(images.body, images.alpha)
    (images.rgb - 0.5).square().mean().backward()
    for name in ("means", "quats", "log_scales", "opacity_logits", "base_harmonic", "higher_harmonics"):
        gradient = getattr(head, name).grad
        assert gradient is not None
        assert gradient.isfinite().all()
        assert gradient.abs().max() > 0, name
    assert head.mesh.modes.offsets.grad is None


def test_regularizers_are_the_published_lengths_beyond_their_thresholds() -> None:
    values = torch.tensor([[0.2, -0.5, 0.9], [3.0, 0.0, -4.0]], dtype=torch.float64, requires_grad=True)
    loss = beyond(values, 1.0)
    expected = (math.sqrt(3) + math.sqrt(9 + 1 + 16)) / 2 - math.sqrt(3)
    assert loss.item() == pytest.approx(expected)
    loss.backward()
    assert values.grad is not None
    assert (values.grad[0] == 0).all()
    assert values.grad[1].sign().tolist() == [1, 0, -1]


def test_regularizers_weigh_as_much_beside_colours_as_published() -> None:
    head = bound_gaussians()
    nn.init.constant_(head.means, 2.0)
    nn.init.constant_(head.log_scales, math.log(0.5))
    terms = head.regularizers(TrainingConfig(weights=LossWeights(rgb=2 * COLOUR_WEIGHT)))
    assert terms["position"][0] == pytest.approx(2 * 0.01)
    assert terms["scale"][0] == pytest.approx(2 * 1.0)
    assert terms["position"][1].item() == pytest.approx(math.sqrt(12) - math.sqrt(3), rel=1e-5)
    assert terms["scale"][1].item() == pytest.approx(0.0, abs=1e-6)
