"""What an avatar is held against: a capture's images and silhouettes, and its true strands where it has them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.capture import Capture, Segment, View
from dynhair.capture.arrays import read_npz
from dynhair.evaluation.hair_motion import to_head_frame
from dynhair.evaluation.metrics import silhouette

FRAMES_AHEAD = 2
"""Frames that are decoded while one is measured."""


@dataclass(frozen=True)
class TrueFrame:
    """All views of one frame.

    Attributes:
        index: the frame's place in its segment.
        rgb: images in [0, 1].
        hair: the hair's silhouettes; None where the capture has no hair masks.
        hair_coverage: the hair masks themselves, in [0, 1]; None with ``hair``.
        body_coverage: of what else there is of the person, in [0, 1]; None with ``hair``.
    """

    index: int
    rgb: Float[Tensor, "v h w 3"]
    hair: Bool[Tensor, "v h w"] | None
    hair_coverage: Float[Tensor, "v h w"] | None
    body_coverage: Float[Tensor, "v h w"] | None


def true_frames(capture: Capture, segment: Segment, indices: Sequence[int]) -> Iterator[TrueFrame]:
    """Yield the frames at these places of a segment, in order; a thread decodes a few of them ahead."""
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="truth") as decoder:
        pending: deque[Future[TrueFrame]] = deque()
        try:
            for index in indices:
                pending.append(decoder.submit(_decode, capture, segment, index))
                if len(pending) > FRAMES_AHEAD:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()


def true_strands(capture: Capture, segment: Segment) -> Float[Tensor, "f m p 3"] | None:
    """Read a segment's true strands in the head's frame, metres; None where the capture does not hold them."""
    truth = capture.ground_truth(segment)
    if truth is None:
        return None
    track = capture.track(segment)
    rotations, translations = torch.from_numpy(track.rotations), torch.from_numpy(track.translations)
    strands = torch.from_numpy(truth.strands).double()
    return torch.stack([to_head_frame(*frame) for frame in zip(strands, rotations, translations, strict=True)])


def true_hairstyle(capture: Capture, frame: int) -> Float[Tensor, "m p 3"] | None:
    """Read all true strands of one frame, world, metres; None where the capture does not hold them.

    The strands of a motion are a subset of these, too few to tell what a reconstruction adds or leaves out.

    Raises:
        DynhairError: the file is damaged.
    """
    path = capture.layout.ground_truth(f"strands_frame{frame}_all")
    if not path.exists():
        return None
    return torch.from_numpy(read_npz(path, {"strands": (None, None, 3)})["strands"]).float()


def _decode(capture: Capture, segment: Segment, index: int) -> TrueFrame:
    frame = segment.frames[index]
    views: list[View] = capture.views([(frame, name) for name in capture.camera_names])
    rgb = torch.stack([view.rgb for view in views])
    masks = [view.hair for view in views if view.hair is not None]
    if len(masks) < len(views):
        return TrueFrame(index, rgb, None, None, None)
    hair = torch.stack(masks)
    body = (torch.stack([view.mask for view in views]) - hair).clamp_min(0.0)
    return TrueFrame(index, rgb, silhouette(hair), hair, body)
