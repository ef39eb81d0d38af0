"""What head tracking found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray
from scipy.spatial.transform import Rotation

from dynhair.face import FaceModel
from dynhair.preprocess.tracking.anchored_head import Person
from dynhair.preprocess.tracking.diagnostics import TrackingDiagnostics
from dynhair.preprocess.tracking.noise import NoiseLevels, RotationNoise
from dynhair.preprocess.tracking.take_track import TakeTrack


@dataclass(frozen=True)
class TrackingResult:
    """Heads over all takes: ``x_world = rotation @ x_head + translation``, head coordinates being scaled model ones.

    Shoulders do not turn with the head: vertices whose head weight is below 1 are blended (linear blend skinning)
    between the head's pose and a pose of the body that is constant over a take: the median position of the head joint
    in the take, and the yaw of the average head over all takes, which is where the person faces.

    Attributes:
        model: the face model.
        person: scale, identity, and offsets of landmarks.
        takes: in the order given.
        body_rotation: the shoulders' frame to world.
        noise: of each take, what was found out about landmarks and motion.
        rotation_noise: what is left of noise in the derivatives of rotations, by comparison of two halves of the
            cameras, or by the smoother's covariance where there is one camera. None if all takes are under five frames.
        diagnostics: what residuals say about cameras and frames.
    """

    model: FaceModel
    person: Person
    takes: tuple[TakeTrack, ...]
    body_rotation: Float[ndarray, "3 3"]
    noise: tuple[NoiseLevels, ...]
    rotation_noise: RotationNoise | None
    diagnostics: TrackingDiagnostics

    def head_vertices(self, take: int, frame: int) -> Float[ndarray, "v 3"]:
        """The model's vertices in the head's frame, metres of the world."""
        expression = self.takes[take].motion.expressions[frame]
        shape = self.model.mean.numpy() + np.tensordot(self.person.identity, self.model.identity_modes.numpy(), 1)
        return self.person.scale * (shape + np.tensordot(expression, self.model.expression_modes.numpy(), 1))

    def vertices(self, take: int, frame: int) -> Float32[ndarray, "v 3"]:
        """The model's vertices in the world, metres."""
        track, points = self.takes[take], self.head_vertices(take, frame)
        with_head = points @ track.motion.rotations[frame].T + track.motion.translations[frame]
        with_body = points @ self.body_rotation.T + track.body_position
        weight = self.model.head_weight.numpy()[:, None]
        return (weight * with_head + (1 - weight) * with_body).astype(np.float32)

    def landmarks_3d(self, take: int, frame: int) -> Float32[ndarray, "66 3"]:
        """The 66 landmarks of captures in the world, metres."""
        return self.vertices(take, frame)[self.model.landmarks66.numpy()]


def facing_yaw(rotations: Float[ndarray, "f 3 3"]) -> Float[ndarray, "3 3"]:
    """The rotation about the world's vertical that comes closest to all."""
    total = rotations.sum(0)
    angle = np.arctan2(total[0, 2] - total[2, 0], total[0, 0] + total[2, 2])
    return Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
