"""The compiled pose at its edges; its values and gradients are compared in test_head.py."""

from __future__ import annotations

import pytest
import torch

from dynhair.avatar.posed_gaussians import Canonical, ExpressionChange, Posed, posed_gaussians
from dynhair.errors import DynhairError

REACHES = (0.02, 0.5)


def gaussians(count: int, moving: int) -> tuple[Canonical, ExpressionChange, torch.Tensor]:
    """Gaussians of which the last ones move with the expression, and frames of a head and a body."""
    generator = torch.Generator().manual_seed(0)
    canonical = Canonical(*[torch.rand(count, width, generator=generator) for width in (3, 4, 3, 1, 1, 3, 8)])
    canonical = canonical._replace(logits=canonical.logits[:, 0], follow=canonical.follow[:, 0])
    slots = torch.full((count,), -1, dtype=torch.int32)
    slots[count - moving :] = torch.arange(moving, dtype=torch.int32)
    change = ExpressionChange(slots, *[torch.rand(moving, width, generator=generator) for width in (3, 4, 1)])
    turns = torch.nn.functional.normalize(change.turns, dim=-1)
    quaternion = torch.tensor([1.0, 0, 0, 0])
    frame = torch.cat([torch.eye(3).flatten(), torch.zeros(3)])
    return (
        canonical,
        change._replace(turns=turns, growth=change.growth[:, 0]),
        torch.cat([frame] * 2 + [quaternion] * 2),
    )


def of(posed: Posed, inputs: tuple[torch.Tensor, ...]) -> tuple[torch.Tensor, ...]:
    return torch.autograd.grad(sum((values.square().sum() for values in posed), torch.zeros(())), inputs)


@pytest.mark.parametrize(("count", "moving"), [(0, 0), (20, 0), (20, 20)])
def test_there_may_be_no_gaussians_and_none_or_all_may_move(count: int, moving: int) -> None:
    canonical, change, frames = gaussians(count, moving)
    inputs = canonical.means.requires_grad_(), change.shifts.requires_grad_(), frames.requires_grad_()
    posed = posed_gaussians(canonical, change, frames, REACHES)
    means = canonical.means + REACHES[0] * canonical.moved
    torch.testing.assert_close(posed.means, means + change.shifts if moving else means)  # both frames are the world
    of_means, of_shifts, of_frames = of(posed, inputs)
    assert of_means.shape == (count, 3)
    assert torch.equal(of_shifts, of_means[count - moving :])
    assert of_frames.isfinite().all()


def test_tensors_may_lie_in_memory_in_any_order() -> None:
    canonical, change, frames = gaussians(20, 5)
    strewn = Canonical(*[tensor.mT.contiguous().mT if tensor.ndim > 1 else tensor for tensor in canonical])
    found = []
    for some in (canonical, strewn):
        inputs = some.means.requires_grad_(), some.offsets.requires_grad_()
        posed = posed_gaussians(some, change, frames, REACHES)
        found.append((*posed, *of(posed, inputs)))
    for one, other in zip(*found, strict=True):
        assert torch.equal(one, other)


def test_frames_of_another_length_are_refused() -> None:
    canonical, change, frames = gaussians(4, 2)
    others, _, _ = gaussians(3, 0)
    with pytest.raises(DynhairError, match="`offsets` has the shape"):
        posed_gaussians(canonical._replace(offsets=others.offsets), change, frames, REACHES)
