"""The harmonics against SciPy's, and their use as colours."""

from __future__ import annotations

import numpy as np
import torch
from scipy.special import sph_harm_y

from dynhair.avatar.spherical_harmonics import constant_coefficient, harmonics_basis, harmonics_colour


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
    np.testing.assert_allclose(harmonics_basis(d).numpy(), np.stack(expected, -1), atol=1e-12)


def test_constant_coefficient_shows_its_colour_from_everywhere() -> None:
    d = directions(10)
    coefficients = torch.zeros(10, 16, 3, dtype=torch.float64)
    colour = torch.tensor([0.1, 0.5, 0.9], dtype=torch.float64)
    coefficients[:, 0] = constant_coefficient(colour)
    torch.testing.assert_close(harmonics_colour(coefficients, d), colour.expand(10, 3))


def test_no_channel_is_negative() -> None:
    coefficients = torch.zeros(10, 16, 3, dtype=torch.float64)
    coefficients[:, 0] = -10
    assert harmonics_colour(coefficients, directions(10)).min() == 0
