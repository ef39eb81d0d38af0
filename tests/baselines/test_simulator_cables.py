"""Cables against closed forms. Newton's kernels are compiled on first use, which takes a minute."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.special import jn_zeros
from simulated_heads import GRAVITY, HEAD_RADIUS, POINTS, ball, standing, straight

from dynhair.baselines.cables import CableParameters, Cables, Part
from dynhair.baselines.simulator_motion import RigidMotion
from dynhair.errors import DynhairError
from dynhair.strands import MeshDistance

LIMP = replace(CableParameters(), young=4e6, attraction=0.0)  # bends within millimetres under its own weight


def lengths(strands: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(strands, axis=1), axis=-1).sum(1)


@pytest.mark.slow
def test_a_limp_cable_hangs_below_its_root() -> None:
    cables = Cables(straight((1.0, 0.0, 0.0)), [], LIMP, GRAVITY)
    strands = next(cables.simulate([standing()], settle=6.0))
    clamped = 0.3 / (POINTS - 1)
    np.testing.assert_allclose(strands[0, 0], [0.0, 0.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(strands[0, 1], [clamped, 0.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(strands[0, -1], [clamped, clamped - 0.3, 0.0], atol=0.02)
    np.testing.assert_allclose(lengths(strands), 0.3, rtol=0.04)


@pytest.mark.slow
def test_without_gravity_a_moved_head_takes_its_curled_hair_along_unchanged() -> None:
    along = np.linspace(0.0, 4.0, POINTS)
    curl = np.stack([0.02 * np.cos(along), -0.02 * along, 0.02 * np.sin(along)], -1)[None]
    turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    motion = RigidMotion(turned[None], np.array([[0.1, 0.2, 0.3]]), 30.0)
    strands = next(Cables(curl, [], CableParameters(), np.zeros(3)).simulate([motion], settle=0.2))
    np.testing.assert_allclose(strands, curl @ turned.T + [0.1, 0.2, 0.3], atol=1e-4)


@pytest.mark.slow
def test_a_small_swing_has_the_frequency_of_a_hanging_chain() -> None:
    """Daniel Bernoulli's: the lowest is ``j / 2 sqrt(g / l)``, with ``j`` the first zero of the Bessel function J0."""
    frames, fps, length = 120, 30.0, 0.3
    shift = np.zeros((frames, 3))
    shift[:, 0] = 0.01 * (1.0 - np.exp(-np.arange(frames)))
    motion = RigidMotion(np.tile(np.eye(3), (frames, 1, 1)), shift, fps)
    parameters = replace(LIMP, drag=0.0, relaxation=0.0)
    cables = Cables(straight((0.0, -1.0, 0.0), length), [], parameters, GRAVITY)
    swing = np.array([strands[0, -1, 0] for strands in cables.simulate([motion])]) - shift[:, 0]
    spectrum = np.abs(np.fft.rfft((swing - swing.mean()) * np.hanning(frames), n=4096))
    free = length * (POINTS - 2) / (POINTS - 1)
    expected = jn_zeros(0, 1)[0] / 2 * np.sqrt(9.81 / free) / (2 * np.pi)
    assert np.fft.rfftfreq(4096, 1 / fps)[spectrum.argmax()] == pytest.approx(expected, rel=0.05)


@pytest.mark.slow
def test_attraction_holds_the_hair_in_place() -> None:
    rest = straight((1.0, 0.0, 0.0))
    held = replace(CableParameters(), attraction=40.0)
    strands = next(Cables(rest, [], held, GRAVITY).simulate([standing()]))
    # a segment that is held alone sinks by g / attraction^2
    sunk = (rest - strands)[0, -POINTS // 2 :, 1]
    np.testing.assert_allclose(sunk, 9.81 / 40.0**2, rtol=0.3)


@pytest.mark.slow
def test_hair_rests_on_the_head() -> None:
    """Cables from the crown of a ball fall onto it and hang down its sides."""
    angles = np.linspace(0.0, 2 * np.pi, 5)[:-1]
    outwards = np.stack([np.cos(angles), np.zeros(4), np.sin(angles)], -1)
    root = np.array([0.0, HEAD_RADIUS + 1e-3, 0.0])
    rest = root + np.linspace(0.0, 0.25, POINTS)[None, :, None] * outwards[:, None]
    parameters = replace(CableParameters(), young=4e8, attraction=0.0)
    cables = Cables(rest, [ball()], parameters, GRAVITY)
    strands = next(cables.simulate([standing()]))
    part = ball()
    mesh = MeshDistance(torch.from_numpy(part.vertices).float(), torch.from_numpy(part.faces))
    distance = mesh.query(torch.from_numpy(strands).float().flatten(0, 1))[0]
    assert distance.min() > -2e-3
    assert strands[:, -1, 1].max() < 0.0  # the tips are below the ball's centre


@pytest.mark.parametrize("rest", [straight((1.0, 0.0, 0.0), points=2), np.zeros((1, 5, 3))])
def test_what_is_no_cable_is_refused(rest: np.ndarray) -> None:
    with pytest.raises(DynhairError, match="too short"):
        Cables(rest, [Part(np.zeros((3, 3)), np.array([[0, 1, 2]]))], CableParameters(), GRAVITY)


def test_bending_stiffness_is_that_of_a_round_rod() -> None:
    hair = CableParameters()
    area, second_moment = np.pi * hair.radius**2, np.pi * hair.radius**4 / 4
    assert hair.bending == pytest.approx(hair.young * second_moment / (hair.density * area))
