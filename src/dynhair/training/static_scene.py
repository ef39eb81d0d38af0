"""Hair at rest in front of and behind an opaque head and torso, as the cameras see it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.camera import Camera
from dynhair.render import Gaussians, rasterize
from dynhair.strands import projected_orientation, strand_gaussians, strands_and_body

_LONGEST_EDGE = 0.02
_SPREAD = 2.0
_SUNK = 0.002
_THICKNESS = 5e-4


@dataclass(frozen=True)
class HairImages:
    """Hair that is not hidden by the body.

    Attributes:
        coverage: in [0, 1].
        direction: doubled angle ``(cos 2a, sin 2a)`` of the hair, weighted by its coverage.
    """

    coverage: Float[Tensor, "v h w"]
    direction: Float[Tensor, "v h w 2"]


@dataclass(frozen=True)
class PaintedImages(HairImages):
    """Hair and body in their colours.

    Attributes:
        rgb: colours before a black background.
        alpha: coverage by hair and body in [0, 1].
    """

    rgb: Float[Tensor, "v h w 3"]
    alpha: Float[Tensor, "v h w"]


def surface_gaussians(vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"]) -> Gaussians:
    """A mesh as flat, opaque Gaussians without hair: one for each triangle, large triangles being divided first.

    The Gaussians lie a little below the surface: a Gaussian is drawn in the order of its centre's depth, so that one
    at the surface would cut into hair that lies on it.
    """
    corners = vertices[faces].double()
    while True:
        edges = (corners - corners.roll(1, 1)).norm(dim=-1).amax(1)
        large = edges > _LONGEST_EDGE
        if not large.any():
            break
        corners = torch.cat([corners[~large], _quartered(corners[large])])
    normals = torch.nn.functional.normalize(
        torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), dim=1
    )
    centres = corners.mean(1)
    arms = corners - centres[:, None]
    covariance = arms.transpose(1, 2) @ arms / 12
    # eigh sorts in rising order: the first axis is the normal.
    variances, axes = torch.linalg.eigh(covariance)
    axes[:, :, 0] *= torch.linalg.det(axes).sign()[:, None]
    scales = _SPREAD * variances.clamp_min(0).sqrt()
    scales[:, 0] = _THICKNESS
    quats = np.roll(Rotation.from_matrix(axes.numpy()).as_quat(), 1, axis=1)
    return Gaussians(
        means=(centres - _SUNK * normals).float(),
        quats=torch.from_numpy(quats).float(),
        scales=scales.clamp_min(_THICKNESS).float(),
        opacities=torch.ones(len(centres)),
        features=torch.zeros(len(centres), 3),
    )


def render_hair(
    strands: Float[Tensor, "n l 3"], width: float | Float[Tensor, " n"], body: Gaussians, cameras: Sequence[Camera]
) -> HairImages:
    """Draw strands of the given width or widths, metres, together with the body that hides some of them."""
    scene = _scene(strands, width, body, cameras, None)
    images = rasterize(scene, cameras).features
    return HairImages(images[..., 0], images[..., 1:])


def render_painted_hair(
    strands: Float[Tensor, "n l 3"],
    width: float,
    body: Gaussians,
    cameras: Sequence[Camera],
    hair_colours: Float[Tensor, "g 3"],
    body_colours: Float[Tensor, "b 3"],
) -> PaintedImages:
    """Draw strands and body as :func:`render_hair` does, in the colours of their Gaussians.

    Args:
        strands: head frame, metres.
        width: of a strand, metres.
        body: opaque.
        cameras: the views.
        hair_colours: of the strands' segments.
        body_colours: of the body's Gaussians.
    """
    drawn = rasterize(_scene(strands, width, body, cameras, torch.cat([hair_colours, body_colours])), cameras)
    images = drawn.features
    return PaintedImages(images[..., 0], images[..., 1:3], images[..., 3:6], drawn.alpha)


def _scene(
    strands: Tensor, width: float | Tensor, body: Gaussians, cameras: Sequence[Camera], colours: Tensor | None
) -> Gaussians:
    hair = strand_gaussians(strands, width)
    features = []
    for camera in cameras:
        direction = projected_orientation(hair.means, hair.directions, camera)
        channels = torch.cat([torch.cat([torch.ones_like(direction[:, :1]), direction], 1), body.features])
        features.append(channels if colours is None else torch.cat([channels, colours], 1))
    return strands_and_body(hair, body, torch.stack(features))


def _quartered(corners: Tensor) -> Tensor:
    a, b, c = corners.unbind(1)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return torch.cat([torch.stack(part, 1) for part in parts])
