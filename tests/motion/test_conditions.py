"""Normalised conditions and their windows."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dynhair.config import DeformerConfig
from dynhair.errors import DynhairError
from dynhair.motion import HeadAtRest, MotionSignals, SignalNormalizer, motion_window, signal_names


def signals(count: int = 20, seed: int = 0, scale: float = 3.0) -> MotionSignals:
    generator = torch.Generator().manual_seed(seed)
    omega, alpha, gravity, rotation, translation, pull = torch.randn(6, count, 3, generator=generator)
    return MotionSignals(
        omega=scale * omega,
        alpha=10 * scale * alpha,
        gravity=torch.nn.functional.normalize(gravity, dim=-1),
        rotation=scale * rotation,
        translation=scale * translation + torch.tensor([1.0, 2.0, 3.0]),
        pull=scale * pull,
    )


def still() -> MotionSignals:
    rest = torch.zeros(4, 3)
    return MotionSignals(rest, rest, torch.tensor([[0.0, -1.0, 0.0]]).expand(4, 3), rest, rest, rest)


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
    conditions = SignalNormalizer.fit([still()])(still())
    assert conditions[:, :6].abs().max() == 0


def test_noise_on_a_still_axis_is_not_magnified() -> None:
    noise = signals(scale=1e-3)
    conditions = SignalNormalizer.fit([noise])(noise)
    assert conditions[:, :6].abs().max() < 0.1


@pytest.mark.parametrize(
    ("config", "names"),
    [
        (DeformerConfig(), ("omega", "alpha", "gravity")),
        (DeformerConfig(acceleration=False), ("omega", "gravity")),
        (DeformerConfig(gravity=False), ("omega", "alpha")),
        (DeformerConfig(kind="modal"), ("omega", "alpha", "pull")),
        (DeformerConfig(kind="modal", acceleration=False), ("omega", "pull")),
        (DeformerConfig(kind="strands"), ("omega", "alpha", "pull")),
        (DeformerConfig(turn=True), ("omega", "alpha", "gravity")),
        (DeformerConfig(signals="pose"), ("rotation", "translation", "gravity")),
        (DeformerConfig(signals="pose", gravity=False), ("rotation", "translation")),
    ],
    ids=[
        "paper",
        "no acceleration",
        "no gravity",
        "modes",
        "modes, no acceleration",
        "strands",
        "paper, turn",
        "pose",
        "pose alone",
    ],
)
def test_conditions_hold_what_is_chosen_and_nothing_else(config: DeformerConfig, names: tuple[str, ...]) -> None:
    train = signals()
    normalizer = SignalNormalizer.fit([train], config)
    conditions = normalizer(train)
    assert signal_names(config) == names
    assert conditions.shape == (20, 3 * len(names))
    for field in fields(MotionSignals):
        other = replace(train, **{field.name: signals(seed=1).gravity})
        seen = not torch.equal(normalizer(other), conditions)
        assert seen == (field.name in names), field.name


def test_poses_fill_the_range_about_the_mean_position() -> None:
    train = signals()
    conditions = SignalNormalizer.fit([train], DeformerConfig(signals="pose"))(train)
    torch.testing.assert_close(conditions[:, :3], train.rotation / train.rotation.abs().amax(0))
    centred = train.translation - train.translation.mean(0)
    torch.testing.assert_close(conditions[:, 3:6], centred / centred.abs().amax(0))
    torch.testing.assert_close(conditions[:, 6:], train.gravity)


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
    assert motion_window(conditions, 0, 2)[:, 0].tolist() == [0, 0, 0]


@pytest.mark.parametrize("frame", [-1, 5])
def test_frames_outside_the_segment_are_refused(frame: int) -> None:
    with pytest.raises(IndexError, match="5 frames"):
        motion_window(torch.zeros(5, 9), frame, 2)


def test_a_pull_counts_in_gravities_from_that_at_rest_and_is_not_clamped() -> None:
    train, rest = signals(scale=30.0), HeadAtRest(torch.eye(3), torch.tensor([0.0, -9.0, 3.0]))
    conditions = SignalNormalizer.fit([train], DeformerConfig(kind="modal"), rest)(train)
    torch.testing.assert_close(conditions[:, 6:], (train.pull - rest.pull) / 9.81)
    by_default = SignalNormalizer.fit([train], DeformerConfig(kind="modal"))(train)
    assert by_default[0, 6:].abs().max() == 0


def test_a_turn_counts_from_rest_in_the_heads_frame() -> None:
    rest, turns = Rotation.from_rotvec([0.3, -0.5, 0.2]), Rotation.from_rotvec(0.4 * np.eye(3))
    pose = replace(signals(3), rotation=torch.from_numpy((rest * turns).as_rotvec()).float())
    config = DeformerConfig(kind="modal", gravity=False, turn=True)
    resting = HeadAtRest(torch.from_numpy(rest.as_matrix()).float(), torch.zeros(3))
    assert signal_names(config) == ("omega", "alpha", "turn")
    torch.testing.assert_close(
        SignalNormalizer.fit([pose], config, resting)(pose)[:, 6:], torch.eye(3), atol=1e-5, rtol=0
    )
    by_default = SignalNormalizer.fit([pose], config)(pose)[:, 6:]
    assert by_default[0].abs().max() < 1e-5
    expected = (turns[0].inv() * turns).as_rotvec()
    largest = np.maximum(np.abs(expected).max(0), 0.05)
    np.testing.assert_allclose(by_default.numpy(), expected / largest, atol=1e-4)
