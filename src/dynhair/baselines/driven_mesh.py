"""The tracked mesh as a function of the head's pose and expression, so that any motion can drive it."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from dynhair.avatar import ExpressionModes, HeadPose, head_pose
from dynhair.avatar.skinning import Skinning
from dynhair.capture import Capture
from dynhair.strands import Roots
from dynhair.training.frames import rest_frame
from dynhair.training.head_start import tracked_modes
from dynhair.training.surface import tracked_surface


class DrivenMesh(nn.Module):
    """A mesh whose vertices follow head and body and are displaced linearly by the expression.

    A head track holds no vertices, so the tracked ones are explained once, over the training segments, by what it does
    hold. The same mesh is then used in training and in reenactment.

    Args:
        rest: vertices in the rest frame, head frame, metres.
        faces: triangles, counter-clockwise seen from outside.
        follow: of each vertex, 0 for one that moves with the body to 1 for one that moves with the head.
        modes: displacements of the vertices by the expression.
        pose: the rest frame's.
    """

    rest: Tensor
    faces: Tensor
    follow: Tensor

    def __init__(
        self,
        rest: Float[Tensor, "v 3"],
        faces: Int64[Tensor, "f 3"],
        follow: Float[Tensor, " v"],
        modes: ExpressionModes,
        pose: HeadPose,
    ) -> None:
        super().__init__()
        self.register_buffer("rest", rest.clone())
        self.register_buffer("faces", faces.clone())
        self.register_buffer("follow", follow.clone())
        self.modes = modes.requires_grad_(False)
        self.skinning = Skinning(pose)

    @classmethod
    def tracked(cls, capture: Capture) -> DrivenMesh:
        """The capture's tracked mesh, or the open head in its place.

        Raises:
            DynhairError: the capture has neither a tracked mesh nor landmarks of a face.
        """
        surface = tracked_surface(capture)
        segment, index = rest_frame(capture)
        pose = head_pose(capture.track(segment), index)
        rest = (surface.vertices(segment.start + index) - pose.translation) @ pose.rotation
        rows = torch.arange(len(rest))
        modes = tracked_modes(surface, capture, _vertices(surface.faces, len(rest)), rows, rest, surface.follow, pose)
        return cls(rest, surface.faces, surface.follow, modes, pose)

    def forward(self, pose: HeadPose) -> Float[Tensor, "v 3"]:
        """The vertices in the world, metres."""
        return self.skinning.world(self.modes.displaced(self.rest, pose.expression), self.follow, pose)


def _vertices(faces: Int64[Tensor, "f 3"], count: int) -> Roots:
    """A mesh's vertices as points on its faces; one that no face has stands for a corner of the first."""
    face, slot = torch.zeros(count, dtype=torch.long), torch.zeros(count, dtype=torch.long)
    for corner in range(3):
        face[faces[:, corner]] = torch.arange(len(faces))
        slot[faces[:, corner]] = corner
    return Roots(face, faces[face], nn.functional.one_hot(slot, 3).float())
