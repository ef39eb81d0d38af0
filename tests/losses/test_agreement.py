"""Colours that count where labels agree."""

from __future__ import annotations

import pytest
import torch

from dynhair.losses.agreement import agreed


def pictures(dtype: torch.dtype) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    colours, truth = torch.rand(2, 1, 4, 5, 3, generator=generator, dtype=torch.float64).to(dtype)
    shares = torch.rand(2, 3, 1, 4, 5, generator=generator, dtype=torch.float64)
    shares[:, :, 0, 0] = torch.tensor([[1.0, 0, 0], [0, 1.0, 0]], dtype=torch.float64)[..., None]  # wrong altogether
    shares[:, :, 0, 1] = 0.25  # right
    labels, true_labels = (shares / shares.sum(1, keepdim=True).clamp_min(1)).to(dtype)[:, :2]
    return [colours, truth, *labels, *true_labels]


def test_colours_count_as_far_as_labels_agree() -> None:
    colours, truth, hair, body, true_hair, true_body = pictures(torch.float32)
    result = agreed(colours, truth, (hair, body), (true_hair, true_body))
    torch.testing.assert_close(result[:, 0], truth[:, 0])
    torch.testing.assert_close(result[:, 1], colours[:, 1])
    common = torch.minimum(hair, true_hair) + torch.minimum(body, true_body)
    common = common + torch.minimum(1 - hair - body, 1 - true_hair - true_body)
    torch.testing.assert_close(result, truth + common[..., None] * (colours - truth))


@pytest.mark.parametrize("threads", [1, 3])
def test_the_compiled_gradient_is_that_of_the_plain_formula(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynhair.threads.thread_count", lambda: threads)
    gradients = []
    for dtype in (torch.float32, torch.float64):
        colours, truth, *labels = pictures(dtype)
        colours.requires_grad_()
        labels[0].requires_grad_()
        result = agreed(colours, truth, (labels[0], labels[1]), (labels[2], labels[3]))
        (result * torch.arange(60).view_as(result)).sum().backward()
        assert labels[0].grad is None or not labels[0].grad.any()
        assert colours.grad is not None
        gradients.append(colours.grad)
    torch.testing.assert_close(gradients[0].double(), gradients[1], rtol=1e-5, atol=1e-5)


def test_images_may_lie_in_any_order_or_have_no_pixels() -> None:
    colours, truth, *labels = pictures(torch.float32)
    shares = [label.mT.contiguous().mT for label in labels]
    strewn = [image.movedim(-1, 1).contiguous().movedim(1, -1) for image in (colours, truth)]
    found = agreed(strewn[0], strewn[1], (shares[0], shares[1]), (shares[2], shares[3]))
    assert torch.equal(found, agreed(colours, truth, (labels[0], labels[1]), (labels[2], labels[3])))
    none = [label[:0] for label in labels]
    assert agreed(colours[:0], truth[:0], (none[0], none[1]), (none[2], none[3])).shape == (0, 4, 5, 3)
