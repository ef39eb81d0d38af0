"""The mesh stage's losses against oracles, and what they do not count."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from torch import Tensor

from dynhair.avatar import head_pose
from dynhair.avatar.mesh_head import MeshHead
from dynhair.capture import Capture
from dynhair.config import HeadConfig
from dynhair.mesh import TetrahedralGrid
from dynhair.mesh_config import MeshHeadConfig, MeshHeadWeights
from dynhair.training.batches import Batch, load_batch
from dynhair.training.frames import training_segments
from dynhair.training.mesh_objective import (
    MeshObjective,
    departure_loss,
    image_loss,
    mean_square,
    seen_without_hair,
)
from dynhair.training.mesh_pretraining import ellipsoids, pretrain
from dynhair.training.mesh_space import grid_follow, person_box, rest_landmarks
from synthetic import write_synthetic_capture

CONFIG = HeadConfig(features=4, deformation_width=8, appearance_width=8)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    path = tmp_path_factory.mktemp("data") / "capture"
    write_synthetic_capture(path, frames=3, views=2, size=48)
    return Capture.open(path)


@pytest.fixture(scope="module")
def head(capture: Capture) -> MeshHead:
    torch.manual_seed(0)
    grid = TetrahedralGrid.of(*person_box(capture), 14)
    pose = head_pose(capture.track(training_segments(capture)[0]), 0)
    landmarks = rest_landmarks(capture)
    first, follow = ellipsoids(grid.vertices, landmarks), grid_follow(capture, grid)
    head = MeshHead(grid, first, follow, landmarks, pose, CONFIG, MeshHeadConfig(width=48, layers=3))
    pretrain(head.geometry, 200, 0)
    return head


@pytest.fixture
def batch(capture: Capture) -> Batch:
    return load_batch(capture, training_segments(capture), 0, 2, capture.camera_names, 48)


def terms(capture: Capture, head: MeshHead, batch: Batch) -> dict[str, Tensor]:
    objective = MeshObjective(capture, training_segments(capture), MeshHeadWeights())
    return objective(head, batch).terms


def test_the_loss_is_the_weighted_sum_of_its_terms(capture: Capture, head: MeshHead, batch: Batch) -> None:
    names = [field.name for field in fields(MeshHeadWeights)]
    weights = MeshHeadWeights(*(0.3 + 0.2 * place for place in range(len(names))))
    step = MeshObjective(capture, training_segments(capture), weights)(head, batch)
    assert set(step.terms) == set(names)
    wanted = sum(getattr(weights, name) * float(term) for name, term in step.terms.items())
    assert float(step.loss.detach()) == pytest.approx(wanted, rel=1e-5)


def test_lengths_are_measured_in_canonical_units(capture: Capture, head: MeshHead, batch: Batch) -> None:
    with torch.no_grad():
        found = terms(capture, head, batch)
        segment = training_segments(capture)[0]
        pose = head_pose(capture.track(segment), 2)
        landmarks = head.landmarks.double() @ pose.rotation.double().T + pose.translation.double()
        tracked = torch.from_numpy(capture.landmarks_3d(segment.start + 2)).double()
        offsets = head.displacement(head.landmarks, torch.ones(66), pose).double() @ pose.rotation.double().T
        wanted = (((landmarks + offsets - tracked) * 10) ** 2).mean()
        assert float(found["landmarks"]) == pytest.approx(float(wanted), rel=1e-3)
        mesh = head.canonical()
        moved = head.posed(mesh, pose).displacement * 10
        assert float(found["deformation"]) == pytest.approx(float(moved.square().mean()), rel=1e-4)
        sdf = head.geometry.at(head.landmarks).sdf
        assert float(found["surface"]) == pytest.approx(float(sdf.abs().mean() * 10), rel=1e-4)
        assert float(found["laplacian"]) == pytest.approx(
            umbrella(mesh.vertices / head.geometry.spacing, mesh.faces), rel=1e-3
        )


def umbrella(vertices: Tensor, faces: Tensor) -> float:
    """Mean squared distance of each vertex to the mean of its neighbours, neighbour by neighbour."""
    points = vertices.double().numpy()
    neighbours: list[set[int]] = [set() for _ in points]
    for face in faces.tolist():
        for corner in face:
            neighbours[corner] |= set(face) - {corner}
    gaps = [points[list(ring)].mean(0) - points[i] for i, ring in enumerate(neighbours) if ring]
    return float(np.square(gaps).sum() / len(points))


def test_departure_is_counted_where_it_is_uneven(head: MeshHead) -> None:
    with torch.no_grad():
        found, surface = head.canonical().found, head.geometry
        first, here = surface.first[found.rows], surface.places[found.rows]
        raised = found._replace(field=found.field._replace(sdf=first + 0.02))
        assert float(departure_loss(surface, raised)) == pytest.approx(0, abs=1e-8)
        slope = here @ torch.tensor([0.3, -0.2, 0.5])
        tilted = found._replace(field=found.field._replace(sdf=first + slope))
        corners = slope.double()[found.tetrahedra.long()] / surface.spacing
        wanted = float((corners.var(1, correction=0) * 4).mean())
        assert float(departure_loss(surface, tilted)) == pytest.approx(wanted, rel=1e-4)


def test_the_image_loss_is_the_mean_difference_of_counted_pixels() -> None:
    random = np.random.default_rng(0)
    predicted, target = random.random((2, 3, 5, 7, 3)).astype(np.float32)
    counted = random.random((3, 5, 7)) < 0.6
    loss = image_loss(torch.from_numpy(predicted), torch.from_numpy(target), torch.from_numpy(counted))
    assert float(loss) == pytest.approx(np.abs(predicted - target)[counted].mean(), rel=1e-5)
    assert float(image_loss(torch.ones(1, 2, 2, 3), torch.zeros(1, 2, 2, 3), torch.zeros(1, 2, 2).bool())) == 0


def test_mean_square_is_of_coordinates_in_decimetres() -> None:
    assert float(mean_square(torch.tensor([[0.1, 0.0, 0.2]]))) == pytest.approx(5 / 3)


def test_pixels_of_hair_and_their_neighbours_do_not_count() -> None:
    hair = torch.zeros(1, 5, 6)
    hair[0, 2, 1] = 0.4
    hair[0, 4, 5] = 0.05  # less than the masks' own error
    counted = seen_without_hair(hair)
    wanted = torch.ones(5, 6, dtype=torch.bool)
    wanted[1:4, 0:3] = False
    assert torch.equal(counted[0], wanted)


def test_what_lies_under_hair_is_free(capture: Capture, head: MeshHead, batch: Batch) -> None:
    with torch.no_grad():
        before = terms(capture, head, batch)
        hairy = ~seen_without_hair(batch.hair)
        other = replace(
            batch,
            rgb=torch.where(hairy[..., None], 1 - batch.rgb, batch.rgb),
            body=torch.where(hairy, 1 - batch.body, batch.body),
        )
        after = terms(capture, head, other)
    assert hairy.any()
    assert after == before


def test_beyond_mask_and_hair_the_head_is_to_be_empty(capture: Capture, head: MeshHead, batch: Batch) -> None:
    def loss(of: MeshHead) -> float:
        with torch.no_grad():
            return float(terms(capture, of, batch)["silhouette"])

    last = head.geometry.network.layers[-1]
    assert isinstance(last, torch.nn.Linear)
    before = loss(head)
    with torch.no_grad():
        last.bias[0] -= 0.4  # the surface grows by about 4 cm everywhere
    swollen = loss(head)
    with torch.no_grad():
        last.bias[0] += 0.4
    assert loss(head) == pytest.approx(before)
    assert swollen > before + 0.05


def test_gradients_reach_every_parameter(capture: Capture, head: MeshHead, batch: Batch) -> None:
    objective = MeshObjective(capture, training_segments(capture), MeshHeadWeights())
    head.zero_grad()
    objective(head, batch).loss.backward()
    for name, parameter in head.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.abs().max() > 0, name
