"""Strand Gaussians against a float64 reading of the paper, at every direction."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.strands import root_taper, strand_gaussians

WIDTH = 8e-4


def axes(quats: torch.Tensor) -> np.ndarray:
    """Where rotations (wxyz) take the x axis, by SciPy."""
    return Rotation.from_quat(quats.detach().numpy()[:, [1, 2, 3, 0]]).apply([1.0, 0.0, 0.0])


def segment(direction: list[float], length: float = 0.005) -> torch.Tensor:
    end = torch.tensor(direction, dtype=torch.float64)
    return torch.stack([torch.zeros(3, dtype=torch.float64), length * end / end.norm()])[None]


def random_strands(count: int = 5, points: int = 8, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return (0.004 * torch.randn(count, points, 3, generator=generator, dtype=torch.float64)).cumsum(1).to(dtype)


def test_gaussians_lie_on_their_segments() -> None:
    strands = random_strands()
    gaussians = strand_gaussians(strands, WIDTH)
    index = 0
    for strand in strands.numpy():
        for a, b in itertools.pairwise(strand):
            length = np.linalg.norm(b - a)
            np.testing.assert_allclose(gaussians.means[index], (a + b) / 2, atol=1e-12)
            np.testing.assert_allclose(gaussians.scales[index], [length / 2, WIDTH / 2, WIDTH / 2], rtol=1e-6)
            np.testing.assert_allclose(gaussians.directions[index], (b - a) / length, atol=1e-6)
            index += 1
    assert index == len(gaussians.means)
    along = np.abs((axes(gaussians.quats) * gaussians.directions.numpy()).sum(axis=1))
    np.testing.assert_allclose(along, 1, atol=1e-6)
    torch.testing.assert_close(gaussians.quats.norm(dim=1), torch.ones(index, dtype=torch.float64), rtol=0, atol=1e-6)


unit = st.floats(-1, 1).map(lambda x: 0.0 if abs(x) < 1e-3 else x)


@given(st.tuples(unit, unit, unit).filter(any))
def test_the_x_axis_turns_onto_the_segment_or_its_reverse(direction: tuple[float, float, float]) -> None:
    gaussians = strand_gaussians(segment(list(direction)), WIDTH)
    turned, along = axes(gaussians.quats)[0], gaussians.directions[0].numpy()
    assert abs(turned @ along) == pytest.approx(1, abs=1e-6)
    assert turned[0] >= -1e-12


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_values_and_gradients_along_the_axes(axis: int, sign: float, dtype: torch.dtype) -> None:
    direction = torch.zeros(3, dtype=torch.float64)
    direction[axis] = sign
    strand = segment(direction.tolist()).to(dtype).requires_grad_()
    gaussians = strand_gaussians(strand, WIDTH)
    np.testing.assert_allclose(np.abs(axes(gaussians.quats)[0, axis]), 1, atol=1e-6)
    (gaussians.means.sum() + gaussians.quats.sum() + gaussians.scales.sum() + gaussians.directions.sum()).backward()
    assert strand.grad is not None
    assert strand.grad.isfinite().all()


def test_the_covariance_is_continuous_where_the_direction_is_turned_round() -> None:
    """The rotation jumps where x changes its sign; what is drawn does not."""

    def covariance(strand: torch.Tensor) -> np.ndarray:
        gaussians = strand_gaussians(strand, WIDTH)
        matrix = Rotation.from_quat(gaussians.quats.numpy()[0, [1, 2, 3, 0]]).as_matrix()
        return matrix @ np.diag(gaussians.scales[0].numpy() ** 2) @ matrix.T

    np.testing.assert_allclose(covariance(segment([1e-9, 1, 2])), covariance(segment([-1e-9, 1, 2])), atol=1e-12)


def test_segments_without_length_have_finite_values_and_gradients() -> None:
    strands = torch.zeros(1, 3, 3, requires_grad=True)
    gaussians = strand_gaussians(strands, WIDTH)
    parts = (gaussians.means, gaussians.quats, gaussians.scales, gaussians.directions)
    assert all(part.isfinite().all() for part in parts)
    assert (gaussians.quats.norm(dim=1) > 0.5).all()
    sum(part.sum() for part in parts).backward()  # pyright: ignore[reportAttributeAccessIssue]
    assert strands.grad is not None
    assert strands.grad.isfinite().all()


def test_gradients_agree_with_finite_differences() -> None:
    strands = random_strands(count=2, points=4).requires_grad_()

    def flat(points: torch.Tensor) -> torch.Tensor:
        gaussians = strand_gaussians(points, WIDTH, root_taper(3))
        return torch.cat([gaussians.means, gaussians.quats, gaussians.scales, gaussians.directions], dim=1)

    assert torch.autograd.gradcheck(flat, strands, eps=1e-8, atol=1e-4)


def test_the_taper_narrows_segments_near_the_root_only() -> None:
    taper = root_taper(10, length=4, root=0.2)
    torch.testing.assert_close(taper, torch.tensor([0.3, 0.5, 0.7, 0.9, 1, 1, 1, 1, 1, 1]))
    strands = random_strands(points=11)
    plain, tapered = strand_gaussians(strands, WIDTH), strand_gaussians(strands, WIDTH, taper)
    torch.testing.assert_close(tapered.scales[:, 0], plain.scales[:, 0])
    across = tapered.scales.view(5, 10, 3)[..., 1:] / plain.scales.view(5, 10, 3)[..., 1:]
    torch.testing.assert_close(across, taper.double()[None, :, None].expand(5, 10, 2))


def test_float32_is_accurate() -> None:
    strands = random_strands()
    exact, found = strand_gaussians(strands, WIDTH), strand_gaussians(strands.float(), WIDTH)
    for name in ("means", "quats", "scales", "directions"):
        torch.testing.assert_close(getattr(found, name).double(), getattr(exact, name), rtol=1e-4, atol=1e-5)
