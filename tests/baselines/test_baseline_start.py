"""Where the baselines begin: on the mesh as a track drives it, and in the hair's volume."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from dynhair.avatar import head_pose
from dynhair.baselines.driven_mesh import DrivenMesh
from dynhair.baselines.hair_volume import hair_points
from dynhair.baselines.start import hair_gaussians, start_bound_gaussians, start_gaussian_head_avatar
from dynhair.capture import Capture
from dynhair.config import Config, HairConfig, HeadConfig, TrainingConfig
from dynhair.errors import DynhairError
from dynhair.training.rest_scene import RestScene
from synthetic import write_synthetic_capture

CONFIG = Config(
    hair=HairConfig(strands=40, points=6),
    head=HeadConfig(gaussians=500, mouth_gaussians=30, features=4, deformation_width=8, appearance_width=8),
    training=TrainingConfig(precision="float32"),
)
HAIR = 200


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    path = tmp_path_factory.mktemp("data") / "capture"
    return Capture.open(write_synthetic_capture(path, frames=6, views=3, size=48, static_views=6))


@pytest.fixture(scope="module")
def scene(capture: Capture) -> RestScene:
    return RestScene.of(capture, 48)


def test_the_driven_mesh_is_the_tracked_one_in_motions_that_it_never_saw(capture: Capture) -> None:
    mesh = DrivenMesh.tracked(capture)
    for segment in capture.segments:
        for index in range(segment.count):
            with torch.no_grad():
                driven = mesh(head_pose(capture.track(segment), index))
            tracked = torch.from_numpy(capture.vertices(segment.start + index))
            assert (driven - tracked).norm(dim=1).max() < 2e-4  # the ridge holds back two per cent of 12 mm


def test_points_of_the_hair_are_hair_in_the_views_that_see_them(scene: RestScene) -> None:
    points = hair_points(scene, 500, 0)
    assert points.positions.shape == (500, 3)
    covered = torch.zeros(500)
    for camera, hair in zip(scene.views.cameras, scene.views.hair, strict=True):
        column, row = camera.project(points.positions)[0].long().unbind(1)
        covered += hair[row.clamp(0, 47), column.clamp(0, 47)] > 0.5
    assert covered.min() >= 2
    assert covered.mean() > 0.6 * len(scene.views.cameras)  # the head hides some from some
    brown = torch.tensor([96.0, 62.0, 36.0]) / 255
    assert (points.colours.mean(0) - brown).abs().max() < 0.1


def test_points_of_the_hair_depend_on_the_seed_alone(scene: RestScene) -> None:
    one, same, other = (hair_points(scene, 100, seed).positions for seed in (0, 0, 1))
    assert torch.equal(one, same)
    assert not torch.equal(one, other)


def test_views_that_agree_on_no_hair_are_refused(scene: RestScene) -> None:
    views = replace(scene.views, hair=torch.zeros_like(scene.views.hair))
    with pytest.raises(DynhairError, match="agree on 0 of 100 places"):
        hair_points(replace(scene, views=views), 100, 0)


def test_both_begin_with_the_same_gaussians(capture: Capture) -> None:
    assert hair_gaussians(CONFIG) == HAIR
    pose = head_pose(capture.track(capture.segments[0]), 0)
    with torch.no_grad():
        bound = start_bound_gaussians(capture, CONFIG).posed(pose)
        free = start_gaussian_head_avatar(capture, CONFIG).posed(pose)
    assert 500 + HAIR <= len(bound.means) == len(free.means) <= 530 + HAIR

    def lowest_first(means: torch.Tensor) -> torch.Tensor:
        return means[means[:, 1].argsort(stable=True)]

    # the free ones are moved by networks that have next to nothing to say yet
    assert (lowest_first(bound.means) - lowest_first(free.means)).abs().median() < 1e-4


def test_hair_begins_rigid_with_the_head(capture: Capture) -> None:
    segment = capture.segments[0]
    track = capture.track(segment)
    head = start_bound_gaussians(capture, CONFIG)
    with torch.no_grad():
        local = []
        for index in (0, 4):
            pose = head_pose(track, index)
            local.append((head.posed(pose).means[-HAIR:] - pose.translation) @ pose.rotation)
    torch.testing.assert_close(local[0], local[1], atol=2e-5, rtol=0)


def test_the_free_gaussians_lie_in_one_piece_for_each_network(capture: Capture) -> None:
    head = start_gaussian_head_avatar(capture, CONFIG).head
    assert (head.expression_weight.diff() <= 0).all()
    assert head.follow.max() > 0.99
    assert head.means[head.modes.rows].shape[0] == head.modes.offsets.shape[1] > 0
    # what the expression moves by itself is skin near the landmarks
    assert (head.expression_weight[head.modes.rows] > 0).all()


def test_a_capture_without_hair_is_refused(tmp_path: Path) -> None:
    path = write_synthetic_capture(tmp_path / "c", frames=2, views=2, size=16)
    for mask in path.glob("**/hair_*.png"):
        mask.unlink()
    with pytest.raises(DynhairError, match="hair mask"):
        start_gaussian_head_avatar(Capture.open(path), CONFIG)
