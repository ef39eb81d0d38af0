"""The surface of head and shoulders in every frame: the tracker's mesh, or the open head in its place."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.face import Registration, register
from dynhair.training.frames import head_frame, rest_frame


@dataclass(frozen=True)
class TrackedSurface(ABC):
    """A mesh that moves with the person.

    Attributes:
        capture: where its motion is read.
        faces: triangles, counter-clockwise seen from outside.
        scalp: indices of the faces that grow hair.
        follow: of each vertex, 0 for one that moves with the body to 1 for one that moves with the head.
    """

    capture: Capture
    faces: Int64[Tensor, "f 3"]
    scalp: Int64[Tensor, " s"]
    follow: Float[Tensor, " v"]

    @abstractmethod
    def vertices(self, frame: int) -> Float[Tensor, "v 3"]:
        """Positions in one frame, world, metres, float32."""


def tracked_surface(capture: Capture) -> TrackedSurface:
    """The capture's own mesh where it has one, else the open head registered to its landmarks.

    Raises:
        DynhairError: there is no mesh, and the rest frame's landmarks are missing or do not form a face.
    """
    mesh = capture.mesh
    if mesh is None:
        return RegisteredHead.to(capture)
    return OwnMesh(capture, torch.from_numpy(mesh.faces), torch.from_numpy(mesh.scalp), torch.from_numpy(mesh.follow))


@dataclass(frozen=True)
class OwnMesh(TrackedSurface):
    """The mesh that the capture's tracker left."""

    def vertices(self, frame: int) -> Float[Tensor, "v 3"]:
        """Positions in one frame, world, metres, float32."""
        return torch.from_numpy(self.capture.vertices(frame))


@dataclass(frozen=True)
class RegisteredHead(TrackedSurface):
    """The open head, registered in the rest frame and moved with the tracked pose.

    In another frame the landmarks' own motion within the head changes the expression, and the result moves rigidly with
    the head's pose. The shoulders stay where they were in the rest frame, for nothing tracks them; the neck between is
    blended by the head bone's weight (linear blend skinning).

    Attributes:
        registration: of the rest frame, in its head frame, metres.
        landmarks: of the rest frame, in its head frame.
        rest: the frame's id.
    """

    registration: Registration
    landmarks: Float[Tensor, "66 3"]
    rest: int

    @classmethod
    def to(cls, capture: Capture) -> RegisteredHead:
        """Register the open head to the capture's rest frame.

        Raises:
            DynhairError: its landmarks are missing or do not form a face.
        """
        segment, index = rest_frame(capture)
        frame = segment.start + index
        landmarks = head_frame(capture.track(segment), index)(torch.from_numpy(capture.landmarks_3d(frame)))
        try:
            registration = register(landmarks)
        except DynhairError as error:
            path = capture.layout.landmarks_3d(frame)
            raise DynhairError(error.message, path=path, expected=error.expected, mend=error.mend) from error
        head = registration.model
        return cls(capture, head.faces, head.scalp, head.head_weight, registration, landmarks, frame)

    def vertices(self, frame: int) -> Float[Tensor, "v 3"]:
        """Positions in one frame, world, metres, float32."""
        rotation, translation = self._pose(frame)
        landmarks = (torch.from_numpy(self.capture.landmarks_3d(frame)) - translation) @ rotation
        change = self.registration.expression_change(landmarks - self.landmarks)
        head = self.registration.vertices(change)
        rest_rotation, rest_translation = self._pose(self.rest)
        weight = self.registration.model.head_weight[:, None]
        moving, resting = head @ rotation.T + translation, head @ rest_rotation.T + rest_translation
        return weight * moving + (1 - weight) * resting

    def _pose(self, frame: int) -> tuple[Float[Tensor, "3 3"], Float[Tensor, "3"]]:
        segment = next(segment for segment in self.capture.segments if frame in segment.frames)
        track, index = self.capture.track(segment), frame - segment.start
        return torch.from_numpy(track.rotations[index]).float(), torch.from_numpy(track.translations[index]).float()
