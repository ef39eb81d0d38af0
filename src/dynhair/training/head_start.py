"""The head's start: Gaussians on the tracked surface, that follow it from the first step."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from dynhair.avatar import ExpressionModes, Head, HeadPose, HeadStart, head_pose
from dynhair.avatar.branches import expression_weight
from dynhair.avatar.expression_modes import fitted_modes
from dynhair.avatar.skinning import Skinning
from dynhair.capture import Capture
from dynhair.config import HeadConfig
from dynhair.prior.evidence import body_depths
from dynhair.strands import Roots, sample_roots
from dynhair.training.frames import head_frame, rest_frame, training_segments
from dynhair.training.static_scene import surface_gaussians
from dynhair.training.static_views import rest_views
from dynhair.training.surface import TrackedSurface, tracked_surface
from dynhair.training.surface_colours import seen_colours

MODE_FRAMES = 200  # at most; more say nothing new
MODE_RIDGE = 1e-3
MOST_GROWTH = 1.5  # of a log-scale: what was folded away would grow without end
LEAST_AREA = 1e-9  # square metres
OPAQUE = 0.95
TRANSLUCENT = 0.3
MOUTH = slice(48, 66)
MOUTH_BOX = 1.6
MOUTH_DRAWS = 8
LIP_REACH = 0.01  # metres
LIP_DEPTH = 0.002


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


@dataclass(frozen=True)
class StartedHead:
    """A head before it has seen an image.

    Attributes:
        head: its Gaussians are sorted by the expression's share in them.
        points: where its last Gaussians lie on the tracked surface, those around the mouth coming before them; None if
            they are not bound to it.
        scalp: indices of the Gaussians on the scalp.
    """

    head: Head
    points: Roots | None
    scalp: Int64[Tensor, " s"]


def start_head(capture: Capture, config: HeadConfig, seed: int) -> StartedHead:
    """A head whose Gaussians lie on the tracked surface in the capture's rest frame, and behind the lips.

    Raises:
        DynhairError: the capture has neither a tracked mesh nor landmarks of a face.
    """
    surface = tracked_surface(capture)
    segment, index = rest_frame(capture)
    track = capture.track(segment)
    pose, to_head = head_pose(track, index), head_frame(track, index)
    vertices = to_head(surface.vertices(segment.start + index))
    landmarks = to_head(torch.from_numpy(capture.landmarks_3d(segment.start + index)))
    points = surface_points(vertices, surface.faces, config.gaussians, seed)
    share = expression_weight(points.positions(vertices), landmarks, config.near, config.far)
    points = points[share.argsort(descending=True, stable=True)]
    on_skin = points.positions(vertices)
    mouth = mouth_points(landmarks, on_skin, config.mouth_gaussians, seed)

    means = torch.cat([mouth, on_skin])
    normals = torch.cat([mouth.new_tensor([0.0, 0.0, 1.0]).expand_as(mouth), points.normals(vertices)])
    follow = torch.ones(len(means))
    if config.follow_weights:
        follow[len(mouth) :] = points.interpolate(surface.follow)
    opacities = torch.full((len(means),), OPAQUE)
    opacities[: len(mouth)] = TRANSLUCENT
    expressive = len(mouth) + torch.arange(int((share > 0).sum()))
    views = rest_views(capture, segment.start + index, pose)
    start = HeadStart(
        means=means,
        normals=normals,
        spacing=mean_spacing(means),
        colours=seen_colours(
            means, normals, views, body_depths(surface_gaussians(vertices, surface.faces), views.cameras)
        ),
        opacities=opacities,
        follow=follow,
        modes=tracked_modes(surface, capture, points[expressive - len(mouth)], expressive, means, follow, pose),
    )
    torch.manual_seed(seed)
    scalp = len(mouth) + torch.nonzero(torch.isin(points.face, surface.scalp)).squeeze(1)
    return StartedHead(Head(start, landmarks, pose, config), points, scalp)


def mouth_points(
    landmarks: Float[Tensor, "66 3"], surface: Float[Tensor, "k 3"], count: int, seed: int
) -> Float[Tensor, "m 3"]:
    """Random points around the mouth's landmarks, behind the skin: Gaussians for teeth and tongue (appendix A).

    Uniform in a box 1.6 times as large as the landmarks' own; what would lie before the surface is drawn again, since
    in the open nothing but an opaque face is to be seen.

    Args:
        landmarks: iBUG-68 without 48 and 54, head frame, metres.
        surface: points of the surface, head frame, metres.
        count: number of points; fewer are returned where hardly any of the box is behind the surface.
        seed: of the draw.
    """
    from pykdtree.kdtree import KDTree

    lips = landmarks[MOUTH]
    centre, half = (lips.amax(0) + lips.amin(0)) / 2, MOUTH_BOX / 2 * (lips.amax(0) - lips.amin(0))
    generator = torch.Generator().manual_seed(seed)
    drawn = centre + half * (2 * torch.rand(MOUTH_DRAWS * count, 3, generator=generator) - 1)
    near = surface[((surface - centre).abs() < 2 * half + LIP_REACH).all(1) & (surface[:, 2] > centre[2] - half[2])]
    if not len(near) or not count:
        return drawn[:count]
    array = np.ascontiguousarray(near[:, :2].numpy())
    _, nearest = KDTree(array).query(np.ascontiguousarray(drawn[:, :2].numpy()), k=min(4, len(near)))
    depths = near[:, 2][torch.from_numpy(nearest.astype(np.int64)).reshape(len(drawn), -1)]
    return drawn[drawn[:, 2] < depths.amax(1) - LIP_DEPTH][:count]


def tracked_modes(
    surface: TrackedSurface,
    capture: Capture,
    points: Roots,
    rows: Int64[Tensor, " m"],
    means: Float[Tensor, "k 3"],
    follow: Float[Tensor, " k"],
    rest: HeadPose,
) -> ExpressionModes:
    """How the expression moves points of the tracked surface, over the training segments.

    Args:
        surface: that moves.
        capture: gives poses and expressions.
        points: places on the surface.
        rows: their indices among the head's Gaussians.
        means: of the Gaussians in the rest frame, head frame, metres.
        follow: how far each Gaussian follows the head.
        rest: the rest frame's pose.
    """
    frames = [(segment, index) for segment in training_segments(capture) for index in range(segment.count)]
    skinning = Skinning(rest)
    first, index = rest_frame(capture)
    normals, areas = _facets(surface.vertices(first.start + index) @ rest.rotation, points)
    observed = []
    for segment, index in frames[:: math.ceil(len(frames) / MODE_FRAMES)]:
        pose = head_pose(capture.track(segment), index)
        with torch.no_grad():
            moved = skinning.world(means[rows], follow[rows], pose)
        vertices = surface.vertices(segment.start + index)
        displacements = (points.positions(vertices) - moved) @ pose.rotation
        turned, grown = _facets(vertices @ pose.rotation, points)
        growth = (grown / areas).log() / 2
        observed.append(
            (pose.expression, displacements, _turn(normals, turned), growth.clamp(-MOST_GROWTH, MOST_GROWTH))
        )
    expressions, displacements, turns, growth = (torch.stack(part) for part in zip(*observed, strict=True))
    return fitted_modes(expressions, rest.expression, displacements, turns, growth, rows, MODE_RIDGE)


def _facets(vertices: Float[Tensor, "v 3"], points: Roots) -> tuple[Float[Tensor, "m 3"], Float[Tensor, " m"]]:
    """Unit normals and areas of the triangles that points lie on."""
    a, b, c = vertices[points.triangle].unbind(1)
    normals = torch.linalg.cross(b - a, c - a) / 2
    areas = normals.norm(dim=1).clamp_min(LEAST_AREA)
    return normals / areas[:, None], areas


def _turn(before: Float[Tensor, "m 3"], after: Float[Tensor, "m 3"]) -> Float[Tensor, "m 3"]:
    """The rotation vectors of the least turns between unit vectors."""
    axis = torch.linalg.cross(before, after)
    sine = axis.norm(dim=1, keepdim=True)
    angle = torch.atan2(sine, (before * after).sum(1, keepdim=True))
    return torch.where(sine > 0, axis / sine.clamp_min(1e-12) * angle, torch.zeros_like(axis))


def mean_spacing(points: Float[Tensor, "k 3"]) -> Float[Tensor, " k"]:
    """Mean distance of each point to its three nearest neighbours: what sizes the Gaussians."""
    from pykdtree.kdtree import KDTree

    array = points.numpy()
    distances, _ = KDTree(array).query(array, k=4)
    return torch.from_numpy(np.asarray(distances)[:, 1:].mean(1)).float().clamp_min(1e-4)
