"""Which frames training sees, the head frame in them, and the hair masks it cannot do without."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.capture import Capture, HeadTrack, Segment, View
from dynhair.errors import DynhairError
from dynhair.motion import HeadAtRest


def training_segments(capture: Capture) -> list[Segment]:
    """The segments that training may see.

    Raises:
        DynhairError: there are none.
    """
    segments = [segment for segment in capture.segments if segment.split == "train"]
    if not segments:
        raise DynhairError(
            "no segment has the split `train`",
            path=capture.path / "capture.json",
            expected="at least one to train on",
            mend="set `split` of a segment to train",
        )
    return segments


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


def head_at_rest(capture: Capture) -> HeadAtRest:
    """The head in the rest frame, and what the canonical hair bears there."""
    segment, index = rest_frame(capture)
    rotation = torch.from_numpy(capture.track(segment).rotations[index])
    return HeadAtRest(rotation.float(), (rotation.T @ torch.from_numpy(capture.gravity)).float())


def training_cameras(capture: Capture, count: int) -> list[str]:
    """Names of the cameras that the joint training uses: the ``count`` that the face looks at most; all if 0."""
    if count == 0:
        return list(capture.camera_names)
    segment, index = rest_frame(capture)
    to_head = head_frame(capture.track(segment), index)
    centres = {name: to_head(capture.camera(segment.start + index, name).centre) for name in capture.camera_names}
    frontal = sorted(centres, key=lambda name: -float(centres[name][2] / centres[name].norm()))
    return sorted(frontal[:count], key=capture.camera_names.index)


def hair_mask(capture: Capture, view: View) -> Float[Tensor, "h w"]:
    """The hair's coverage in a view.

    Raises:
        DynhairError: the capture has no hair masks.
    """
    if view.hair is None:
        raise DynhairError(
            "the capture has no hair masks",
            path=capture.path,
            expected="hair_*.png beside each image",
            mend="segment the hair and write the masks into images/*/",
        )
    return view.hair
