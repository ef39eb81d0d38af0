"""The torso: where it is, against scikit-image's polygons, and how it moves, against known shifts."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.ndimage import binary_dilation, shift
from scipy.spatial import Delaunay
from skimage.draw import polygon2mask

from dynhair.camera import Camera
from dynhair.capture import Capture, Segment
from dynhair.capture.records import TrackedMesh
from dynhair.errors import DynhairError
from dynhair.evaluation.torso import (
    FAINT_HAIR,
    HAIR_MARGIN,
    LEAST_EDGES,
    MARGIN,
    Torso,
    TorsoMotion,
    mean_motion,
    without_hair,
)
from synthetic import write_synthetic_capture

SIZE = 64


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    return Capture.open(write_synthetic_capture(tmp_path_factory.mktemp("torso") / "capture", frames=4, size=SIZE))


@pytest.fixture
def segment(capture: Capture) -> Segment:
    return capture.segment("nod")


def cameras_of(capture: Capture, segment: Segment, index: int) -> list[Camera]:
    return [capture.camera(segment.frames[index], name) for name in capture.camera_names]


def stripes(down: float = 0.0) -> torch.Tensor:
    """Horizontal, in three views."""
    rows = 0.5 + 0.3 * torch.sin(2 * torch.pi * (torch.arange(SIZE) - down) / 10.0)
    return rows[None, :, None, None].expand(3, SIZE, SIZE, 3).contiguous()


def test_the_torso_is_the_body_not_behind_the_head(capture: Capture, segment: Segment) -> None:
    cameras = cameras_of(capture, segment, 2)
    found = Torso(capture, segment, cameras_of(capture, segment, 0)).pixels(2, cameras).numpy()
    mesh = capture.mesh
    assert mesh is not None
    centres = np.stack(np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5), axis=-1)
    for view, camera in enumerate(cameras):
        pixels = [camera.project(torch.from_numpy(capture.vertices(segment.start + i)))[0].numpy() for i in (0, 2)]
        on_body = mesh.faces[(mesh.follow[mesh.faces] == 0).all(axis=1)]
        body = np.zeros((SIZE, SIZE), bool)
        for triangle in pixels[0][on_body]:
            body |= polygon2mask((SIZE, SIZE), triangle[:, ::-1] - 0.5)
        head = np.zeros_like(body)
        for points in pixels:
            head |= Delaunay(points[mesh.follow == 1]).find_simplex(centres) >= 0
        offset = np.arange(-MARGIN, MARGIN + 1)
        disk = offset**2 + offset[:, None] ** 2 <= MARGIN**2
        least = np.asarray(binary_dilation(body, disk))
        most = np.asarray(binary_dilation(least))  # a pixel that a face touches counts as well
        assert found[view].sum() > 300
        assert (found[view] >= (least & ~head)).all()
        assert (found[view] <= (most & ~head)).all()


@pytest.mark.parametrize("down", [0.0, 0.2, 0.4, -1.0])
def test_a_shift_of_the_images_is_the_motion(capture: Capture, segment: Segment, down: float) -> None:
    torso = Torso(capture, segment, cameras_of(capture, segment, 0))
    motion = TorsoMotion(torso, stripes())
    found = mean_motion(motion.distances(stripes(down)), torso.pixels(1, cameras_of(capture, segment, 1)))
    np.testing.assert_allclose(found, abs(down), atol=0.01, rtol=0.04)


def test_a_fifth_of_a_pixel_is_seen_in_the_captures_own_images(capture: Capture, segment: Segment) -> None:
    rgb = torch.stack([view.rgb for view in capture.views([(segment.start, name) for name in capture.camera_names])])
    moved = torch.from_numpy(shift(rgb.numpy(), (0, 0.2, 0, 0), order=3, mode="nearest"))
    torso = Torso(capture, segment, cameras_of(capture, segment, 0))
    motion, pixels = TorsoMotion(torso, rgb), torso.pixels(0, cameras_of(capture, segment, 0))
    assert (mean_motion(motion.distances(rgb), pixels) < 1e-3).all()
    assert (mean_motion(motion.distances(moved), pixels) > 0.08).all()


def test_hair_and_what_is_near_it_does_not_count() -> None:
    hair, faint = torch.zeros(2, 1, 30, 30)
    hair[0, 10, 10] = 0.5
    faint[0, 20, 20] = FAINT_HAIR / 2
    visible = without_hair(torch.ones(1, 30, 30, dtype=torch.bool), [faint, hair])
    rows, columns = np.indices((30, 30))
    np.testing.assert_array_equal(~visible[0].numpy(), (rows - 10) ** 2 + (columns - 10) ** 2 <= HAIR_MARGIN**2)


def test_motion_is_the_mean_over_edges_and_needs_some() -> None:
    distances = torch.full((2, 20, 20), torch.nan)
    distances[0, :5] = torch.arange(100.0).reshape(5, 20)
    distances[1, :2, : LEAST_EDGES // 2 - 1] = 1.0
    pixels = torch.ones(2, 20, 20, dtype=torch.bool)
    pixels[0, 0] = False
    found = mean_motion(distances, pixels)
    assert found[0] == torch.arange(20.0, 100.0).mean()
    assert found[1].isnan()


class _OtherMesh(Capture):
    """The same capture with another mesh."""

    def __init__(self, capture: Capture, mesh: TrackedMesh | None) -> None:
        super().__init__(capture.layout, capture.manifest)
        self.mesh = mesh


def test_without_a_mesh_or_a_body_there_is_no_torso(capture: Capture, segment: Segment) -> None:
    cameras = cameras_of(capture, segment, 0)
    with pytest.raises(DynhairError, match="no mesh that tells head and body apart"):
        Torso(_OtherMesh(capture, None), segment, cameras)
    mesh = capture.mesh
    assert mesh is not None
    head_alone = TrackedMesh(mesh.faces, mesh.scalp, np.ones_like(mesh.follow), mesh.landmarks)
    with pytest.raises(DynhairError, match="nothing of the mesh moves with the body"):
        Torso(_OtherMesh(capture, head_alone), segment, cameras)


def test_a_torso_out_of_sight_has_no_motion(capture: Capture, segment: Segment) -> None:
    away = [
        Camera(torch.cat([torch.eye(3), torch.tensor([[0.0], [0.0], [-9.0]])], 1), c.K, c.width, c.height)
        for c in cameras_of(capture, segment, 0)
    ]
    torso = Torso(capture, segment, away)
    distances = TorsoMotion(torso, stripes()).distances(stripes(0.5))
    assert mean_motion(distances, torso.pixels(1, away)).isnan().all()
