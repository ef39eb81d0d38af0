"""Strands that follow guides, and motion between frames."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.baselines.simulator_guides import GuideInterpolation, unkinked
from dynhair.baselines.simulator_motion import RigidMotion
from dynhair.strands import bending_angles
from dynhair.strands.spreading import farthest_points


def hairstyle(count: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    roots = torch.randn(count, 1, 3, generator=generator)
    return roots + torch.randn(count, 9, 3, generator=generator).cumsum(1) * 0.1


@given(st.integers(0, 1000), st.integers(1, 15))
def test_a_strands_displacement_is_a_convex_combination_of_its_nearest_guides(seed: int, nearest: int) -> None:
    strands = hairstyle(30, seed)
    guides = farthest_points(strands[:, 0], 12)
    interpolation = GuideInterpolation(strands, guides, nearest)
    assert interpolation.nearest.shape == (30, min(nearest, 12))
    assert (interpolation.weights >= 0).all()
    torch.testing.assert_close(interpolation.weights.sum(1), torch.ones(30))
    distance = torch.cdist(strands[:, 0], strands[guides, 0])
    chosen = distance.gather(1, interpolation.nearest)
    torch.testing.assert_close(chosen, distance.sort(1).values[:, : chosen.shape[1]])

    moved = hairstyle(12, seed + 1)[:, :1].expand(-1, 9, -1)
    displacement = interpolation(moved) - strands
    theirs = moved[interpolation.nearest]  # all of a guide moves alike
    assert (displacement <= theirs.amax(1) + 1e-5).all()
    assert (displacement >= theirs.amin(1) - 1e-5).all()


def test_guides_follow_themselves_alone_by_the_share_of_their_length() -> None:
    strands = hairstyle(30)
    guides = farthest_points(strands[:, 0], 12)
    moved = torch.randn(12, 5, 3, generator=torch.Generator().manual_seed(1))
    followed = (GuideInterpolation(strands, guides)(moved) - strands)[guides].numpy()
    for strand, given_by, displaced in zip(strands[guides].numpy(), moved.numpy(), followed, strict=True):
        along = np.concatenate([[0.0], np.linalg.norm(np.diff(strand, axis=0), axis=1).cumsum()])
        expected = [np.interp(along / along[-1], np.linspace(0.0, 1.0, 5), given_by[:, axis]) for axis in range(3)]
        np.testing.assert_allclose(displaced, np.stack(expected, 1), atol=2e-5)


def test_guides_at_rest_leave_the_hairstyle_as_it_is() -> None:
    strands = hairstyle(30)
    guides = farthest_points(strands[:, 0], 12)
    assert torch.equal(GuideInterpolation(strands, guides)(torch.zeros(12, 4, 3)), strands)


def test_only_kinked_guides_are_smoothed_and_keep_their_ends() -> None:
    straight = torch.linspace(0.0, 0.3, 16)[:, None] * torch.tensor([0.0, -1.0, 0.0])
    folded = straight.clone()
    folded[:2] = torch.tensor([[0.0, -0.06, 0.0], [0.0, -0.07, 0.0]])  # up from -0.07 to -0.04, after which it falls
    guides = torch.stack([straight, folded])
    smooth = unkinked(guides)
    assert bending_angles(guides)[1].max() > 3.0
    assert bending_angles(smooth).max() <= 1.0
    assert torch.equal(smooth[0], straight)
    assert torch.equal(smooth[:, [0, -1]], guides[:, [0, -1]])


def test_motion_goes_through_its_poses_with_a_steady_velocity() -> None:
    angles, fps = np.linspace(0.0, 1.0, 6), 10.0
    rotations = Rotation.from_euler("y", angles[:, None])
    translations = np.outer(np.linspace(0.0, 1.0, 6), [1.0, 0.5, 0.0])
    motion = RigidMotion(rotations.as_matrix(), translations, fps)
    for frame in range(6):
        rotation, translation = motion(frame / fps)
        np.testing.assert_allclose(rotation.as_matrix(), rotations[frame].as_matrix(), atol=1e-9)
        np.testing.assert_allclose(translation, translations[frame], atol=1e-9)
    rotation, translation = motion(0.25)  # a uniform turn and a uniform path stay so between
    assert rotation.magnitude() == pytest.approx(0.5)
    np.testing.assert_allclose(translation, [0.5, 0.25, 0.0], atol=1e-9)


def test_a_single_pose_is_kept() -> None:
    motion = RigidMotion(np.eye(3)[None], np.array([[1.0, 2.0, 3.0]]), 30.0)
    rotation, translation = motion(0.01)
    assert rotation.magnitude() == pytest.approx(0.0)
    np.testing.assert_allclose(translation, [1.0, 2.0, 3.0])
