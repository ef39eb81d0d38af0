"""The harmonics against SciPy's, and their use as colours."""

from __future__ import annotations

import numpy as np
import torch
from scipy.special import sph_harm_y

from dynhair.avatar.spherical_harmonics import constant_coefficient, harmonics_basis, harmonics_colours


def directions(count: int = 200) -> torch.Tensor:
    x = torch.randn(count, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return torch.nn.functional.normalize(x, dim=-1)


def test_basis_is_scipys_real_harmonics() -> None:
    d = directions()
    x, y, z = d.numpy().T
    polar, azimuth = np.arccos(z), np.arctan2(y, x)
    expected = []
    for degree in range(4):
        for m in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(m), polar, azimuth)
            factor = np.sqrt(2) if m else 1.0
            expected.append(factor * (value.imag if m < 0 else value.real))
    np.testing.assert_allclose(harmonics_basis(d).numpy(), np.stack(expected), atol=1e-12)


def coefficients(count: int, seed: int = 1) -> torch.Tensor:
    return torch.randn(16, 3, count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64) * 0.2


def test_colours_are_the_harmonic_sums_and_differentiable() -> None:
    d = torch.stack([directions(6), -directions(6)])
    c = coefficients(6)
    base, higher = c[:1].clone().requires_grad_(), c[1:].clone().requires_grad_()
    actual = harmonics_colours(base, higher, d)
    expected = (0.5 + torch.einsum("kvn,kcn->vnc", harmonics_basis(d), c)).clamp_min(0)
    torch.testing.assert_close(actual, expected)
    assert torch.autograd.gradcheck(lambda b, h: harmonics_colours(b, h, d), (base, higher))


def test_constant_coefficient_shows_its_colour_from_everywhere() -> None:
    colour = torch.tensor([0.1, 0.5, 0.9], dtype=torch.float64)
    base = constant_coefficient(colour)[None, :, None].repeat(1, 1, 10)
    colours = harmonics_colours(base, torch.zeros(15, 3, 10, dtype=torch.float64), directions(10)[None])
    torch.testing.assert_close(colours[0], colour.expand(10, 3))


def test_no_channel_is_negative() -> None:
    base = torch.full((1, 3, 10), -10.0, dtype=torch.float64)
    colours = harmonics_colours(base, torch.zeros(15, 3, 10, dtype=torch.float64), directions(10)[None])
    assert colours.min() == 0
