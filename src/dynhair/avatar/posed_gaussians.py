"""The head's Gaussians from the head frame into the world, in one pass on the CPU and one back."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable

from dynhair.native import Kernel, compiled, require_shapes
from dynhair.threads import run, shares

_SOURCES = Path(__file__).with_name("native")
_READ = "frames reaches means quats moved offsets follow slots:i32 shifts turns"


class Canonical(NamedTuple):
    """Gaussians in the head frame, and what changes them.

    Attributes:
        means: metres.
        quats: wxyz, of any length.
        log_scales: of standard deviations in metres.
        logits: of opacities.
        follow: 1 for what moves with the head, 0 for what moves with the body.
        moved: displacement, over its reach.
        offsets: of log-scales, quaternions and logits, over their reach.
    """

    means: Float[Tensor, "k 3"]
    quats: Float[Tensor, "k 4"]
    log_scales: Float[Tensor, "k 3"]
    logits: Float[Tensor, " k"]
    follow: Float[Tensor, " k"]
    moved: Float[Tensor, "k 3"]
    offsets: Float[Tensor, "k 8"]


class ExpressionChange(NamedTuple):
    """What the expression does to some of the Gaussians.

    Attributes:
        slots: of each Gaussian the row below that is its own, or -1.
        shifts: head frame, metres.
        turns: unit quaternions, wxyz; no gradient.
        growth: of the log-scales; no gradient.
    """

    slots: Int[Tensor, " k"]
    shifts: Float[Tensor, "m 3"]
    turns: Float[Tensor, "m 4"]
    growth: Float[Tensor, " m"]


class Posed(NamedTuple):
    """Gaussians in the world: metres, unit wxyz, logarithms of metres, logits of opacities."""

    means: Float[Tensor, "k 3"]
    quats: Float[Tensor, "k 4"]
    log_scales: Float[Tensor, "k 3"]
    logits: Float[Tensor, " k"]


def posed_gaussians(
    canonical: Canonical, change: ExpressionChange, frames: Float[Tensor, "32"], reaches: tuple[float, float]
) -> Posed:
    """Move, turn and grow Gaussians with the expression, then with head and body (float32, on the CPU).

    Args:
        canonical: the Gaussians.
        change: what the expression does to them.
        frames: where head and body are, see :attr:`dynhair.avatar.skinning.Placement.numbers`.
        reaches: factors on ``moved`` (metres) and on ``offsets``.

    Raises:
        DynhairError: the tensors are not of the same Gaussians.
    """
    count, moving = len(canonical.means), len(change.shifts)
    require_shapes(
        frames=(frames, (32,)),
        means=(canonical.means, (count, 3)),
        quats=(canonical.quats, (count, 4)),
        log_scales=(canonical.log_scales, (count, 3)),
        logits=(canonical.logits, (count,)),
        follow=(canonical.follow, (count,)),
        moved=(canonical.moved, (count, 3)),
        offsets=(canonical.offsets, (count, 8)),
        slots=(change.slots, (count,)),
        shifts=(change.shifts, (moving, 3)),
        turns=(change.turns, (moving, 4)),
        growth=(change.growth, (moving,)),
    )
    tensors = [tensor.contiguous() for tensor in (*canonical, *change, frames)]
    return Posed(*_Posed.apply(*tensors, frames.new_tensor(reaches)))


class _Posed(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        means: Tensor, quats: Tensor, log_scales: Tensor, logits: Tensor, follow: Tensor,
        moved: Tensor, offsets: Tensor,
        slots: Tensor, shifts: Tensor, turns: Tensor, growth: Tensor, frames: Tensor, reaches: Tensor,
    ) -> Any:  # fmt: skip
        read = frames, reaches, means, quats, moved, offsets, follow, slots, shifts, turns
        written = [torch.empty_like(like) for like in (means, quats, log_scales, logits)]
        kernel = _forward()
        run(partial(kernel, *some, *read, growth, log_scales, logits, *written) for some in shares(len(means)))
        ctx.save_for_backward(*read)
        return tuple(written)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        read = ctx.saved_tensors
        _, _, means, quats, moved, offsets, follow, slots, shifts, _ = read
        given = [gradient.contiguous() for gradient in gradients]
        of_means, of_quats, of_moved, of_offsets, of_follow = (
            torch.empty_like(like) for like in (means, quats, moved, offsets, follow)
        )
        parts, kernel = shares(len(means)), _backward()
        of_frames = means.new_empty(len(parts), 32)
        run(
            partial(kernel, *some, *read, *given, of_means, of_quats, of_moved, of_offsets, of_follow, of_frames[part])
            for part, some in enumerate(parts)
        )
        moving = torch.nonzero(slots >= 0)[:, 0]
        of_shifts = torch.zeros_like(shifts).index_copy_(0, slots[moving].long(), of_means[moving])
        of_logits, of_log_scales = given[3], given[2]
        return (
            of_means, of_quats, of_log_scales, of_logits, of_follow, of_moved, of_offsets,
            None, of_shifts, None, None, of_frames.sum(0), None,
        )  # fmt: skip


def _forward() -> Kernel:
    arrays = f"{_READ} growth log_scales logits world_means world_quats posed_scales posed_logits"
    return _kernel("pose_gaussians", arrays)


def _backward() -> Kernel:
    given = "of_world_means of_world_quats of_posed_scales of_posed_logits"
    return _kernel(
        "pose_gaussians_backward", f"{_READ} {given} of_means of_quats of_moved of_offsets of_follow of_frames"
    )


def _kernel(name: str, arrays: str) -> Kernel:
    sources = (_SOURCES / "quaternions.cpp", _SOURCES / f"{name}.cpp")
    return compiled(*sources, integers="first last", arrays=arrays)
