"""Colours count as far as labels agree."""

from __future__ import annotations

import torch

from dynhair.avatar import AvatarImages
from dynhair.training.batches import Batch
from dynhair.training.objective import agreed_colours


def test_colours_count_where_labels_agree_and_teach_nothing_elsewhere() -> None:
    # pixels: hair on hair, body on body, hair on body, body on hair, background on body, half hair on hair, nothing
    hair = torch.tensor([[[1.0, 0, 1, 0, 0, 0.5, 0]]])
    body = torch.tensor([[[0.0, 1, 0, 1, 0, 0.5, 0]]])
    true_hair = torch.tensor([[[1.0, 0, 0, 1, 0, 1, 0]]])
    true_body = torch.tensor([[[0.0, 1, 1, 0, 1, 0, 0]]])
    rgb = torch.full((1, 1, 7, 3), 0.2, requires_grad=True)
    images = AvatarImages(rgb, hair, body, torch.zeros(1, 1, 7, 2), hair + body)
    zeros = torch.zeros(1, 1, 7)
    batch = Batch(0, 0, [], torch.full((1, 1, 7, 3), 0.8), true_hair, true_body, zeros, zeros)
    agreed = agreed_colours(images, batch)
    share = torch.tensor([1.0, 1, 0, 0, 0, 0.5, 1])
    torch.testing.assert_close(agreed[0, 0, :, 0].detach(), 0.2 * share + 0.8 * (1 - share))
    agreed.sum().backward()
    assert rgb.grad is not None
    torch.testing.assert_close(rgb.grad[0, 0, :, 0], share)
