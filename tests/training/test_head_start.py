"""The head's start on the tracked surface."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from meshless import write_meshless_capture

from dynhair.avatar import Head, head_pose
from dynhair.capture import Capture, Segment
from dynhair.config import HeadConfig
from dynhair.strands import Roots
from dynhair.training.frames import head_frame, training_segments
from dynhair.training.head_start import (
    mouth_points,
    start_head,
    surface_points,
    tracked_modes,
)
from dynhair.training.surface import TrackedSurface, tracked_surface
from synthetic import write_synthetic_capture

CONFIG = HeadConfig(gaussians=600, mouth_gaussians=40, features=4, deformation_width=16, appearance_width=8)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    path = tmp_path_factory.mktemp("data") / "capture"
    write_synthetic_capture(path, frames=5, views=2, size=32)
    return Capture.open(path)


def on_skin(capture: Capture) -> tuple[Head, Roots]:
    """A head, and where its last Gaussians lie."""
    started = start_head(capture, CONFIG, 0)
    assert started.points is not None
    return started.head, started.points


def tracked_positions(surface: TrackedSurface, segment: Segment, index: int, points: Roots) -> torch.Tensor:
    return points.positions(surface.vertices(segment.start + index))


def two_triangles() -> tuple[torch.Tensor, torch.Tensor]:
    """A triangle of area 1/2 and one of area 3/2, in two planes."""
    vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 5], [3, 0, 5], [0, 1, 5]])
    return vertices, torch.tensor([[0, 1, 2], [3, 4, 5]])


def test_points_hold_the_vertices_and_cover_faces_by_area() -> None:
    vertices, faces = two_triangles()
    points = surface_points(vertices, faces, 1006, seed=0)
    positions = points.positions(vertices)
    assert positions.shape == (1006, 3)
    torch.testing.assert_close(positions[:6], vertices)
    between = positions[6:]
    assert abs(int((between[:, 2] > 2).sum()) - 750) <= 1
    near = between[between[:, 2] < 2]
    assert (near[:, :2] >= -1e-6).all()
    assert (near[:, :2].sum(1) <= 1 + 1e-6).all()
    torch.testing.assert_close(near[:, :2].mean(0), torch.full((2,), 1 / 3), atol=0.03, rtol=0)


def test_fewer_points_than_vertices_thin_them_out() -> None:
    vertices, faces = two_triangles()
    positions = surface_points(vertices, faces, 3, seed=0).positions(vertices)
    assert len({tuple(p.tolist()) for p in positions}) == 3
    assert torch.cdist(positions, vertices).amin(1).max() == 0


def test_points_move_with_the_mesh() -> None:
    vertices, faces = two_triangles()
    points = surface_points(vertices, faces, 50, seed=0)
    torch.testing.assert_close(points.positions(vertices * 2 + 1), points.positions(vertices) * 2 + 1)


def test_the_head_starts_where_the_tracking_has_it_and_follows_it(capture: Capture) -> None:
    head, points = on_skin(capture)
    segments = training_segments(capture)
    surface, count = tracked_surface(capture), len(points.face)
    target = head_frame(capture.track(segments[0]), 0)(tracked_positions(surface, segments[0], 0, points))
    assert (head.means.detach()[-count:] - target).norm(dim=1).max() < 1e-5
    for segment in segments:
        for index in range(segment.count):
            moved = head.world_means(head_pose(capture.track(segment), index))[-count:]
            error = (moved - tracked_positions(surface, segment, index, points)).norm(dim=1)
            assert error.square().mean().sqrt() < 1e-3


@dataclass(frozen=True)
class Rising(TrackedSurface):
    """A surface that rises by ``lift`` with the second coefficient; ``rest`` is in the head frame."""

    rest: torch.Tensor
    lift: torch.Tensor

    def vertices(self, frame: int) -> torch.Tensor:
        segments = training_segments(self.capture)
        segment = next(segment for segment in segments if frame in segment.frames)
        pose = head_pose(self.capture.track(segment), frame - segment.start)
        change = pose.expression[1] - head_pose(self.capture.track(segments[0]), 0).expression[1]
        return (self.rest + change * self.lift) @ pose.rotation.T + pose.translation


def test_modes_close_what_opens(capture: Capture) -> None:
    own, segments = tracked_surface(capture), training_segments(capture)
    rest = head_frame(capture.track(segments[0]), 0)(own.vertices(segments[0].start))
    lift = torch.zeros_like(rest)
    lift[::2, 1] = 0.02
    surface = Rising(capture, own.faces, own.scalp, own.follow, rest, lift)
    points = surface_points(rest, surface.faces, 30, 0)
    means, rows, pose = points.positions(rest), torch.arange(30), head_pose(capture.track(segments[0]), 0)
    modes = tracked_modes(surface, capture, points, rows, means, torch.ones(30), pose)
    with torch.no_grad():
        for segment in segments:
            for index in range(segment.count):
                driven = head_pose(capture.track(segment), index)
                moved = modes.displaced(means, driven.expression) @ driven.rotation.T + driven.translation
                assert (moved - tracked_positions(surface, segment, index, points)).norm(dim=1).max() < 5e-4


def test_a_capture_without_a_mesh_starts_on_the_registered_head(tmp_path: Path) -> None:
    capture = Capture.open(write_meshless_capture(tmp_path / "c"))
    head, points = on_skin(capture)
    assert points.triangle.max() > 5000  # of the open head
    segments = training_segments(capture)
    target = tracked_positions(tracked_surface(capture), segments[0], 0, points)
    expected = head_frame(capture.track(segments[0]), 0)(target)
    torch.testing.assert_close(head.means.detach()[-len(expected) :], expected)


def test_mouth_points_fill_the_box_behind_the_lips() -> None:
    generator = torch.Generator().manual_seed(1)
    landmarks = torch.zeros(66, 3)
    landmarks[48:] = torch.rand(18, 3, generator=generator) * torch.tensor([0.05, 0.02, 0.01])
    landmarks[48], landmarks[49] = torch.zeros(3), torch.tensor([0.05, 0.02, 0.01])
    x, y = torch.meshgrid(torch.linspace(-0.05, 0.1, 60), torch.linspace(-0.05, 0.07, 50), indexing="ij")
    skin = torch.stack([x, y, torch.full_like(x, 0.008)], -1).reshape(-1, 3)
    points = mouth_points(landmarks, skin, 200, seed=0)
    assert points.shape == (200, 3)
    low, high = torch.tensor([-0.015, -0.006, -0.003]), torch.tensor([0.065, 0.026, 0.006])
    assert (points >= low).all()
    assert (points <= high).all()
    assert (points.amax(0) - points.amin(0) > 0.9 * (high - low)).all()


def test_a_mouth_before_all_skin_gets_no_points() -> None:
    landmarks = torch.rand(66, 3, generator=torch.Generator().manual_seed(0)) * 0.02
    skin = torch.rand(50, 2) * 0.02
    surface = torch.cat([skin, torch.full((50, 1), -0.005)], 1)
    assert len(mouth_points(landmarks, surface, 20, 0)) == 0


def test_the_torso_starts_at_rest_without_being_fitted(capture: Capture) -> None:
    head, points = on_skin(capture)
    segment = training_segments(capture)[0]
    surface, track = tracked_surface(capture), capture.track(segment)
    body = points.interpolate(surface.follow) < 0.01
    assert body.any()
    for index in range(segment.count):
        moved = head.world_means(head_pose(track, index))[-len(points.face) :]
        error = (moved - tracked_positions(surface, segment, index, points)).norm(dim=1)
        assert error[body].max() < 1e-3
