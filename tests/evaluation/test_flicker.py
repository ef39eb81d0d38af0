"""tLPIPS_ex against the paper's formula with plain loops, on images and by the whole protocol."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from stand_ins import CAMERAS, SEGMENTS, StandInAvatar, StandInCapture, rigid_twin

from dynhair.evaluation.definitions import FLICKER
from dynhair.evaluation.flicker import TrueFlicker, hair_change
from dynhair.evaluation.perception import Perception
from dynhair.evaluation.protocol import evaluate_avatar
from dynhair.evaluation.truth import TrueFrame

SIZE = (2, 70, 80)


def frame(index: int, seed: int, *, hair: bool = True) -> TrueFrame:
    generator = torch.Generator().manual_seed(seed)
    rgb, coverage = torch.rand(*SIZE, 3, generator=generator), torch.rand(*SIZE, generator=generator)
    if not hair:
        return TrueFrame(index, rgb, None, None, None)
    return TrueFrame(index, rgb, coverage > 0.5, coverage, 1 - coverage)


def test_a_change_is_lpips_within_the_hair_of_both_frames(random_network: Perception) -> None:
    flicker, first, second = TrueFlicker(random_network, 0), frame(3, 0), frame(4, 1)
    assert flicker.change(first) is None
    change = flicker.change(second)
    assert change is not None
    assert first.hair_coverage is not None
    assert second.hair_coverage is not None
    region = np.minimum(first.hair_coverage.numpy() + second.hair_coverage.numpy(), 1.0)
    np.testing.assert_allclose(change.region.numpy(), region)
    distance = random_network.distance
    assert distance is not None
    for view in range(SIZE[0]):
        within = torch.from_numpy(region[view])[..., None]
        expected = distance(first.rgb[view] * within, second.rgb[view] * within)
        torch.testing.assert_close(change.distance[view], expected)


def test_only_frames_in_a_row_with_hair_are_compared(random_network: Perception) -> None:
    flicker = TrueFlicker(random_network, 0)
    assert [flicker.change(frame(index, index)) is None for index in (0, 1, 3, 4)] == [True, False, True, False]
    assert flicker.change(frame(5, 5, hair=False)) is None
    assert flicker.change(frame(6, 6)) is None
    blind = TrueFlicker(Perception(None, "none"), 0)
    assert [blind.change(frame(index, index)) for index in range(3)] == [None] * 3


def test_the_protocol_averages_the_excess_over_pairs_of_the_test(random_network: Perception) -> None:
    capture, avatar = StandInCapture(), StandInAvatar()
    evaluation = evaluate_avatar(avatar, capture)
    excess = []
    for segment in SEGMENTS:
        if segment.split != "test":
            continue
        last = None
        for index in range(segment.count):
            views = [capture.view(segment.frames[index], name) for name in CAMERAS]
            cameras = [capture.camera(segment.frames[index], name) for name in CAMERAS]
            drawn = avatar.draw(avatar.pose(capture.track(segment), index), cameras).rgb.clamp(0.0, 1.0)
            true, hair = torch.stack([v.rgb for v in views]), torch.stack([v.hair for v in views if v.hair is not None])
            if last is not None:
                region = (last[2] + hair).clamp(0, 1)
                moved = hair_change(random_network, last[0], drawn, region)
                excess += (moved - hair_change(random_network, last[1], true, region)).tolist()
            last = drawn, true, hair
    assert evaluation.avatar.values[FLICKER] == pytest.approx(np.mean(excess), abs=1e-6)
    assert evaluation.avatar.samples[FLICKER] == len(excess)
    assert evaluation.avatar.values[FLICKER] != rigid_twin(evaluation).values[FLICKER]


def test_the_truth_neither_flickers_nor_is_stiff() -> None:
    values = evaluate_avatar(StandInAvatar(error=0.0, share=1.0), StandInCapture()).avatar.values
    assert values[FLICKER] == pytest.approx(0.0, abs=1e-6)
