"""Evidence of hair on the grid, against loops over voxels and views."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor
from views import FRAME, camera_at, noise_views, seen_line

from dynhair.camera import Camera
from dynhair.prior import evidence
from dynhair.prior.evidence import (
    AXES,
    BODY,
    CARVED,
    GRID,
    PLANES,
    SEEN,
    SHARE,
    STRENGTH,
    Evidence,
    body_depths,
    gather_evidence,
    voxel_centres,
)
from dynhair.render import Gaussians
from dynhair.strands.scalp_map import ScalpFrame

NO_BODY = torch.tensor(torch.inf)


def bilinear(image: np.ndarray, x: float, y: float) -> np.ndarray:
    """Value at a place in pixels, zeros outside."""
    total = np.zeros(image.shape[2:])
    column, row = math.floor(x - 0.5), math.floor(y - 0.5)
    for i in (row, row + 1):
        for j in (column, column + 1):
            if 0 <= i < image.shape[0] and 0 <= j < image.shape[1]:
                total = total + (1 - abs(y - 0.5 - i)) * (1 - abs(x - 0.5 - j)) * image[i, j]
    return total


def seen(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Pixel and depth in scalp units of points in scalp units."""
    head = points * FRAME.radius + FRAME.centre.double().numpy()
    w2c = camera.w2c.double().numpy()
    local = head @ w2c[:, :3].T + w2c[:, 3]
    pixels = local @ camera.K.double().numpy().T / local[..., 2:]
    return np.concatenate([pixels[..., :2], local[..., 2:] / FRAME.radius], -1)


def carving(point: np.ndarray, views: tuple[list[Camera], Tensor, Tensor, Tensor]) -> list[tuple[float, float]]:
    """For each view: weight and hair mask at a point."""
    result = []
    for camera, hair, _, body in zip(*views, strict=True):
        x, y, depth = seen(camera, point)
        weight = 0.0
        if 0 < x < camera.width and 0 < y < camera.height and depth > 0.1:
            ahead = float(body[int(y), int(x)]) / FRAME.radius - depth
            weight = min(max(1 + ahead / 0.2, 0), 1)
        result.append((weight, float(bilinear(hair.double().numpy(), x, y))))
    return result


@pytest.fixture(scope="module")
def views() -> tuple[list[Camera], Tensor, Tensor, Tensor]:
    return noise_views(4, 40, seed=3)


@pytest.fixture(scope="module")
def volume(views: tuple[list[Camera], Tensor, Tensor, Tensor]) -> Tensor:
    return gather_evidence(FRAME, *views).volume.flatten(1)


def test_the_grid_is_symmetric_and_in_the_order_of_the_volume() -> None:
    centres = voxel_centres().view(*GRID, 3)
    torch.testing.assert_close(centres.flip(2) * torch.tensor([-1.0, 1.0, 1.0]), centres)
    torch.testing.assert_close(centres[3, 5, 7], torch.tensor([-0.9, -5.1, -1.7]))


def test_counts_are_those_of_loops(views: tuple[list[Camera], Tensor, Tensor, Tensor], volume: Tensor) -> None:
    centres = voxel_centres().double().numpy()
    for voxel in np.random.default_rng(0).choice(len(centres), 400, replace=False):
        weights, masks = np.array(carving(centres[voxel], views)).T
        count, covering = weights.sum(), (weights * masks).sum()
        assert volume[SHARE, voxel] == pytest.approx(covering / max(count, 1e-6), abs=2e-3)
        assert volume[CARVED, voxel] == pytest.approx(math.exp(covering - count), abs=2e-3)
        assert volume[SEEN, voxel] == pytest.approx(count / (count + 4), abs=2e-3)


def test_the_body_is_where_no_view_sees_past(
    views: tuple[list[Camera], Tensor, Tensor, Tensor], volume: Tensor
) -> None:
    centres = voxel_centres().double().numpy()
    for voxel in np.random.default_rng(1).choice(len(centres), 200, replace=False):
        ahead = []
        for camera, _, _, body in zip(*views, strict=True):
            x, y, depth = seen(camera, centres[voxel])
            if 0 < x < camera.width and 0 < y < camera.height:
                ahead.append(float(body[int(y), int(x)]) / FRAME.radius - depth)
        assert volume[BODY, voxel] == pytest.approx(min(max(max(ahead, default=0), -1), 1), abs=1e-3)


def test_planes_are_those_of_loops(views: tuple[list[Camera], Tensor, Tensor, Tensor], volume: Tensor) -> None:
    """Planes through eye and image direction, from angles that are halved here; weights by the hull's front."""
    centres = voxel_centres().double().numpy()
    hull = np.flatnonzero((volume[STRENGTH] > 0).numpy())
    seen_by = np.stack([seen(camera, centres[hull]) for camera in views[0]], 1)  # (h, v, 3)
    for index in np.random.default_rng(2).choice(len(hull), 60, replace=False):
        strength, tensor = 0.0, np.zeros((3, 3))
        carved = carving(centres[hull[index]], views)
        for view, (camera, direction) in enumerate(zip(views[0], views[2], strict=True)):
            x, y, depth = seen_by[index, view]
            cosine, sine = bilinear(direction.double().numpy(), x, y)
            K, R = camera.K.double().numpy(), camera.w2c[:, :3].double().numpy()
            centre_depth = seen(camera, np.zeros(3))[2]
            cell = 1.25 * 0.2 / centre_depth
            cells = np.floor((seen_by[:, view, :2] - K[:2, 2]) / K[[0, 1], [0, 1]] / cell)
            inside = (seen_by[:, view, :2] > 0).all(1) & (seen_by[:, view, :2] < camera.width).all(1)
            together = inside & (cells == cells[index]).all(1)
            if not together[index]:
                continue
            behind = max(depth - seen_by[together, view, 2].min() - 0.1, 0)
            weight = carved[view][0] * math.exp(-behind / 0.3) * math.hypot(cosine, sine)
            angle = math.atan2(sine, cosine) / 2
            at = np.linalg.inv(K) @ [x, y, 1]
            moved = np.linalg.inv(K) @ [x + math.cos(angle), y + math.sin(angle), 1]
            normal = R.T @ np.cross(at, moved)
            normal /= np.linalg.norm(normal)
            strength += weight
            tensor += weight * np.outer(normal, normal)
        voxel = hull[index]
        assert volume[STRENGTH, voxel] == pytest.approx(strength / (strength + 2), abs=3e-3)
        tensor /= strength
        # Where a view hardly counts, float32 moves a voxel over a pixel's edge.
        if strength > 0.1:
            found = volume[PLANES, voxel].numpy()
            expected = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            np.testing.assert_allclose(found, expected, atol=0.03)
            adjugate = np.linalg.det(tensor + 1e-9 * np.eye(3)) * np.linalg.inv(tensor + 1e-9 * np.eye(3))
            axes = 4 * adjugate[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            np.testing.assert_allclose(volume[AXES, voxel].numpy(), axes, atol=0.06)


def test_a_line_seen_from_three_sides_has_its_direction_in_space() -> None:
    start = FRAME.centre + torch.tensor([0.06, 0.03, 0.11])
    end = start + torch.tensor([0.05, -0.25, -0.06])
    line = torch.nn.functional.normalize(end - start, dim=0)
    cameras = [camera_at(azimuth, elevation) for azimuth, elevation in ((-40, 10), (15, -10), (60, 0))]
    hair, direction = (torch.stack(maps) for maps in zip(*(seen_line(start, end, c, 6) for c in cameras), strict=True))
    volume = gather_evidence(FRAME, cameras, hair, direction, NO_BODY.expand_as(hair)).volume
    strong = torch.nonzero(volume[STRENGTH].flatten() > 0.5).squeeze(1)
    assert len(strong) >= 5
    distance = torch.linalg.cross(voxel_centres()[strong] - FRAME.to_scalp(start), line.expand(len(strong), 3))
    assert distance.norm(dim=1).max() < 0.4
    xx, yy, zz, xy, xz, yz = volume[PLANES].flatten(1)[:, strong]
    tensors = torch.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], -1).view(-1, 3, 3)
    assert (tensors @ line).norm(dim=1).max() < 0.1
    values, vectors = torch.linalg.eigh(tensors)
    assert (vectors[:, :, 0] @ line).abs().min() > math.cos(math.radians(4))
    assert values[:, 1].min() > 0.05
    axes = volume[AXES].flatten(1)[:, strong]
    expected = (line[[0, 1, 2, 0, 0, 1]] * line[[0, 1, 2, 1, 2, 2]])[:, None]
    torch.testing.assert_close(axes / axes[:3].sum(0), expected.expand_as(axes), atol=0.08, rtol=0)


def test_the_order_of_the_views_does_not_matter(
    views: tuple[list[Camera], Tensor, Tensor, Tensor], volume: Tensor
) -> None:
    cameras, *maps = views
    order = [2, 0, 3, 1]
    turned = gather_evidence(FRAME, [cameras[i] for i in order], *(each[order] for each in maps)).volume
    torch.testing.assert_close(turned.flatten(1), volume, atol=1e-4, rtol=1e-4)


def test_size_and_place_of_the_head_do_not_matter(views: tuple[list[Camera], Tensor, Tensor, Tensor]) -> None:
    # Powers of two keep voxels on their sides of the pixels' edges.
    cameras, hair, direction, body = views
    scale, shift = 2.0, torch.tensor([0.5, -0.25, 1.0])
    frame = ScalpFrame(scale * FRAME.centre + shift, scale * FRAME.radius)
    moved = []
    for camera in cameras:
        R, t = camera.w2c[:, :3], camera.w2c[:, 3:]
        moved.append(replace(camera, w2c=torch.cat([R, scale * t - R @ shift[:, None]], 1)))
    here = gather_evidence(FRAME, cameras, hair, direction, body).volume
    there = gather_evidence(frame, moved, hair, direction, scale * body).volume
    assert ((here - there).abs() > 1e-3).float().mean() < 1e-3


def test_the_resolution_hardly_matters() -> None:
    start, end = FRAME.centre + torch.tensor([0.0, 0.0, 0.1]), FRAME.centre + torch.tensor([0.02, -0.3, 0.1])
    volumes = []
    for size in (64, 256):
        cameras = [camera_at(azimuth, size=size) for azimuth in (-50, 0, 50)]
        maps = (seen_line(start, end, camera, size / 8) for camera in cameras)
        hair, direction = (torch.stack(each) for each in zip(*maps, strict=True))
        volumes.append(gather_evidence(FRAME, cameras, hair, direction, NO_BODY.expand_as(hair)).volume)
    assert (volumes[0] - volumes[1])[SHARE].abs().mean() < 0.01
    assert ((volumes[0] - volumes[1])[AXES].abs() > 0.1).float().mean() < 0.01


def test_a_mirrored_head_has_mirrored_evidence() -> None:
    frame = replace(FRAME, centre=torch.tensor([0.0, 0.06, -0.02]))
    cameras, hair, direction, body = noise_views(3, 40, seed=5)
    flip = torch.diag(torch.tensor([-1.0, 1.0, 1.0]))
    mirrored = [replace(c, w2c=flip @ c.w2c @ torch.diag(torch.tensor([-1.0, 1.0, 1.0, 1.0]))) for c in cameras]
    flipped = direction.flip(2) * torch.tensor([1.0, -1.0])
    there = gather_evidence(frame, mirrored, hair.flip(2), flipped, body.flip(2))
    here = gather_evidence(frame, cameras, hair, direction, body).mirrored()
    assert ((here.volume - there.volume).abs() > 1e-2).float().mean() < 2e-3


def test_hair_without_directions_and_no_hair_at_all() -> None:
    cameras, hair, direction, body = noise_views(2, 32, seed=1)
    blind = gather_evidence(FRAME, cameras, hair, torch.zeros_like(direction), body).volume
    assert torch.isfinite(blind).all()
    assert (blind[STRENGTH] == 0).all()
    bald = gather_evidence(FRAME, cameras, torch.zeros_like(hair), torch.zeros_like(direction), body).volume
    assert torch.isfinite(bald).all()
    assert (bald[SHARE] == 0).all()


def test_unseen_voxels_are_not_carved() -> None:
    camera = camera_at(0)
    away = replace(camera, w2c=torch.diag(torch.tensor([-1.0, 1.0, -1.0])) @ camera.w2c)
    volume = gather_evidence(FRAME, [away], torch.zeros(1, 64, 64), torch.zeros(1, 64, 64, 2), torch.ones(1, 64, 64))
    assert (volume.volume[SEEN] == 0).all()
    assert (volume.volume[CARVED] == 1).all()


def test_batches_mirror_as_their_parts_do(volume: Tensor) -> None:
    parts = [Evidence(volume.view(-1, *GRID)), Evidence(torch.rand(evidence.CHANNELS, *GRID))]
    together = Evidence.batch(parts)
    assert torch.equal(together.mirrored().volume[1], parts[1].mirrored().volume)
    assert torch.equal(together.mirrored().mirrored().volume, together.volume)


def test_depths_of_a_body_are_infinite_beside_it() -> None:
    camera = camera_at(0)
    target = FRAME.centre - torch.tensor([0.0, 0.1, 0.0])
    ball = Gaussians(
        target[None], torch.tensor([[1.0, 0, 0, 0]]), torch.full((1, 3), 0.05), torch.ones(1), torch.ones(1, 1)
    )
    depth = body_depths(ball, [camera])[0]
    assert depth[32, 32] == pytest.approx(1.0, abs=0.01)
    assert torch.isinf(depth[0, 0])
