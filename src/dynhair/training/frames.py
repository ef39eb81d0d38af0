"""Which frames training sees, and the head frame in them."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from dynhair.capture import Capture, HeadTrack, Segment


def training_segments(capture: Capture) -> list[Segment]:
    """The segments that training may see."""
    return [segment for segment in capture.segments if segment.split == "train"]


def rest_frame(capture: Capture) -> tuple[Segment, int]:
    """The training segment, and the index inside it, of the frame in which the hair is at rest."""
    training = training_segments(capture)
    for segment in training:
        if capture.static_frame in segment.frames:
            return segment, capture.static_frame - segment.start
    return training[0], 0


def head_frame(track: HeadTrack, index: int) -> Callable[[Tensor], Tensor]:
    """The map from world points to the head frame of one frame of a track."""
    rotation = torch.from_numpy(track.rotations[index]).float()
    translation = torch.from_numpy(track.translations[index]).float()
    return lambda points: (points - translation) @ rotation
