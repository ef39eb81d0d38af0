"""What noise alone changes from frame to frame: taken where a motion has not begun yet."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from stand_ins import CAMERAS, SEGMENTS, StandInAvatar, StandInCapture

from dynhair.capture import HeadTrack, Segment
from dynhair.evaluation.definitions import STILL_CHANGE, STILL_FIGURES, STILL_OVERLAP
from dynhair.evaluation.flicker import hair_change
from dynhair.evaluation.perception import Perception
from dynhair.evaluation.protocol import evaluate_avatar
from dynhair.evaluation.settling import ARM
from dynhair.evaluation.stillness import STILL, still_frames

REST = 3


class BeginsAtRest(StandInCapture):
    """Its head rests for the first frames, of which the images differ all the same."""

    def track(self, segment: Segment) -> HeadTrack:
        track, frames = super().track(segment), np.arange(segment.count)
        held = np.where(frames < REST, 0, frames)
        return dataclasses.replace(track, rotations=track.rotations[held], translations=track.translations[held])


def track_of(angles: list[float], moved: list[float]) -> HeadTrack:
    return HeadTrack(
        rotations=Rotation.from_rotvec([[0.3, angle, 0.0] for angle in angles]).as_matrix(),
        translations=np.array([[1.0, 2.0 + y, 3.0] for y in moved]),
        expressions=np.zeros((len(angles), 1), np.float32),
        fps=30.0,
        gravity=np.array([0.0, -9.81, 0.0]),
    )


@pytest.mark.parametrize(
    ("angles", "moved", "still"),
    [
        ([0, 0, 0.1, 0], [0, 0, 0, 0], 2),  # its coming back does not count
        ([0, 0, 0, 0], [0, 0, 0, 0.01], 3),
        ([0, 0.45 * STILL / ARM, 0.9 * STILL / ARM, 1.4 * STILL / ARM], [0, 0, 0, 0], 3),  # since the first frame
        ([0, 0.6 * STILL / ARM], [0, 0.6 * STILL], 1),
        ([0, 0, 0], [0, 0, 0], 3),
        ([0], [0], 1),
    ],
)
def test_a_head_is_still_until_it_has_moved(angles: list[float], moved: list[float], still: int) -> None:
    assert still_frames(track_of(angles, moved)) == still


def test_noise_is_what_changes_before_the_motion(random_network: Perception) -> None:
    capture = BeginsAtRest()
    evaluation = evaluate_avatar(StandInAvatar(), capture)
    overlaps, changes = [], []
    for segment in SEGMENTS:
        if segment.split != "test":
            continue
        for index in range(1, min(REST, segment.count)):
            pair = [[capture.view(segment.frames[i], name) for name in CAMERAS] for i in (index - 1, index)]
            coverage = [torch.stack([view.hair for view in views if view.hair is not None]) for views in pair]
            first, second = ((hair > 0.5).numpy() for hair in coverage)
            overlaps += [(a & b).sum() / (a | b).sum() for a, b in zip(first, second, strict=True)]
            before, after = (torch.stack([view.rgb for view in views]) for views in pair)
            changes += hair_change(random_network, before, after, (coverage[0] + coverage[1]).clamp(0, 1)).tolist()
    assert evaluation.avatar.values[STILL_OVERLAP] == pytest.approx(np.mean(overlaps))
    assert evaluation.avatar.values[STILL_CHANGE] == pytest.approx(np.mean(changes), rel=1e-5)
    for name in STILL_FIGURES:
        assert evaluation.avatar.samples[name] == len(overlaps)


def test_a_motion_that_begins_at_once_does_not_tell_noise(random_network: Perception) -> None:
    figures = evaluate_avatar(StandInAvatar(), StandInCapture()).avatar
    for name in STILL_FIGURES:
        assert figures.values[name] is None
        assert figures.reasons[name] == "no motion begins with a head that rests for two frames"
