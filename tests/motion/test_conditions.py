"""Normalised conditions and their windows."""

from __future__ import annotations

import pytest
import torch

from dynhair.errors import DynhairError
from dynhair.motion import MotionSignals, SignalNormalizer, motion_window, motion_windows


def signals(count: int = 20, seed: int = 0, scale: float = 3.0) -> MotionSignals:
    generator = torch.Generator().manual_seed(seed)
    omega, alpha, gravity = torch.randn(3, count, 3, generator=generator)
    return MotionSignals(scale * omega, 10 * scale * alpha, torch.nn.functional.normalize(gravity, dim=-1))


def test_the_training_set_fills_the_range_of_every_axis() -> None:
    train = [signals(seed=0), signals(seed=1)]
    normalizer = SignalNormalizer.fit(train)
    conditions = torch.cat([normalizer(s) for s in train])
    assert conditions.shape == (40, 9)
    torch.testing.assert_close(conditions[:, :6].abs().amax(dim=0), torch.ones(6))


def test_conditions_are_the_signals_over_their_maxima_then_gravity() -> None:
    train = signals()
    conditions = SignalNormalizer.fit([train])(train)
    torch.testing.assert_close(conditions[:, :3], train.omega / train.omega.abs().amax(dim=0))
    torch.testing.assert_close(conditions[:, 3:6], train.alpha / train.alpha.abs().amax(dim=0))
    torch.testing.assert_close(conditions[:, 6:], train.gravity)


def test_faster_motion_than_in_training_is_clamped() -> None:
    conditions = SignalNormalizer.fit([signals()])(signals(seed=2, scale=30.0))
    assert conditions.abs().max() <= 1


def test_an_axis_that_never_moves_stays_at_zero() -> None:
    still = MotionSignals(torch.zeros(4, 3), torch.zeros(4, 3), torch.tensor([[0.0, -1.0, 0.0]]).expand(4, 3))
    conditions = SignalNormalizer.fit([still])(still)
    assert conditions[:, :6].abs().max() == 0


def test_noise_on_a_still_axis_is_not_magnified() -> None:
    noise = signals(scale=1e-3)
    conditions = SignalNormalizer.fit([noise])(noise)
    assert conditions[:, :6].abs().max() < 0.1


def test_the_state_survives_saving() -> None:
    fitted, fresh = SignalNormalizer.fit([signals()]), SignalNormalizer()
    assert set(fitted.state_dict()) == {"omega_max", "alpha_max"}
    fresh.load_state_dict(fitted.state_dict())
    torch.testing.assert_close(fresh(signals(seed=3)), fitted(signals(seed=3)))


def test_fitting_to_nothing_is_refused() -> None:
    with pytest.raises(DynhairError, match="no motion"):
        SignalNormalizer.fit([])


def test_windows_end_at_their_frame_and_repeat_the_first() -> None:
    conditions = torch.arange(5.0)[:, None].expand(5, 9)
    assert motion_window(conditions, 4, 2)[:, 0].tolist() == [2, 3, 4]
    assert motion_window(conditions, 1, 3)[:, 0].tolist() == [0, 0, 0, 1]
    assert motion_window(conditions, 3, 0)[:, 0].tolist() == [3]
    assert motion_windows(conditions, [0, 4], 2)[..., 0].tolist() == [[0, 0, 0], [2, 3, 4]]


@pytest.mark.parametrize("frame", [-1, 5])
def test_frames_outside_the_segment_are_refused(frame: int) -> None:
    with pytest.raises(IndexError, match="5 frames"):
        motion_window(torch.zeros(5, 9), frame, 2)
