"""A driver's motion and cameras, moved to another head's rest pose."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from dynhair.camera import Camera
from dynhair.capture import HeadTrack
from dynhair.motion import RestAlignment


def _random_track(generator: np.random.Generator) -> HeadTrack:
    return HeadTrack(
        rotations=Rotation.random(5, rng=generator).as_matrix(),
        translations=generator.normal(size=(5, 3)),
        expressions=np.zeros((5, 0), np.float32),
        fps=25.0,
        gravity=np.array([0.0, -9.81, 0.0]),
    )


def test_the_driver_at_rest_takes_the_own_rest_pose_and_moves_rigidly_from_there() -> None:
    generator = np.random.default_rng(0)
    track = _random_track(generator)
    own = Rotation.random(rng=generator).as_matrix(), generator.normal(size=3)
    moved = RestAlignment.between((track.rotations[2], track.translations[2]), own).track(track)
    np.testing.assert_allclose(moved.rotations[2], own[0], atol=1e-12)
    np.testing.assert_allclose(moved.translations[2], own[1], atol=1e-12)
    for before, after in ((track, moved), (moved, track)):
        relative = before.rotations[2].T @ before.rotations, after.rotations[2].T @ after.rotations
        np.testing.assert_allclose(*relative, atol=1e-12)
    steps = [
        np.einsum("ji,fj->fi", each.rotations[2], each.translations - each.translations[2]) for each in (track, moved)
    ]
    np.testing.assert_allclose(*steps, atol=1e-12)


def test_an_aligned_camera_sees_the_driven_head_as_the_drivers_sees_the_driver() -> None:
    generator = np.random.default_rng(1)
    track = _random_track(generator)
    own = Rotation.random(rng=generator).as_matrix(), generator.normal(size=3)
    alignment = RestAlignment.between((track.rotations[0], track.translations[0]), own)
    view = np.column_stack([Rotation.random(rng=generator).as_matrix(), [0.1, -0.2, 4.0]])
    K = torch.tensor([[80.0, 0, 20], [0, 80, 16], [0, 0, 1]])
    camera = Camera(torch.from_numpy(view).float(), K, 40, 32)
    points = generator.normal(size=(7, 3))
    seen = [
        view_of.project(torch.from_numpy(points @ head.rotations[3].T + head.translations[3]).float())[0]
        for view_of, head in ((camera, track), (alignment.camera(camera), alignment.track(track)))
    ]
    torch.testing.assert_close(*seen, rtol=1e-3, atol=1e-3)
