"""The study's head motions: from rest, different from one another, and always the same."""

from __future__ import annotations

import numpy as np
import pytest
from studies.hair_motion.motions import ELEVEN, MORE, UNSEEN, head_motion, smooth_step

from dynhair.animation.procedural import PIVOT
from dynhair.errors import DynhairError


@pytest.mark.parametrize("name", [*ELEVEN, MORE[0], *UNSEEN])
def test_a_motion_begins_at_rest_and_turns_about_the_neck(name: str) -> None:
    motion = head_motion(name)
    np.testing.assert_allclose(motion.rotations[0], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(
        motion.rotations @ motion.rotations.swapaxes(1, 2), np.eye(3)[None].repeat(75, 0), atol=1e-12
    )
    assert np.abs(motion.rotations[1] - np.eye(3)).max() < 0.02
    assert np.abs(motion.rotations - np.eye(3)).max() > 0.05
    pivot = motion.rotations @ PIVOT + motion.translations - motion.sway
    np.testing.assert_allclose(pivot, PIVOT[None].repeat(75, 0), atol=1e-12)


def test_what_is_learned_from_is_never_unseen_and_no_two_are_alike() -> None:
    names = (*ELEVEN, *MORE, *UNSEEN)
    assert len(set(names)) == len(names) == 46
    motions = {name: head_motion(name) for name in names}
    for index, one in enumerate(names):
        for other in names[index + 1 :]:
            apart = np.abs(motions[one].rotations - motions[other].rotations).max()
            assert max(apart, np.abs(motions[one].sway - motions[other].sway).max()) > 0.02, (one, other)


def test_a_sudden_stop_stops() -> None:
    motion = head_motion("stop")
    turned = np.degrees(np.arctan2(motion.rotations[:, 0, 2], motion.rotations[:, 0, 0]))
    assert turned.min() == pytest.approx(-32, abs=0.5)
    assert turned[33:51] == pytest.approx(38, abs=0.5)


@pytest.mark.parametrize("name", ["", "random", "randomx", "random-1", "dance"])
def test_a_motion_that_is_not_known_is_refused(name: str) -> None:
    with pytest.raises(DynhairError, match="no motion is called"):
        head_motion(name)


def test_a_smooth_step_has_no_jolt_at_either_end() -> None:
    times = np.linspace(0, 1, 1001)
    step = smooth_step(times, 0.2, 0.7)
    assert step[:201].max() < 1e-12
    assert step[700:].min() > 1 - 1e-12
    assert np.abs(np.gradient(np.gradient(step, times), times)).max() < 1.05 * 10 / np.sqrt(3) / 0.5**2
