"""The mesh stage's objective: the mesh head against images, masks and landmarks (paper, appendix A)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.avatar import head_pose
from dynhair.avatar.encoding import CANONICAL_UNIT
from dynhair.avatar.mesh_head import MeshHead, PosedMesh
from dynhair.avatar.neural_surface import Extraction, NeuralSurface
from dynhair.camera import Camera
from dynhair.capture import Capture, Segment
from dynhair.mesh import laplacian_loss, silhouette_iou_loss
from dynhair.mesh_config import MeshHeadWeights
from dynhair.render import rasterize
from dynhair.training.batches import Batch

_HAIR = 0.1
_MARGIN = 1


class MeshImages(NamedTuple):
    """The mesh head as the cameras see it.

    Attributes:
        rgb: on the capture's background.
        coverage: in [0, 1].
    """

    rgb: Float[Tensor, "v h w 3"]
    coverage: Float[Tensor, "v h w"]


class MeshStep(NamedTuple):
    """What one step computed.

    Attributes:
        loss: the weighted sum.
        terms: each term without its weight, detached.
        images: what the mesh looks like in the step's views.
    """

    loss: Float[Tensor, ""]
    terms: dict[str, Tensor]
    images: MeshImages


class MeshObjective:
    """Gaussian Head Avatar's losses of the mesh stage, counted where no hair hides the head.

    Lengths are in canonical units of 0.1 m.

    Args:
        capture: gives poses, landmarks and the background.
        segments: the training segments.
        weights: of the terms.
    """

    def __init__(self, capture: Capture, segments: list[Segment], weights: MeshHeadWeights) -> None:
        self._capture, self._segments, self._weights = capture, segments, weights
        self._tracks = [capture.track(segment) for segment in segments]
        self._background = torch.from_numpy(capture.background).float()

    def __call__(self, head: MeshHead, batch: Batch) -> MeshStep:
        """Draw the mesh in a batch's views and compare."""
        device = head.landmarks.device
        pose = head_pose(self._tracks[batch.segment], batch.index, device)
        tracked = torch.from_numpy(self._capture.landmarks_3d(self._segments[batch.segment].start + batch.index))
        mesh = head.canonical()
        posed = head.posed(mesh, pose)
        images = mesh_images(posed, batch.cameras, self._background.to(device))
        counted = seen_without_hair(batch.hair)
        terms = {
            "image": image_loss(images.rgb, batch.rgb, counted),
            "silhouette": silhouette_iou_loss(images.coverage, batch.body, counted.to(images.coverage)),
            "landmarks": mean_square(head.world_landmarks(pose) - tracked.to(device)),
            "deformation": mean_square(posed.displacement),
            "surface": head.geometry.at(head.landmarks).sdf.abs().mean() / CANONICAL_UNIT,
            "laplacian": laplacian_loss(mesh.vertices, mesh.faces) / head.geometry.spacing**2,
            "departure": departure_loss(head.geometry, mesh.found),
        }
        loss = torch.stack([getattr(self._weights, name) * term for name, term in terms.items()]).sum()
        return MeshStep(loss, {name: term.detach() for name, term in terms.items()}, images)


def mesh_images(mesh: PosedMesh, cameras: list[Camera], background: Float[Tensor, "3"]) -> MeshImages:
    """Draw a posed mesh."""
    drawn = rasterize(mesh.gaussians(), cameras, background=background)
    return MeshImages(drawn.features, drawn.alpha)


def seen_without_hair(hair: Float[Tensor, "v h w"]) -> Bool[Tensor, "v h w"]:
    """Which pixels show no hair, nor do their neighbours: what lies under hair is not known, so it does not count.

    Args:
        hair: coverage of visible hair in [0, 1].
    """
    window = 2 * _MARGIN + 1
    spread = torch.nn.functional.max_pool2d(hair[:, None], window, stride=1, padding=_MARGIN)[:, 0]
    return spread < _HAIR


def image_loss(
    predicted: Float[Tensor, "v h w 3"], target: Float[Tensor, "v h w 3"], counted: Bool[Tensor, "v h w"]
) -> Float[Tensor, ""]:
    """Mean absolute difference over the counted pixels; nought where none is counted."""
    share = counted[..., None].to(predicted)
    return ((predicted - target).abs() * share).sum() / (3 * share.sum()).clamp_min(1)


def departure_loss(surface: NeuralSurface, found: Extraction) -> Float[Tensor, ""]:
    """How unevenly the signed distance departs from that of the first shape.

    The departure's variance within a tetrahedron, summed over the corners, in squared cubes, and averaged over the
    tetrahedra: up to a factor its squared gradient.

    What hair hides no image shapes. There the surface keeps the first shape's form, and goes along with what is seen
    beside it; left to itself the network would make waves.

    Args:
        surface: knows the first shape.
        found: what the network said near the surface.
    """
    departure = (found.field.sdf - surface.first[found.rows]) / surface.spacing
    corners = departure.index_select(0, found.tetrahedra.flatten()).view(-1, 4)
    return (corners - corners.mean(1, keepdim=True)).square().sum(1).mean()


def mean_square(lengths: Float[Tensor, "k 3"]) -> Float[Tensor, ""]:
    """Mean squared coordinate in canonical units.

    Args:
        lengths: metres.
    """
    return (lengths / CANONICAL_UNIT).square().mean()
