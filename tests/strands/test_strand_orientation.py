"""Projected orientations against finite differences of the projection, and the coding of undirected angles."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.camera import Camera
from dynhair.motion import so3_exp
from dynhair.strands import decode_orientation, encode_orientation, projected_orientation


def camera(aspect: float = 1.0) -> Camera:
    rotation = so3_exp(torch.tensor([2.9, 0.2, -0.3], dtype=torch.float64))
    translation = torch.tensor([[0.02], [-0.01], [0.9]], dtype=torch.float64)
    intrinsics = torch.tensor([[800.0, 0, 120], [0, 800 * aspect, 130], [0, 0, 1]], dtype=torch.float64)
    return Camera(torch.cat([rotation, translation], dim=1), intrinsics, 256, 256)


def rays(count: int = 40, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    means = 0.2 * torch.randn(count, 3, generator=generator, dtype=torch.float64)
    directions = torch.randn(count, 3, generator=generator, dtype=torch.float64)
    return means, torch.nn.functional.normalize(directions, dim=-1)


@pytest.mark.parametrize("aspect", [1.0, 1.4])
def test_orientation_is_that_of_the_projected_segment(aspect: float) -> None:
    view, (means, directions) = camera(aspect), rays()
    step = 1e-6
    ahead, behind = view.project(means + step * directions)[0], view.project(means - step * directions)[0]
    for found, (dx, dy) in zip(projected_orientation(means, directions, view), (ahead - behind).tolist(), strict=True):
        angle = math.atan2(dy, dx)
        expected = torch.tensor([math.cos(2 * angle), math.sin(2 * angle)], dtype=torch.float64)
        torch.testing.assert_close(found, expected, rtol=0, atol=2e-4)


def test_perspective_is_taken_into_account() -> None:
    """Towards the side of the image, a line along the optical axis points away from the image's centre."""
    view = Camera(torch.eye(3, 4), torch.tensor([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]), 100, 100)
    found = projected_orientation(torch.tensor([[0.3, 0.3, 1.0]]), torch.tensor([[0.0, 0.0, 1.0]]), view)
    torch.testing.assert_close(decode_orientation(found), torch.tensor([0.25]))


def test_the_sign_of_a_direction_does_not_matter() -> None:
    means, directions = rays()
    torch.testing.assert_close(
        projected_orientation(means, directions, camera()), projected_orientation(means, -directions, camera())
    )


def test_directions_at_the_camera_fade_with_finite_gradients() -> None:
    view = camera()
    means = rays(5)[0].requires_grad_()
    directions = torch.nn.functional.normalize(means.detach() - view.centre, dim=-1).requires_grad_()
    found = projected_orientation(means, directions, view)
    assert found.norm(dim=1).max() < 1e-6
    found.sum().backward()
    for tensor in (means, directions):
        assert tensor.grad is not None
        assert tensor.grad.isfinite().all()


def test_gradients_agree_with_finite_differences() -> None:
    means, directions = rays(6)
    view = camera(1.2)
    inputs = (means.requires_grad_(), directions.requires_grad_())
    assert torch.autograd.gradcheck(lambda m, d: projected_orientation(m, d, view), inputs, atol=1e-4)


@given(st.floats(0, 1, exclude_max=True), st.floats(1e-3, 1e3))
def test_decoding_undoes_encoding_at_any_magnitude(angle: float, magnitude: float) -> None:
    orientation = torch.tensor([angle], dtype=torch.float64)
    found = decode_orientation(magnitude * encode_orientation(orientation))
    assert 0 <= found.item() < 1
    distance = abs(found.item() - angle)
    assert min(distance, 1 - distance) < 1e-9


def test_blending_across_the_wrap() -> None:
    """1 degree and 179 degrees average to 0, not to 90."""
    blended = encode_orientation(torch.tensor([1 / 180, 179 / 180])).mean(dim=0)
    angle = decode_orientation(blended).item()
    assert min(angle, 1 - angle) < 1e-6


def test_just_below_zero_decodes_into_the_half_open_interval() -> None:
    found = decode_orientation(torch.tensor([[1.0, -1e-9], [1.0, -0.0], [0.0, 0.0], [-1.0, -0.0], [-1.0, 0.0]]))
    assert ((found >= 0) & (found < 1)).all()
    torch.testing.assert_close(found, torch.tensor([0.0, 0.0, 0.0, 0.5, 0.5]))


@pytest.mark.parametrize("magnitude", [0.0, 1e-30, 1e-20, 1e-5])
def test_what_is_hardly_there_has_an_angle_and_no_gradient(magnitude: float) -> None:
    doubled = (magnitude * torch.tensor([[0.0, 1.0]])).requires_grad_()
    angle = decode_orientation(doubled)
    angle.sum().backward()
    assert angle.item() == (0.25 if magnitude else 0.0)
    assert doubled.grad is not None
    assert torch.equal(doubled.grad, torch.zeros(1, 2))


def test_decoding_gradients_agree_with_finite_differences() -> None:
    generator = torch.Generator().manual_seed(0)
    doubled = torch.randn(10, 2, generator=generator, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(decode_orientation, doubled)
