"""Taking drawn features apart."""

from __future__ import annotations

import pytest
import torch

from dynhair.avatar.layers import layers
from dynhair.errors import DynhairError


def drawn(channels: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    sizes = (2, 3, 5, 4 + channels), (2, 3, 5), (channels,)
    features, alpha, background = (torch.rand(size, generator=generator, dtype=torch.float64) for size in sizes)
    return features, alpha, background


def test_layers_are_the_channels_and_what_is_seen_lies_over_the_background() -> None:
    features, alpha, background = drawn(3)
    found = layers(features, alpha, background)
    torch.testing.assert_close(found.seen, features[..., 4:] + (1 - alpha)[..., None] * background)
    torch.testing.assert_close(
        torch.cat([found.hair[..., None], found.body[..., None], found.direction], -1), features[..., :4]
    )
    assert all(layer.is_contiguous() for layer in found)


def test_gradients_of_layers() -> None:
    features, alpha, background = drawn(5)
    inputs = features.requires_grad_(), alpha.requires_grad_()
    assert torch.autograd.gradcheck(lambda f, a: tuple(layers(f, a, background)), inputs)


@pytest.mark.parametrize("threads", [1, 3])
def test_compiled_layers_are_the_plain_ones(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynhair.threads.thread_count", lambda: threads)
    features, alpha, background = drawn(4)
    plain = features.requires_grad_(), alpha.requires_grad_()
    quick = features.detach().float().requires_grad_(), alpha.detach().float().requires_grad_()
    expected, found = layers(plain[0], plain[1], background), layers(quick[0], quick[1], background.float())
    for some, others in zip(found, expected, strict=True):
        torch.testing.assert_close(some.double(), others, rtol=1e-5, atol=1e-6)
    generator = torch.Generator().manual_seed(1)
    weights = [torch.rand(layer.shape, generator=generator, dtype=layer.dtype) for layer in expected]
    torch.autograd.backward(list(expected), weights)
    torch.autograd.backward(list(found), [weight.float() for weight in weights])
    for some, others in zip(quick, plain, strict=True):
        assert some.grad is not None
        assert others.grad is not None
        torch.testing.assert_close(some.grad.double(), others.grad, rtol=1e-5, atol=1e-6)


def test_views_without_pixels_have_layers_without_pixels() -> None:
    features = torch.zeros(0, 3, 5, 7, requires_grad=True)
    found = layers(features, torch.zeros(0, 3, 5), torch.zeros(3))
    assert [layer.shape for layer in found] == [(0, 3, 5, 3), (0, 3, 5), (0, 3, 5), (0, 3, 5, 2)]
    found.seen.sum().backward()
    assert features.grad is not None


def test_layers_of_images_that_lie_in_any_order() -> None:
    features, alpha, background = (tensor.float() for tensor in drawn(3))
    strewn = features.movedim(-1, 1).contiguous().movedim(1, -1), alpha.mT.contiguous().mT
    for some, others in zip(layers(*strewn, background), layers(features, alpha, background), strict=True):
        assert torch.equal(some, others)


def test_a_background_with_other_channels_is_refused() -> None:
    for dtype in (torch.float32, torch.float64):
        features, alpha, background = (tensor.to(dtype) for tensor in drawn(3))
        with pytest.raises(DynhairError, match=r"`features` has the shape \(2, 3, 5, 7\)"):
            layers(features, alpha, background[:2])
