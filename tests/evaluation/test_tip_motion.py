"""Speed and path of tips, in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dynhair.errors import DynhairError
from dynhair.evaluation.tip_motion import TipMotion


def test_tips_on_circles() -> None:
    radii, angle, fps = torch.tensor([0.1, 0.3]).double(), 0.2, 25.0
    motion = TipMotion(fps)
    for t in range(5):
        turn = torch.from_numpy(Rotation.from_euler("z", t * angle).as_matrix())
        motion.add(torch.stack([radii, 0 * radii, 0 * radii], dim=1) @ turn.T)
    assert math.isnan(motion.speeds[0])
    np.testing.assert_allclose(motion.speeds[1:], 0.2 * 2 * math.sin(angle / 2) * fps)
    times = angle * np.arange(5)
    np.testing.assert_allclose(motion.path, np.stack([0.2 * np.cos(times), 0.2 * np.sin(times), 0 * times], 1))


def test_tips_that_part_have_speed_but_their_mean_stays() -> None:
    motion = TipMotion(10.0)
    for t in range(3):
        motion.add(torch.tensor([[0.01 * t, 0.0, 0.0], [-0.01 * t, 0.0, 0.0]]))
    np.testing.assert_allclose(motion.speeds[1:], 0.1)
    np.testing.assert_allclose(motion.path, 0.0, atol=1e-12)


def test_nothing_yet_and_bad_input() -> None:
    motion = TipMotion(10.0)
    assert motion.speeds.shape == (0,)
    assert motion.path.shape == (0, 3)
    with pytest.raises(DynhairError, match="frame rate"):
        TipMotion(0.0)
