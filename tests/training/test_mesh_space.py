"""Where the mesh head is sought, and the shape that it begins as."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from meshless import true_head, write_meshless_capture
from scipy.spatial import KDTree

from dynhair.avatar.neural_surface import NeuralSurface
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.face import open_head
from dynhair.mesh import TetrahedralGrid
from dynhair.strands import MeshDistance
from dynhair.training.frames import head_frame, rest_frame
from dynhair.training.mesh_pretraining import ellipsoids, first_shape, pretrain
from dynhair.training.mesh_space import grid_follow, person_box, rest_landmarks
from synthetic import write_synthetic_capture


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    path = tmp_path_factory.mktemp("data") / "capture"
    write_synthetic_capture(path, frames=2, views=4, size=64)
    return Capture.open(path)


@pytest.fixture(scope="module")
def faces(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """A capture with the landmarks of a face and without a mesh."""
    return Capture.open(write_meshless_capture(tmp_path_factory.mktemp("data") / "capture", frames=2))


def rest_vertices(capture: Capture) -> torch.Tensor:
    segment, index = rest_frame(capture)
    vertices = torch.from_numpy(capture.vertices(segment.start + index))
    return head_frame(capture.track(segment), index)(vertices)


def test_the_box_holds_who_is_seen_and_little_more(capture: Capture) -> None:
    low, high = person_box(capture)
    vertices = rest_vertices(capture)
    seen = vertices[vertices[:, 1] > -0.2]  # the pictures end below
    assert (seen > low).all()
    assert (seen < high).all()
    assert (high - low).max() < 0.7
    assert (high[1] - vertices[:, 1].max()) < 0.06


def test_the_grid_follows_as_the_tracked_surface_beside_it(capture: Capture) -> None:
    assert capture.mesh is not None
    grid = TetrahedralGrid.of(*person_box(capture), 6)
    found = grid_follow(capture, grid)
    nearest = KDTree(rest_vertices(capture).numpy()).query(grid.vertices.numpy())[1]
    np.testing.assert_array_equal(found.numpy(), capture.mesh.follow[nearest])


def test_a_face_begins_as_the_open_head_there(faces: Capture) -> None:
    points = TetrahedralGrid.of(torch.tensor([-0.1, -0.1, -0.1]), torch.tensor([0.1, 0.1, 0.1]), 6)
    truth = MeshDistance(true_head(np.zeros(4, np.float32)), open_head().faces)
    wanted, _ = truth.query(points.vertices)
    assert (first_shape(faces, points) - wanted).abs().median() < 2e-3


def test_what_is_no_face_begins_as_ellipsoids(capture: Capture) -> None:
    grid = TetrahedralGrid.of(*person_box(capture), 6)
    assert torch.equal(first_shape(capture, grid), ellipsoids(grid.vertices, rest_landmarks(capture)))


def test_ellipsoids_are_distances_near_their_surface() -> None:
    landmarks = torch.zeros(66, 3)
    top = torch.tensor([[0.0, 0.04 + 0.112, -0.09]])
    across = torch.tensor([[0.0, 0.005, 0.0], [0.0, -0.005, 0.0], [0.0, 0.0, 0.0]])
    torch.testing.assert_close(
        ellipsoids(top + across, landmarks), torch.tensor([0.005, -0.005, 0.0]), atol=2e-4, rtol=0
    )
    centre = torch.tensor([[0.0, 0.04, -0.09]])
    assert float(ellipsoids(centre, landmarks)) == pytest.approx(-0.077)


def test_pretraining_learns_the_first_shape_and_remembers_what_it_learned() -> None:
    torch.manual_seed(0)
    grid = TetrahedralGrid.of(torch.full((3,), -0.1), torch.full((3,), 0.1), 8)
    wanted = grid.vertices.norm(dim=1) - 0.06
    surface = NeuralSurface(grid, wanted, 48, 3)
    pretrain(surface, 200, 0)
    with torch.no_grad():
        torch.testing.assert_close(surface.first, surface.at(surface.places).sdf)
        assert (surface.first - wanted).abs().mean() < 3e-3
        assert (surface().surface.vertices.norm(dim=1) - 0.06).abs().mean() < 3e-3


def test_too_little_pretraining_is_refused() -> None:
    torch.manual_seed(0)
    grid = TetrahedralGrid.of(torch.full((3,), -0.1), torch.full((3,), 0.1), 4)
    with pytest.raises(DynhairError, match="no surface"):
        pretrain(NeuralSurface(grid, torch.ones(len(grid.vertices)), 8, 2), 200, 0)


def test_landmarks_are_needed(capture: Capture, tmp_path: Path) -> None:
    copy = tmp_path / "capture"
    shutil.copytree(capture.path, copy)
    for file in copy.glob("params/*/lmk_3d.npy"):
        file.unlink()
    with pytest.raises(DynhairError, match="lmk_3d"):
        person_box(Capture.open(copy))
