from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from landmark_stand_ins import disc_image, disc_networks

from dynhair.preprocess.landmarks.detector import (
    FaceBox,
    decode_boxes,
    overlap,
    search_faces,
    search_windows,
    suppress_overlaps,
)
from dynhair.preprocess.landmarks.square import FaceSquare


def box(score: float, x: float, y: float, width: float = 10, height: float = 10) -> FaceBox:
    return FaceBox(float(score), np.array([x, y], float), np.array([width, height], float), np.full((6, 2), float(x)))


def answer(index: int) -> tuple[np.ndarray, np.ndarray]:
    """One box of 64 x 32 px, 12.8 px right of its cell's centre and 6.4 px above, keypoints in a row to the right."""
    regressors, logits = np.zeros((896, 16)), np.full(896, -200.0)
    regressors[index] = [12.8, -6.4, 64, 32, *(v for k in range(6) for v in (12.8 * k, 0))]
    logits[index] = 0.0
    return regressors, logits


@pytest.mark.parametrize(
    ("index", "cell"),
    [
        (0, (0.5 / 16, 0.5 / 16)),
        (1, (0.5 / 16, 0.5 / 16)),
        (2, (1.5 / 16, 0.5 / 16)),
        (2 * 16 * 3 + 2 * 5, (5.5 / 16, 3.5 / 16)),
        (511, (15.5 / 16, 15.5 / 16)),
        (512, (0.5 / 8, 0.5 / 8)),
        (512 + 6 * (8 * 2 + 1) + 5, (1.5 / 8, 2.5 / 8)),
        (895, (7.5 / 8, 7.5 / 8)),
    ],
)
def test_decoding_one_box(index: int, cell: tuple[float, float]):
    (found,) = decode_boxes(*answer(index), FaceSquare((0.5, 0.5), 1.0))
    assert found.score == 0.5
    np.testing.assert_allclose(found.centre, [cell[0] + 0.1, cell[1] - 0.05])
    np.testing.assert_allclose(found.size, [0.5, 0.25])
    np.testing.assert_allclose(found.keypoints[:, 0], cell[0] + 0.1 * np.arange(6))
    np.testing.assert_allclose(found.keypoints[:, 1], cell[1])


def test_boxes_lie_in_their_window():
    (found,) = decode_boxes(*answer(2), FaceSquare((140.0, 80.0), 40.0))
    np.testing.assert_allclose(found.centre, [120 + 40 * (1.5 / 16 + 0.1), 60 + 40 * (0.5 / 16 - 0.05)])
    np.testing.assert_allclose(found.size, [20, 10])


def test_huge_logits_do_not_overflow():
    regressors, logits = np.zeros((896, 16), np.float32), np.full(896, -1e4, np.float32)
    logits[7] = 1e4
    assert [found.score for found in decode_boxes(regressors, logits, FaceSquare((0.0, 0.0), 1.0))] == [1.0]


def test_square_of_a_box_turns_with_the_eyes():
    keypoints = np.array([[10, 10], [20, 20], [0, 0], [0, 0], [0, 0], [0, 0]], float)
    square = FaceBox(1.0, np.array([15.0, 17.0]), np.array([20.0, 24.0]), keypoints).square
    assert (square.centre, square.side, square.angle) == ((15, 17), pytest.approx(36), pytest.approx(np.pi / 4))


def test_overlap():
    assert overlap(box(1, 0, 0), box(1, 0, 0)) == pytest.approx(1)
    assert overlap(box(1, 0, 0), box(1, 5, 0)) == pytest.approx(1 / 3)
    assert overlap(box(1, 0, 0), box(1, 10, 0)) == 0
    assert overlap(box(1, 0, 0), box(1, 0, 0, 5, 5)) == pytest.approx(1 / 4)


def test_overlapping_boxes_are_averaged_by_score():
    kept = suppress_overlaps([box(0.6, 3, 0), box(0.9, 0, 0), box(0.7, 50, 50)])
    assert [found.score for found in kept] == [0.9, 0.7]
    np.testing.assert_allclose(kept[0].centre, [3 * 0.6 / 1.5, 0])
    np.testing.assert_allclose(kept[1].centre, [50, 50])
    assert suppress_overlaps([]) == []


@given(st.lists(st.tuples(st.floats(0.5, 1), st.floats(0, 40), st.floats(0, 40)), max_size=12))
def test_suppression_keeps_the_surest_and_loses_no_face(rows: list[tuple[float, float, float]]):
    boxes = [box(*row) for row in rows]
    kept = suppress_overlaps(boxes)
    scores = [found.score for found in kept]
    assert scores == sorted(scores, reverse=True)
    assert max(scores, default=0) == max((row[0] for row in rows), default=0)
    for one in boxes:  # each is kept or lies within reach of one that is
        assert any(np.abs(one.centre - found.centre).max() < 10 for found in kept)


@given(st.integers(20, 3000), st.integers(20, 3000))
def test_windows_cover_the_image(width: int, height: int):
    levels = list(search_windows(width, height))
    assert len(levels) == 5
    assert levels[0][0].side == max(width, height)
    assert levels[-1][0].side == pytest.approx(max(width, height) / 4)
    for windows in levels:
        side = windows[0].side
        for axis, length in enumerate((width, height)):
            lows = sorted({window.centre[axis] - side / 2 for window in windows})
            assert lows[0] <= 1e-6
            assert lows[-1] + side >= length - 1e-6
            assert (np.diff(lows) <= side / 2 + 1e-6).all()


def test_a_small_face_is_found_in_a_small_window():
    image = disc_image((150, 40), 10)
    found = next(search_faces(disc_networks().boxes, image))
    np.testing.assert_allclose(found.centre, [150, 40], atol=1)
    np.testing.assert_allclose(found.size, 20, atol=2)


def test_a_large_face_needs_one_look():
    calls: list[str] = []
    next(search_faces(disc_networks(calls).boxes, disc_image((100, 80), 40)))
    assert calls == ["boxes"]


def test_nothing_to_be_found():
    assert list(search_faces(disc_networks().boxes, np.zeros((50, 70, 3), np.uint8))) == []
