"""The start of a training, of any sizes: Gaussians on the tracked head, and strands that hang from its scalp."""

from __future__ import annotations

import torch
from torch import Tensor

from dynhair.avatar import Avatar, Hair, ScalpLayer
from dynhair.avatar.mlp import quick_precision, use_precision
from dynhair.capture import Capture
from dynhair.config import Config
from dynhair.motion import SignalNormalizer, motion_signals
from dynhair.strands import sample_roots
from dynhair.training.frames import head_at_rest, head_frame, rest_frame, training_segments
from dynhair.training.head_start import start_head
from dynhair.training.objective import JointObjective
from dynhair.training.surface import tracked_surface

HANGING = 0.25  # metres


def started(capture: Capture, config: Config) -> JointObjective:
    """The objective before its first step, in the precision that training would choose."""
    segments = training_segments(capture)
    start = start_head(capture, config.head, 0)
    strands = hanging_strands(capture, config.hair.strands, config.hair.points)
    hair = Hair(strands, 0.001, torch.full((3,), 0.3), config.hair.deformer)
    signals = [motion_signals(capture.track(segment)) for segment in segments]
    normalizer = SignalNormalizer.fit(signals, config.hair.deformer, head_at_rest(capture))
    scalp = ScalpLayer.under(strands[:, 0], start.head.means.detach(), start.scalp)
    avatar = Avatar(hair, start.head, normalizer, torch.zeros(3), scalp)
    use_precision(avatar, quick_precision(torch.device("cpu")))
    return JointObjective(avatar, capture, segments, start.points, config.training)


def hanging_strands(capture: Capture, count: int, points: int) -> Tensor:
    """Strands straight down from the scalp in the rest frame, head frame, metres."""
    surface = tracked_surface(capture)
    segment, index = rest_frame(capture)
    vertices = head_frame(capture.track(segment), index)(surface.vertices(segment.start + index))
    roots = sample_roots(vertices, surface.faces, surface.scalp, count, 0).positions(vertices)
    down = torch.linspace(0, HANGING, points)[:, None] * torch.tensor([0.0, -1.0, 0.0])
    return roots[:, None] + down
