"""Strands of a texture at roots, against a slow reading of the rules, one root at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.strands import texel_uv, upsample


def texture(size: int, points: int = 6, seed: int = 0, spread: float = 1.0) -> torch.Tensor:
    """Strands around a common course, in normal form."""
    generator = torch.Generator().manual_seed(seed)
    common = torch.randn(points - 1, 3, generator=generator, dtype=torch.float64)
    own = torch.randn(size, size, points - 1, 3, generator=generator, dtype=torch.float64)
    return torch.nn.functional.pad((common + spread * own).cumsum(dim=2), (0, 0, 1, 0))


def disc(size: int) -> torch.Tensor:
    return ((2 * texel_uv(size) - 1).norm(dim=-1) < 0.8).view(size, size)


def uniform(count: int, seed: int = 1) -> torch.Tensor:
    return torch.rand(count, 2, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def similarity(a: np.ndarray, b: np.ndarray) -> float:
    one, two = np.diff(a, axis=0), np.diff(b, axis=0)
    return float(np.mean((one * two).sum(1) / np.linalg.norm(one, axis=1) / np.linalg.norm(two, axis=1)))


def interpolated(strands: np.ndarray, valid: np.ndarray, u: float, v: float) -> np.ndarray:
    """The rules for one root."""
    size = len(valid)
    x, y = (min(max(t * size - 0.5, 0), size - 1) for t in (u, v))
    around = {}
    for i in range(size):
        for j in range(size):
            weight = max(0, 1 - abs(j - x)) * max(0, 1 - abs(i - y))
            if weight > 0 and valid[i, j]:
                around[i, j] = weight
    if not around:
        i, j = min(zip(*np.nonzero(valid), strict=True), key=lambda t: math.hypot(t[1] - x, t[0] - y))
        return strands[i, j]
    total = sum(around.values())
    nearest = max(around, key=lambda t: around[t])
    result = strands[nearest]
    for texel, weight in around.items():
        c = max(similarity(strands[nearest], strands[texel]), 0)
        alpha = 1 - 1.63 * c**5 if c <= 0.9 else 0.4 - 0.4 * c
        result = result + (1 - alpha) * weight / total * (strands[texel] - strands[nearest])
    return result


@pytest.mark.parametrize("spread", [0.1, 0.3, 1.0, 5.0])
def test_agrees_with_the_rules_root_by_root(spread: float) -> None:
    strands, valid, uv = texture(9, spread=spread), disc(9), uniform(300)
    expected = np.stack([interpolated(strands.numpy(), valid.numpy(), u, v) for u, v in uv.tolist()])
    np.testing.assert_allclose(upsample(strands, valid, uv).numpy(), expected, atol=1e-12)


def test_invalid_texels_are_never_looked_at() -> None:
    strands, valid, uv = texture(9), disc(9), uniform(200)
    expected = upsample(strands, valid, uv)
    strands[~valid] = math.nan
    result = upsample(strands.requires_grad_(), valid, uv)
    assert torch.equal(result, expected)
    (gradient,) = torch.autograd.grad(result.square().sum(), strands)
    assert gradient.isfinite().all()
    assert (gradient[~valid] == 0).all()


def test_a_texels_own_centre_has_its_own_strand() -> None:
    strands = texture(7)
    result = upsample(strands, torch.ones(7, 7, dtype=torch.bool), texel_uv(7))
    torch.testing.assert_close(result, strands.flatten(0, 1))


@given(st.floats(-3, 3), st.floats(-3, 3), st.integers(0, 1000))
@settings(deadline=None, max_examples=25)
def test_strands_alike_are_interpolated_linearly(a: float, b: float, seed: int) -> None:
    """Parallel strands whose lengths are linear in uv keep alpha = 0, and bilinear interpolation is exact for them."""
    course = texture(1, seed=seed)[0, 0]
    uv, inner = texel_uv(8).view(8, 8, 2), 0.1 + 0.8 * uniform(40, seed)

    def length(places: torch.Tensor) -> torch.Tensor:
        return (10 + a * places[..., 0] + b * places[..., 1])[..., None, None]

    result = upsample(length(uv) * course, torch.ones(8, 8, dtype=torch.bool), inner)
    torch.testing.assert_close(result, length(inner) * course)


def test_strands_that_part_are_not_averaged() -> None:
    course = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    strands = torch.stack([course, -course]).expand(2, 2, 3, 3)
    across = torch.linspace(0, 1, 21)
    result = upsample(strands, torch.ones(2, 2, dtype=torch.bool), torch.stack([across, across * 0 + 0.5], dim=-1))
    assert (result[:, 2, 0].abs() == 2).all()


def test_gradients_are_exact() -> None:
    strands, valid = texture(4, points=4, spread=0.4).requires_grad_(), disc(4)
    valid[1, 1] = False
    uv = uniform(12)
    assert torch.autograd.gradcheck(lambda s: upsample(s, valid, uv), strands)


def test_strands_without_length_have_finite_gradients() -> None:
    strands = torch.zeros(4, 4, 5, 3, requires_grad=True)
    result = upsample(strands, torch.ones(4, 4, dtype=torch.bool), uniform(10).float())
    (gradient,) = torch.autograd.grad(result.sum(), strands)
    assert gradient.isfinite().all()


def test_one_texel_serves_the_whole_scalp() -> None:
    strands = texture(1)
    result = upsample(strands, torch.ones(1, 1, dtype=torch.bool), uniform(5))
    torch.testing.assert_close(result, strands[0].expand(5, -1, -1))


def test_a_texture_without_valid_texels_is_refused() -> None:
    with pytest.raises(DynhairError, match="without valid texels"):
        upsample(texture(3), torch.zeros(3, 3, dtype=torch.bool), uniform(2))
