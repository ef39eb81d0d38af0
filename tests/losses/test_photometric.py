"""L1 and SSIM against loops and scikit-image."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from skimage.metrics import structural_similarity

from dynhair.errors import DynhairError
from dynhair.losses import l1_loss, ssim, ssim_loss, ssim_map
from dynhair.losses.native_ssim import mean_similarity


def pictures(seed: int, height: int = 24, width: int = 31, noise: float = 0.2) -> tuple[torch.Tensor, torch.Tensor]:
    """A smooth picture and a noisy one of it, with flat parts."""
    generator = torch.Generator().manual_seed(seed)
    y, x = torch.meshgrid(torch.linspace(0, 6, height), torch.linspace(0, 6, width), indexing="ij")
    phase = 6 * torch.rand(3, generator=generator)
    first = (0.5 + 0.5 * torch.sin(x[..., None] + y[..., None] + phase)).clamp(0.2, 1).double()
    second = (first + noise * torch.randn(first.shape, generator=generator, dtype=torch.float64)).clamp(0, 1)
    return first, second


def reference(first: torch.Tensor, second: torch.Tensor) -> tuple[float, np.ndarray]:
    mean, full = structural_similarity(  # pyright: ignore[reportAssignmentType]
        first.numpy(),
        second.numpy(),
        channel_axis=-1,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    return mean, full


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.5])
def test_ssim_agrees_with_scikit_image(noise: float) -> None:
    first, second = pictures(0, noise=noise)
    mean, full = reference(first, second)
    np.testing.assert_allclose(ssim_map(first, second), full, atol=1e-10)
    assert ssim(first, second).item() == pytest.approx(mean, abs=1e-10)
    assert ssim_loss(first.float(), second.float()).item() == pytest.approx(1 - mean, abs=1e-5)


def test_ssim_agrees_with_a_loop() -> None:
    first, second = pictures(3, 14, 13)
    taps = [math.exp(-0.5 * (offset / 1.5) ** 2) for offset in range(-5, 6)]
    window = [[a * b / sum(taps) ** 2 for b in taps] for a in taps]
    values = []
    for channel in range(3):
        x, y = (image[..., channel].tolist() for image in (first, second))
        for top, left in itertools.product(range(14 - 10), range(13 - 10)):
            cells = [(window[i][j], x[top + i][left + j], y[top + i][left + j]) for i in range(11) for j in range(11)]
            mean_x, mean_y = sum(w * a for w, a, _ in cells), sum(w * b for w, _, b in cells)
            variance_x = sum(w * (a - mean_x) ** 2 for w, a, _ in cells)
            variance_y = sum(w * (b - mean_y) ** 2 for w, _, b in cells)
            covariance = sum(w * (a - mean_x) * (b - mean_y) for w, a, b in cells)
            luminance = (2 * mean_x * mean_y + 1e-4) / (mean_x**2 + mean_y**2 + 1e-4)
            values.append(luminance * (2 * covariance + 9e-4) / (variance_x + variance_y + 9e-4))
    assert ssim_loss(first, second).item() == pytest.approx(1 - sum(values) / len(values))


def test_ssim_averages_over_views() -> None:
    pairs = [pictures(seed) for seed in range(3)]
    firsts, seconds = (torch.stack(views) for views in zip(*pairs, strict=True))
    expected = np.mean([reference(first, second)[0] for first, second in pairs])
    assert ssim(firsts, seconds).item() == pytest.approx(expected)


@given(st.integers(0, 10_000))
def test_ssim_is_symmetric_bounded_and_one_for_equal_images(seed: int) -> None:
    first, second = pictures(seed, 14, 13)
    torch.testing.assert_close(ssim_map(first, second), ssim_map(second, first))
    torch.testing.assert_close(ssim(first, first), torch.tensor(1.0, dtype=torch.float64))
    assert ssim_map(first, second).abs().max() <= 1 + 1e-12
    assert ssim_map(first, 1 - first).min() >= -1 - 1e-12


def test_ssim_gradients_agree_with_finite_differences() -> None:
    first, second = (image[:12, :11, :1] for image in pictures(1))
    assert torch.autograd.gradcheck(ssim_loss, (first.clone().requires_grad_(), second.clone().requires_grad_()))


def test_images_smaller_than_the_window_are_refused() -> None:
    with pytest.raises(DynhairError, match="30 x 10"):
        ssim(torch.zeros(10, 30, 3), torch.zeros(10, 30, 3))


def test_l1_is_the_mean_absolute_difference() -> None:
    first, second = pictures(2)
    expected = np.mean([abs(a - b) for a, b in zip(first.flatten().tolist(), second.flatten().tolist(), strict=True)])
    assert l1_loss(first, second).item() == pytest.approx(expected)
    assert torch.autograd.gradcheck(l1_loss, (first[:2, :2].clone().requires_grad_(), second[:2, :2]))


@pytest.mark.parametrize("shape", [(2, 40, 33, 3), (11, 11, 1), (1, 12, 30, 2), (13, 14, 3)])
@pytest.mark.parametrize("threads", [1, 2])
def test_the_compiled_similarity_has_the_value_and_the_gradient_of_the_plain_one(
    shape: tuple[int, ...], threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynhair.threads.thread_count", lambda: threads)
    generator = torch.Generator().manual_seed(1)
    target = torch.rand(shape, generator=generator)
    image = (target + 0.1 * torch.randn(shape, generator=generator)).clamp(0, 1)
    quick, plain = image.clone().requires_grad_(), image.double().requires_grad_()
    ssim(quick, target).backward()
    (3 * ssim(plain, target.double())).backward()
    assert quick.grad is not None
    assert plain.grad is not None
    assert ssim(image, target).item() == pytest.approx(ssim(image.double(), target.double()).item(), abs=1e-6)
    torch.testing.assert_close(
        3 * quick.grad.double(), plain.grad, rtol=1e-4, atol=1e-5 * float(plain.grad.abs().max())
    )


def test_images_may_lie_in_any_order_or_be_none() -> None:
    images = torch.rand(2, 2, 20, 18, 3, generator=torch.Generator().manual_seed(2))
    strewn = images.movedim(-1, 2).contiguous().movedim(2, -1)
    found = []
    for some in (images, strewn):
        image = some[0].detach().requires_grad_()
        similarity = ssim(image, some[1])
        similarity.backward()
        found.append((similarity.detach(), image.grad))
    assert torch.equal(found[0][0], found[1][0])
    torch.testing.assert_close(found[0][1], found[1][1], rtol=0, atol=0)
    assert ssim(images[0, :0], images[1, :0]).isnan()


def test_a_window_of_another_size_is_refused() -> None:
    image = torch.rand(1, 20, 20, 3)
    with pytest.raises(DynhairError, match="`window` has the shape"):
        mean_similarity(image, image, torch.full((7,), 1 / 7))
