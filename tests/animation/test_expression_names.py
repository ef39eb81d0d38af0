"""Expressions that mean the same under other names: two halves of a face, and what common words stand for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynhair.animation.expression_names import name_weights
from dynhair.face import open_head
from dynhair.preprocess.landmarks import BLENDSHAPE_NAMES

HALVES = ("mouthSmileLeft", "mouthSmileRight", "eyeBlinkLeft", "eyeBlinkRight", "browInnerUp")


def given_to(target: str, *sources: str) -> dict[str, float]:
    (row,) = name_weights(sources, [target])
    return {source: float(weight) for source, weight in zip(sources, row, strict=True) if weight}


@pytest.mark.parametrize("name", ["eyeBlinkLeft", "EyeBlink_L", "eye blink left", "eye-blink-l", "eyeBlinkL"])
def test_a_name_is_the_same_however_it_is_spelt(name: str) -> None:
    assert given_to(name, "eyeBlinkRight", "eyeBlinkLeft") == {"eyeBlinkLeft": 1.0}
    assert given_to("eyeBlinkLeft", "eyeBlink_R", name) == {name: 1.0}


@pytest.mark.parametrize("target", ["blink", "eyeBlink", "Eye Blink"])
def test_what_has_two_sides_is_the_mean_of_a_left_and_a_right_one(target: str) -> None:
    assert given_to(target, *HALVES) == {"eyeBlinkLeft": 0.5, "eyeBlinkRight": 0.5}


def test_what_has_two_sides_drives_each() -> None:
    givers = ("smile", "smile", "blink", "blink", "brow_up")
    for target, giver in zip(HALVES, givers, strict=True):
        assert given_to(target, "jaw_open", "smile", "blink", "brow_up") == {giver: 1.0}


def test_half_a_face_does_not_drive_the_whole() -> None:
    assert given_to("smile", "mouthSmileLeft", "eyeBlinkLeft") == {}
    assert given_to("brow_up", "browInnerUp") == {}
    assert given_to("mouthSmileRight", "mouthSmileLeft") == {}


def test_brows_go_up_within_and_without() -> None:
    found = given_to("brow_up", "browInnerUp", "browOuterUpLeft", "browOuterUpRight", "browDownLeft")
    assert found == {"browInnerUp": 0.5, "browOuterUpLeft": 0.25, "browOuterUpRight": 0.25}
    assert given_to("browInnerUp", "browInnerUp_L", "browInnerUp_R") == {"browInnerUp_L": 0.5, "browInnerUp_R": 0.5}


def test_left_and_right_may_be_directions() -> None:
    assert given_to("jaw", "jawLeft", "jawRight") == {}
    assert given_to("jawLeft", "jawRight", "jaw") == {}
    assert given_to("jaw_left", "jawRight", "jawLeft") == {"jawLeft": 1.0}


def test_letters_that_end_a_word_are_no_sides() -> None:
    assert given_to("mouthFunnel", "mouthFunne", "mouthShrugUpper") == {}
    assert given_to("mouthFunnel", "mouthFunne", "mouth funnel") == {"mouth funnel": 1.0}


def test_the_same_name_comes_before_the_same_meaning() -> None:
    assert given_to("smile", "mouthSmile", "mouthSmileLeft", "mouthSmileRight", "Smile") == {"Smile": 1.0}
    assert given_to("smile", "mouthSmileLeft", "mouthSmileRight", "mouthSmile") == {"mouthSmile": 1.0}
    assert given_to("smile_left", "smile", "mouthSmileLeft") == {"mouthSmileLeft": 1.0}


def test_the_open_head_takes_what_the_detector_says_one_by_one() -> None:
    sources, targets = tuple(BLENDSHAPE_NAMES), open_head().expression_names
    weights = name_weights(sources, targets)
    for row, target in zip(weights, targets, strict=True):
        assert row.max() == (target in sources)
        assert target not in sources or sources[int(row.argmax())] == target


words = st.sampled_from(["smile", "blink", "brow_up", "jawOpen", "jawLeft", "", "l", "_", "left"]) | st.text(max_size=5)
names = st.lists(words, max_size=6)


@given(sources=names, targets=names)
def test_what_is_taken_is_a_mean_and_nothing_has_no_name(sources: list[str], targets: list[str]) -> None:
    weights = name_weights(sources, targets)
    assert weights.shape == (len(targets), len(sources))
    sums = weights.sum(axis=1)
    assert (np.isclose(sums, 1) | (sums == 0)).all()
    for place, source in enumerate(sources):
        assert source or not weights[:, place].any()
    for row, target in zip(weights, targets, strict=True):
        named = any(letter.isascii() and letter.isalnum() for letter in target.lower())
        assert row.any() or not named or target not in sources
        assert named or not row.any()
