"""What guides have, blended over strands."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.avatar.guides import NEAREST, SOFTNESS, GuideBlend
from dynhair.strands.spreading import farthest_points


def hair(strands: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    roots = 0.1 * torch.randn(strands, 1, 3, generator=generator)
    return roots + torch.linspace(0, 0.2, 5)[None, :, None] * torch.randn(strands, 1, 3, generator=generator)


@given(st.integers(1, 30), st.integers(1, 40), st.integers(0, 99))
def test_what_all_guides_have_all_strands_have(strands: int, guides: int, seed: int) -> None:
    blend = GuideBlend(hair(strands, seed), guides)
    assert blend.count == min(strands, guides)
    values = torch.tensor([[2.0, -1.0]]).expand(blend.count, -1)
    torch.testing.assert_close(blend(values), torch.tensor([[2.0, -1.0]]).expand(strands, -1))
    assert blend.weights.min() > 0


def test_weights_fall_off_with_the_distance_of_courses() -> None:
    strands = hair(40)
    blend, guides = GuideBlend(strands, 9), farthest_points(strands.mean(1), 9).tolist()
    values = torch.eye(9)
    found = blend(values).numpy()
    for strand, row in zip(strands.double().numpy(), found, strict=True):
        courses = strands[guides].double().numpy()
        squares = ((strand - courses) ** 2).sum(-1).mean(-1)
        expected = np.where(np.argsort(np.argsort(squares)) < NEAREST, 1 / (squares + SOFTNESS**2), 0)
        np.testing.assert_allclose(row, expected / expected.sum(), atol=1e-4)


def test_gradients_reach_the_guides() -> None:
    blend = GuideBlend(hair(12).double(), 5)
    values = torch.randn(5, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(blend, (values,))


def test_strands_in_one_place_have_the_same() -> None:
    strands = hair(1).expand(7, -1, -1)
    found = GuideBlend(strands, 3)(torch.randn(3, 2))
    torch.testing.assert_close(found, found[:1].expand(7, -1))
