"""What is explained, and mirrored motions, against their definitions."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from made_motions import hanging, made_motion
from studies.hair_motion.motions import FPS, head_motion
from studies.hair_motion.recordings import GRAVITY, explained, mean_explained, mirrored, recorded

from dynhair.capture import HeadTrack
from dynhair.motion import MotionSignals, motion_signals

FLIP = np.diag([-1.0, 1.0, 1.0])


def test_rigid_hair_explains_nothing_and_the_truth_everything() -> None:
    true = made_motion("turn").displacements
    assert explained(torch.zeros_like(true), true) == pytest.approx(0, abs=1e-6)
    assert explained(true, true) == 1


@given(st.floats(-1, 2))
def test_a_share_of_the_motion_explains_that_share(share: float) -> None:
    true = made_motion("nod").displacements
    assert explained(share * true, true) == pytest.approx(1 - abs(1 - share), abs=1e-5)


def test_motions_count_alike_however_large() -> None:
    true = made_motion("turn").displacements
    assert mean_explained([(0.5 * true, true), (0 * true, 0.01 * true)]) == pytest.approx(0.25, abs=1e-5)


def test_hair_that_does_not_move_cannot_be_explained() -> None:
    with pytest.raises(ValueError, match="does not move"):
        explained(torch.zeros(2, 3, 4, 3), torch.zeros(2, 3, 4, 3))


@pytest.mark.parametrize("name", ["random1", "lateral", "tilt-stop"])
def test_mirroring_twice_changes_nothing(name: str) -> None:
    motion = made_motion(name)
    again = mirrored(mirrored(motion))
    torch.testing.assert_close(again.displacements, motion.displacements, rtol=0, atol=0)
    torch.testing.assert_close(again.canonical, motion.canonical, rtol=0, atol=0)
    for field in fields(MotionSignals):
        torch.testing.assert_close(getattr(again.signals, field.name), getattr(motion.signals, field.name))


@pytest.mark.parametrize("name", ["random1", "lateral", "tilt-stop"])
def test_mirrored_signals_are_those_of_the_mirrored_head(name: str) -> None:
    head = head_motion(name)
    track = HeadTrack(
        rotations=FLIP @ head.rotations @ FLIP,
        translations=head.translations @ FLIP,
        expressions=np.zeros((75, 0), np.float32),
        fps=FPS,
        gravity=GRAVITY,
    )
    expected, found = motion_signals(track), mirrored(made_motion(name)).signals
    for field in fields(MotionSignals):
        torch.testing.assert_close(getattr(found, field.name), getattr(expected, field.name), rtol=1e-4, atol=1e-4)


def test_inertia_commutes_with_the_mirror() -> None:
    motion = made_motion("random2")

    def felt(signals: MotionSignals, x: torch.Tensor) -> torch.Tensor:
        omega, alpha = (part[:, None].expand(-1, len(x), -1) for part in (signals.omega, signals.alpha))
        arms = x[None].expand_as(omega)
        turning = torch.linalg.cross(omega, torch.linalg.cross(omega, arms))
        return signals.pull[:, None] - torch.linalg.cross(alpha, arms) - turning

    places = hanging()[:, -1]
    other = mirrored(motion)
    flip = torch.tensor([-1.0, 1.0, 1.0])
    torch.testing.assert_close(felt(other.signals, places * flip), felt(motion.signals, places) * flip)


def test_a_file_is_read_as_displacements_from_its_first_frame(tmp_path: Path) -> None:
    head = head_motion("turn", 4)
    guides = np.random.default_rng(0).normal(size=(4, 2, 3, 3)).astype(np.float32)
    np.savez(tmp_path / "turn.npz", guides=guides, rotations=head.rotations, translations=head.translations)
    motion = recorded(tmp_path / "turn.npz")
    assert motion.name == "turn"
    np.testing.assert_array_equal(motion.canonical, guides[0])
    np.testing.assert_allclose(motion.displacements, guides - guides[0])
    assert motion.signals.pull[0].tolist() == pytest.approx([0, -9.81, 0], abs=0.3)
