"""Captures as other tools leave them: landmarks and poses, but no mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dynhair.capture import Capture
from dynhair.face import open_head
from synthetic import write_synthetic_capture

NECK = torch.tensor([0.0, -0.05, -0.03])  # from the head frame's origin to the head joint


def true_head(expression: np.ndarray) -> Tensor:
    """Vertices of the filmed head in its head frame, metres; the first coefficient opens the mouth."""
    model = open_head()
    strength = torch.zeros(len(model.expression_modes))
    strength[model.expression_names.index("jawOpen")] = float(expression[0])
    return model.vertices(expression=strength) + NECK


def write_meshless_capture(path: Path, *, frames: int = 4, views: int = 2, size: int = 24) -> Path:
    """Write a folder prepared for Gaussian Head Avatar, with hair masks and the landmarks of `true_head`.

    Two segments of one motion each; every frame trains.
    """
    write_synthetic_capture(path, frames=frames, views=views, size=size, with_gt=False)
    capture = Capture.open(path)
    for segment in capture.segments:
        track = capture.track(segment)
        for index, frame in enumerate(segment.frames):
            landmarks = true_head(track.expressions[index])[open_head().landmarks66].numpy()
            world = landmarks @ track.rotations[index].T + track.translations[index]
            np.save(capture.layout.landmarks_3d(frame), world.astype(np.float32))
            capture.layout.vertices(frame).unlink()
    capture.layout.mesh.unlink()
    capture.layout.manifest.unlink()
    return path
