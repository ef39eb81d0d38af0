"""The rest frame in the head frame: the body that hides hair, where hair grows, and what the views show."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from dynhair.avatar import head_pose
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.prior.evidence import body_depths
from dynhair.render import Gaussians
from dynhair.strands import MeshDistance, ScalpFrame, sample_roots, smooth_surface
from dynhair.training.frames import rest_frame
from dynhair.training.static_scene import surface_gaussians
from dynhair.training.static_views import RestViews, rest_views
from dynhair.training.surface import tracked_surface

_PARTING_MARGIN = 0.008
_ROOT_DEPTH = 0.01


@dataclass(frozen=True)
class RestScene:
    """The capture's rest frame, head frame, metres.

    Attributes:
        vertices: of the tracked surface.
        faces: its triangles.
        scalp: indices of the faces that grow hair.
        frame: the scalp's own coordinates.
        obstacle: the surface, for signed distances.
        body: the surface as opaque Gaussians without hair.
        views: the rest views that training sees.
        body_depth: depth of the body in each view, metres; infinite where there is none.
    """

    vertices: Float[Tensor, "v 3"]
    faces: Int[Tensor, "f 3"]
    scalp: Int[Tensor, " s"]
    frame: ScalpFrame
    obstacle: MeshDistance
    body: Gaussians
    views: RestViews
    body_depth: Float[Tensor, "views h w"]

    @classmethod
    def of(cls, capture: Capture, largest_image: int) -> RestScene:
        """Read the rest frame.

        Args:
            capture: with hair masks.
            largest_image: longer side to which larger images are reduced, pixels.

        Raises:
            DynhairError: the capture has no hair masks, no hair in them, or neither a tracked mesh nor landmarks.
        """
        surface = tracked_surface(capture)
        segment, index = rest_frame(capture)
        pose = head_pose(capture.track(segment), index)
        views = rest_views(capture, segment.start + index, pose, largest=largest_image)
        if not (views.hair > 0.5).any():
            raise DynhairError(
                "no view of the rest frame shows hair",
                path=capture.path,
                expected="hair masks with values up to 255 where there is hair",
                mend="segment the hair of the first frame and write hair_*.png",
            )
        vertices = (surface.vertices(segment.start + index) - pose.translation) @ pose.rotation
        body = surface_gaussians(vertices, surface.faces)
        return cls(
            vertices=vertices,
            faces=surface.faces,
            scalp=surface.scalp,
            frame=ScalpFrame.of(vertices, surface.faces, surface.scalp),
            obstacle=MeshDistance(vertices, surface.faces),
            body=body,
            views=views,
            body_depth=body_depths(body, views.cameras),
        )

    def roots(self, count: int, seed: int) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
        """Positions and normals of roots, uniform by area, without those that are seen to grow no hair (supplement B).

        Args:
            count: number of roots.
            seed: of the draw.
        """
        sampled = sample_roots(self.vertices, self.faces, self.scalp, 2 * count, seed)
        positions, normals = smooth_surface(sampled, self.vertices, self.faces)
        kept = torch.nonzero(~self.bare(positions, normals)).squeeze(1)[:count]
        if len(kept) < count:
            # Hardly any scalp grows hair: the hair is elsewhere than the scalp, and dropping roots would leave too few.
            kept = torch.arange(count)
        return positions[kept], normals[kept]

    def bare(self, positions: Float[Tensor, "n 3"], normals: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """Which points of the scalp are in plain sight and in no view near any hair."""
        height, width = self.body_depth.shape[1:]
        seen = torch.zeros(len(positions), dtype=torch.int64)
        hairy = torch.zeros(len(positions), dtype=torch.bool)
        for camera, depth, hair in zip(self.views.cameras, self.body_depth, self.views.hair, strict=True):
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
