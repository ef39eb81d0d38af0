"""The picture of expressions: which frames it takes, and what it shows of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from stand_ins import StandInCapture

from dynhair.capture import Capture, Segment
from dynhair.evaluation.expressions import MOST_COEFFICIENTS, SIDE, ExpressionSheet, ExpressiveFrame, expressive_frames
from dynhair.evaluation.protocol import EvaluatedFrame, evaluated_indices
from synthetic import write_synthetic_capture

TRAIN, TEST = Segment("turn", 0, 4, "train"), Segment("nod", 4, 3, "test")


def choose(train: list[list[float]], test: list[list[float]]) -> list[ExpressiveFrame]:
    return expressive_frames((TRAIN, TEST), (range(4), range(3)), (np.array(train), np.array(test)))


def test_the_test_frame_where_a_coefficient_is_strongest_is_shown() -> None:
    chosen = choose([[0.0, 1.0], [9.0, 0.0], [0.0, 0.0], [0.0, 0.0]], [[0.2, 0.0], [0.0, 0.5], [3.0, 0.1]])
    assert chosen == [
        ExpressiveFrame(TEST, 0),
        ExpressiveFrame(TEST, 2, 0, 3.0),
        ExpressiveFrame(TEST, 1, 1, 0.5),
    ]


def test_training_frames_stand_in_for_what_the_test_never_uses() -> None:
    chosen = choose([[0.0, 1.0], [0.0, 4.0], [0.0, 0.0], [0.5, 0.0]], [[0.0, 0.0], [1.0, 0.3], [0.0, 0.1]])
    assert chosen[1:] == [ExpressiveFrame(TEST, 1, 0, 1.0), ExpressiveFrame(TRAIN, 1, 1, 4.0)]


def test_strong_means_far_from_zero_either_way() -> None:
    chosen = choose([[0.0]] * 4, [[1.0], [-2.0], [0.1]])
    assert chosen == [ExpressiveFrame(TEST, 2), ExpressiveFrame(TEST, 1, 0, -2.0)]


def test_without_expressions_nothing_is_chosen() -> None:
    assert choose([[0.3, 0.0]] * 4, [[0.3, 0.0]] * 3) == []
    assert expressive_frames((TEST,), (range(3),), (np.zeros((3, 0)),)) == []


@given(st.integers(0, 1000), st.integers(1, 12))
def test_the_coefficients_with_the_largest_range_are_shown_in_their_order(seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    values = generator.normal(0.0, 1.0, (7, count)) * generator.uniform(0.1, 5.0, count)
    chosen = expressive_frames((TRAIN, TEST), (range(4), range(3)), (values[:4], values[4:]))
    shown = [frame.coefficient for frame in chosen[1:]]
    assert shown == sorted(np.argsort(-np.ptp(values, axis=0))[:MOST_COEFFICIENTS].tolist())
    for frame in chosen[1:]:
        row = values[frame.segment.start + frame.index]
        assert frame.coefficient is not None
        assert frame.value == row[frame.coefficient]
        among = values[4:] if frame.segment is TEST else values
        assert abs(frame.value) == np.abs(among[:, frame.coefficient]).max()


def test_the_sheet_shows_truth_above_avatar(tmp_path: Path) -> None:
    capture = Capture.open(write_synthetic_capture(tmp_path / "capture", frames=4))
    sheet = ExpressionSheet(capture, capture.segments)
    for segment in capture.segments:
        for index in evaluated_indices(segment):
            colours = [torch.tensor(c).expand(3, 48, 48, 3) for c in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])]
            sheet(EvaluatedFrame(segment, index, colours[0], colours[1], colours[0]))
    assert sheet.write(tmp_path) == tmp_path / "expressions.png"
    shown = np.asarray(Image.open(tmp_path / "expressions.png")).astype(int)
    red, green = ((shown == colour).all(axis=-1) for colour in ([255, 0, 0], [0, 255, 0]))
    columns = 2  # neutral, and the one coefficient that varies
    assert red.sum() == green.sum() == columns * SIDE**2
    assert np.flatnonzero(red.any(axis=1)).max() < np.flatnonzero(green.any(axis=1)).min()
    np.testing.assert_array_equal(red.any(axis=0), green.any(axis=0))


@pytest.mark.parametrize("varies", [True, False])
def test_without_landmarks_or_expressions_there_is_no_sheet(tmp_path: Path, varies: bool) -> None:
    capture = StandInCapture(segments=(Segment("stop", 10, 4 if varies else 1, "test"),))
    sheet = ExpressionSheet(capture, capture.segments)
    black = torch.zeros(2, 32, 36, 3)
    for index in range(capture.segments[0].count):
        sheet(EvaluatedFrame(capture.segments[0], index, black, black, black))
    assert sheet.write(tmp_path) is None
    assert list(tmp_path.iterdir()) == []
