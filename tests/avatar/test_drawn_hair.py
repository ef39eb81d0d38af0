"""The compiled drawing of strands against the same in plain PyTorch and float64."""

from __future__ import annotations

import pytest
import torch

from dynhair.avatar.drawn_hair import COLOURS, drawn_hair, plain_drawn_hair
from dynhair.camera import Camera
from dynhair.errors import DynhairError

WIDTH = 0.001


def cameras(dtype: torch.dtype) -> list[Camera]:
    """Two views from a metre and a half, with pixels that are not square."""
    views = []
    for angle in (0.1, 1.3):
        cosine, sine = torch.cos(torch.tensor(angle)).item(), torch.sin(torch.tensor(angle)).item()
        w2c = torch.tensor([[cosine, 0, sine, 0.02], [0, -1, 0, 0.1], [sine, 0, -cosine, 1.5]], dtype=dtype)
        K = torch.tensor([[300.0, 0, 128], [0, 320, 120], [0, 0, 1]], dtype=dtype)
        views.append(Camera(w2c, K, 256, 240))
    return views


def hairstyle(strands: int, points: int) -> list[torch.Tensor]:
    """Curly strands and harmonics, some of which are darker than black."""
    generator = torch.Generator().manual_seed(strands)
    steps = 0.01 * torch.randn(strands, points, 3, generator=generator, dtype=torch.float64)
    roots = 0.1 * torch.randn(strands, 1, 3, generator=generator, dtype=torch.float64)
    n = strands * (points - 1)
    base = torch.randn(1, 3, n, generator=generator, dtype=torch.float64)
    higher = 0.3 * torch.randn(15, 3, n, generator=generator, dtype=torch.float64)
    return [roots + steps.cumsum(1), base, higher]


@pytest.mark.parametrize(("strands", "points"), [(1, 2), (3, 5), (7, 17), (4, 18), (20, 40)])
@pytest.mark.parametrize("threads", [1, 2])
def test_values_and_gradients_are_those_of_the_plain_formulas(
    strands: int, points: int, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynhair.threads.thread_count", lambda: threads)
    plain = [tensor.requires_grad_() for tensor in hairstyle(strands, points)]
    quick = [tensor.detach().float().requires_grad_() for tensor in plain]
    widths = WIDTH * torch.linspace(0.5, 2, strands, dtype=torch.float64)
    expected = plain_drawn_hair(plain[0], widths, plain[1], plain[2], cameras(torch.float64))
    found = drawn_hair(quick[0], widths.float(), quick[1], quick[2], cameras(torch.float32))
    for some, others in zip(found, expected, strict=True):
        torch.testing.assert_close(some.double(), others, rtol=1e-4, atol=1e-4)  # end on, float32 sees little

    generator = torch.Generator().manual_seed(5)
    weights = [torch.randn(values.shape, generator=generator, dtype=torch.float64) for values in expected]
    torch.autograd.backward(list(expected), weights)
    torch.autograd.backward(list(found), [weight.float() for weight in weights])
    for some, others in zip(quick, plain, strict=True):
        assert some.grad is not None
        assert others.grad is not None
        most = float(others.grad.abs().max())
        torch.testing.assert_close(some.grad.double(), others.grad, rtol=1e-4, atol=1e-5 * most)


def test_a_segment_without_length_has_finite_gradients() -> None:
    strands, base, higher = (tensor.float() for tensor in hairstyle(2, 6))
    strands[0, 2] = strands[0, 3]
    strands.requires_grad_()
    hair = drawn_hair(strands, torch.full((len(strands),), WIDTH), base, higher, cameras(torch.float32))
    sum(values.sum() for values in hair).backward()  # pyright: ignore[reportAttributeAccessIssue]
    assert strands.grad is not None
    assert strands.grad.isfinite().all()


@pytest.mark.parametrize(("strands", "points"), [(0, 5), (3, 1)])
def test_hair_without_segments_draws_nothing(strands: int, points: int) -> None:
    given = [tensor.float().requires_grad_() for tensor in hairstyle(strands, points)]
    hair = drawn_hair(given[0], torch.full((len(given[0]),), WIDTH), given[1], given[2], cameras(torch.float32))
    assert [len(hair.means), len(hair.quats), len(hair.scales)] == [0, 0, 0]
    assert hair.features.shape == (2, 0, 7)
    hair.features.sum().backward()
    assert given[0].grad is not None
    assert given[0].grad.shape == (strands, points, 3)
    assert not given[0].grad.any()


def test_tensors_may_lie_in_memory_in_any_order() -> None:
    given = [tensor.float() for tensor in hairstyle(4, 18)]
    strewn = [tensor.mT.contiguous().mT.requires_grad_() for tensor in given]
    assert not any(tensor.is_contiguous() for tensor in strewn[:1])
    found = []
    for strands, base, higher in (given, strewn):
        strands.requires_grad_()
        hair = drawn_hair(strands, torch.full((len(strands),), WIDTH), base, higher, cameras(torch.float32))
        (hair.features.square().sum() + hair.means.mT.contiguous().mT.square().sum()).backward()
        found.append((*hair, strands.grad))
    for one, other in zip(*found, strict=True):
        assert one is not None
        assert other is not None
        assert torch.equal(one, other)


def test_harmonics_of_another_hairstyle_are_refused() -> None:
    strands, (_, base, higher) = hairstyle(3, 6)[0], hairstyle(3, 5)
    with pytest.raises(DynhairError, match=r"`base` has the shape \(1, 3, 12\)\nexpected: \(1, 3, 15\)"):
        drawn_hair(strands.float(), torch.full((3,), WIDTH), base.float(), higher.float(), cameras(torch.float32))


def test_a_colour_does_not_move_what_it_is_the_colour_of() -> None:
    strands, base, higher = (tensor.float() for tensor in hairstyle(3, 6))
    for draw in (drawn_hair, plain_drawn_hair):
        strands = strands.detach().requires_grad_()
        draw(strands, torch.full((3,), WIDTH), base, higher, cameras(torch.float32)).features[
            ..., COLOURS
        ].sum().backward()
        assert strands.grad is None or not strands.grad.any()
