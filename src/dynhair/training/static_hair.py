"""The canonical hairstyle: strands of the hair at rest, from the images alone (paper, "Canonical representation").

The paper starts from a learned prior (Im2Haircut), whose weights may not be passed on. Here a parametric groom is
fitted first (:mod:`dynhair.training.static_groom`); its strands are then refined with the paper's static losses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.avatar import HeadPose, head_pose
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.render import Gaussians, rasterize
from dynhair.strands import MeshDistance, sample_roots
from dynhair.strands.groom import grow_strands
from dynhair.training.frames import rest_frame
from dynhair.training.static_groom import FIRST_POPULATION, GENERATIONS, POPULATION, search_groom
from dynhair.training.static_refine import refine_strands
from dynhair.training.static_scene import surface_gaussians
from dynhair.training.static_views import RestViews, rest_views
from dynhair.training.surface import tracked_surface

_TOTAL_WIDTH = 1.5
_NARROWEST, _WIDEST = 1e-4, 4e-3
_LARGEST_IMAGE = 512
_SEARCH_STRANDS = 160
_SEARCH_IMAGE = 96
_SEARCH_VIEWS = 6
_PARTING_MARGIN = 0.008
_ROOT_DEPTH = 0.01


def strand_width(count: int) -> float:
    """The width in metres at which ``count`` strands cover a head: 1.5 m of strands side by side.

    Worn hair hangs around the head in a curtain of about 0.6 m, so that is two to three layers. The width stays between
    a hair's, 0.1 mm, and 4 mm.
    """
    return min(max(_TOTAL_WIDTH / count, _NARROWEST), _WIDEST)


def fit_canonical_hair(
    capture: Capture,
    *,
    strand_count: int,
    points: int,
    iterations: int,
    seed: int,
    width: float | None = None,
    progress: Callable[[int, int, float], None] = lambda step, total, loss: None,
) -> Float[Tensor, "n l 3"]:
    """Reconstruct the strands of the hair at rest from hair masks and orientation maps.

    Uses the rest frame's views and, where the capture has them, the static views around the head. Without orientation
    maps the silhouettes alone must do. Deterministic for a seed and a number of threads.

    Args:
        capture: with hair masks.
        strand_count: strands N.
        points: points L of a strand.
        iterations: refinement steps.
        seed: of roots, search and views.
        width: of a strand, metres; :func:`strand_width` if not given.
        progress: called with the step, their number (search and refinement together), and the loss of the stage.

    Returns:
        Strands in the head frame, metres, root first; the segments of a strand are nearly equal.

    Raises:
        DynhairError: the capture has no hair masks, no hair in them, or neither a tracked mesh nor landmarks.
    """
    scene = _RestScene.of(capture)
    width = strand_width(strand_count) if width is None else width
    searches = FIRST_POPULATION + GENERATIONS * POPULATION
    total = searches + iterations

    roots, normals = _roots(scene, strand_count, seed)
    few = min(_SEARCH_STRANDS, strand_count)
    chosen = torch.linspace(0, len(scene.views) - 1, min(_SEARCH_VIEWS, len(scene.views))).long().tolist()
    parameters = search_groom(
        roots[:few],
        normals[:few],
        scene.obstacle,
        scene.gravity,
        scene.body,
        scene.views[chosen].resized(_SEARCH_IMAGE),
        _TOTAL_WIDTH / few,
        seed=seed,
        progress=lambda tried, misfit: progress(tried, total, misfit),
    )
    strands = grow_strands(parameters, roots, normals, scene.obstacle, points, scene.gravity)
    return refine_strands(
        strands,
        width,
        scene.obstacle,
        scene.body,
        scene.views,
        iterations=iterations,
        seed=seed,
        progress=lambda step, loss: progress(searches + step, total, loss),
    )


@dataclass(frozen=True)
class _RestScene:
    """The capture's rest frame in the head frame, metres."""

    vertices: Float[Tensor, "v 3"]
    faces: Tensor
    scalp: Tensor
    obstacle: MeshDistance
    body: Gaussians
    gravity: Float[Tensor, "3"]
    views: RestViews

    @classmethod
    def of(cls, capture: Capture) -> _RestScene:
        surface = tracked_surface(capture)
        segment, index = rest_frame(capture)
        pose = head_pose(capture.track(segment), index)
        views = rest_views(capture, segment.start + index, pose, largest=_LARGEST_IMAGE)
        if not (views.hair > 0.5).any():
            raise DynhairError(
                "no view of the rest frame shows hair",
                path=capture.path,
                expected="hair masks with values up to 255 where there is hair",
                mend="segment the hair of the first frame and write hair_*.png",
            )
        vertices = _to_head(surface.vertices(segment.start + index), pose)
        faces = surface.faces
        gravity = torch.from_numpy(capture.gravity).float() @ pose.rotation
        return cls(
            vertices=vertices,
            faces=faces,
            scalp=surface.scalp,
            obstacle=MeshDistance(vertices, faces),
            body=surface_gaussians(vertices, faces),
            gravity=gravity,
            views=views,
        )


def _to_head(points: Tensor, pose: HeadPose) -> Tensor:
    return (points - pose.translation) @ pose.rotation


def _roots(scene: _RestScene, count: int, seed: int) -> tuple[Tensor, Tensor]:
    """Positions and normals of roots, without those that are seen to grow no hair (supplement B)."""
    sampled = sample_roots(scene.vertices, scene.faces, scene.scalp, 2 * count, seed)
    positions, normals = sampled.positions(scene.vertices), sampled.normals(scene.vertices)
    kept = torch.nonzero(~_bare(positions, normals, scene)).squeeze(1)[:count]
    if len(kept) < count:
        # Hardly any scalp grows hair: the hair is elsewhere than the scalp, and dropping roots would leave too few.
        kept = torch.arange(count)
    return positions[kept], normals[kept]


def _bare(positions: Tensor, normals: Tensor, scene: _RestScene) -> Tensor:
    """Which points of the scalp are in plain sight and in no view near any hair."""
    depths = rasterize(scene.body, scene.views.cameras).depth
    height, width = depths.shape[1:]
    seen = torch.zeros(len(positions), dtype=torch.int64)
    hairy = torch.zeros(len(positions), dtype=torch.bool)
    for camera, depth, hair in zip(scene.views.cameras, depths, scene.views.hair, strict=True):
        pixels, z = camera.project(positions)
        inside = ((pixels >= 0) & (pixels < pixels.new_tensor([width, height]))).all(1) & (z > 0)
        column, row = pixels.nan_to_num().long().clamp_min(0).unbind(1)
        column, row = column.clamp_max(width - 1), row.clamp_max(height - 1)
        facing = (normals * functional.normalize(camera.centre - positions, dim=1)).sum(1) > 0.3
        visible = inside & facing & (z < depth[row, column] + _ROOT_DEPTH)
        margin = max(1, round(_PARTING_MARGIN * float(camera.K[0, 0] / z.mean())))
        near = functional.max_pool2d(hair[None], 2 * margin + 1, 1, margin)[0]
        seen += visible
        hairy |= visible & (near[row, column] > 0.5)
    return (seen >= 2) & ~hairy
