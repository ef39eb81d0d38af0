"""The head's start: Gaussians on the tracked surface, and networks that already move them as it moved."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from dynhair.avatar import Head, head_pose
from dynhair.capture import Capture, Segment
from dynhair.config import HeadConfig
from dynhair.strands import Roots, sample_roots
from dynhair.training.frames import head_frame, rest_frame
from dynhair.training.surface import TrackedSurface, tracked_surface

FRAMES_PER_STEP = 4
POINTS_PER_STEP = 2048


def surface_points(vertices: Float[Tensor, "v 3"], faces: Int64[Tensor, "f 3"], count: int, seed: int) -> Roots:
    """The mesh's own vertices and, between them, points spread evenly by area, ``count`` together.

    A mesh of more vertices than ``count`` is thinned out evenly by index.

    Returns:
        Points bound to the mesh: the same places on the skin in every frame.
    """
    face_of_vertex = torch.full((len(vertices),), -1)
    slot_of_vertex = torch.zeros(len(vertices), dtype=torch.long)
    for slot in range(3):
        face_of_vertex[faces[:, slot]] = torch.arange(len(faces))
        slot_of_vertex[faces[:, slot]] = slot
    chosen = torch.nonzero(face_of_vertex >= 0).squeeze(1)
    if len(chosen) > count:
        chosen = chosen[torch.linspace(0, len(chosen) - 1, count).long()]
    own = face_of_vertex[chosen]
    corners = torch.nn.functional.one_hot(slot_of_vertex[chosen], 3).float()
    between = sample_roots(vertices, faces, torch.arange(len(faces)), count - len(chosen), seed)
    return Roots(
        torch.cat([own, between.face]),
        torch.cat([faces[own], between.triangle]),
        torch.cat([corners, between.barycentric]),
    )


def start_head(capture: Capture, config: HeadConfig, seed: int) -> tuple[Head, Roots]:
    """A head whose Gaussians lie on the tracked surface in the capture's rest frame.

    Raises:
        DynhairError: the capture has neither a tracked mesh nor landmarks of a face.
    """
    surface = tracked_surface(capture)
    segment, index = rest_frame(capture)
    track = capture.track(segment)
    pose = head_pose(track, index)
    to_head = head_frame(track, index)
    vertices = to_head(surface.vertices(segment.start + index))
    points = surface_points(vertices, surface.faces, config.gaussians, seed)
    means = points.positions(vertices)
    landmarks = to_head(torch.from_numpy(capture.landmarks_3d(segment.start + index)))
    torch.manual_seed(seed)
    head = Head(
        means,
        points.normals(vertices),
        mean_spacing(means),
        landmarks,
        pose.translation,
        track.expressions.shape[1],
        config,
    )
    return head, points


def fit_tracking(
    head: Head,
    points: Roots,
    capture: Capture,
    segments: Sequence[Segment],
    *,
    iterations: int,
    seed: int,
    progress: Callable[[int, int, float], None],
) -> None:
    """Fit the head's deformation networks to the tracked surface, before any image is looked at.

    Minimises the distance between the deformed Gaussians and their places on that surface, over random frames.

    Args:
        head: changed in place.
        points: the Gaussians' places on the surface.
        capture: gives the tracked surface.
        segments: the training segments.
        iterations: Adam steps.
        seed: of the frames' order.
        progress: called with the step, their number, and the root mean square distance in metres.
    """
    surface = tracked_surface(capture)
    tracks = [capture.track(segment) for segment in segments]
    parameters = [*head.expression_deformation.parameters(), *head.pose_deformation.parameters()]
    optimizer = torch.optim.Adam(parameters, lr=2e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, max(iterations, 1))
    generator = torch.Generator().manual_seed(seed)

    def draw(count: int) -> int:
        return int(torch.randint(count, (1,), generator=generator))

    for step in range(iterations):
        loss = torch.zeros(())
        rows = torch.randint(len(head.means), (POINTS_PER_STEP,), generator=generator)
        chosen = Roots(points.face[rows], points.triangle[rows], points.barycentric[rows])
        for _ in range(FRAMES_PER_STEP):
            number = draw(len(segments))
            index = draw(segments[number].count)
            moved = head.deformed_means(head_pose(tracks[number], index), rows)
            target = tracked_positions(surface, capture, segments[number], index, chosen)
            loss = loss + (moved - target).square().sum(-1).mean() / FRAMES_PER_STEP
        optimizer.zero_grad(set_to_none=True)
        (loss * 1e4).backward()
        optimizer.step()
        schedule.step()
        progress(step + 1, iterations, float(loss.detach().sqrt()))


def tracked_positions(
    surface: TrackedSurface, capture: Capture, segment: Segment, index: int, points: Roots
) -> Float[Tensor, "k 3"]:
    """Where the surface points are in one frame of a segment, in the head frame, metres."""
    vertices = surface.vertices(segment.start + index)
    return head_frame(capture.track(segment), index)(points.positions(vertices))


def mean_spacing(points: Float[Tensor, "k 3"]) -> Float[Tensor, " k"]:
    """Mean distance of each point to its three nearest neighbours: what sizes the Gaussians."""
    from pykdtree.kdtree import KDTree

    array = points.numpy()
    distances, _ = KDTree(array).query(array, k=4)
    return torch.from_numpy(np.asarray(distances)[:, 1:].mean(1)).float().clamp_min(1e-4)
