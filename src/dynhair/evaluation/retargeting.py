"""Another person's head motion, moved to where an avatar can follow it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from dynhair.capture import Capture, HeadTrack, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.held_out import same_folder
from dynhair.motion import RestAlignment
from dynhair.training.rest import Rest

ON_HEAD = 0.99
"""Vertices of a tracked mesh that follow the head by at least this are the head's."""

SAME_MESH, SAME_LANDMARKS = 2e-3, 4e-3
"""Metres, mean distance of corresponding points up to which two heads at rest are one person's; landmarks also move
with the expression."""


class Retargeting:
    """Moves a driver's tracks as a whole so that its head at rest is the avatar's own; gravity is the avatar's.

    Args:
        own: the capture that the avatar was trained on.
        driver: the capture of the other person.

    Attributes:
        expressions: in words, where the expressions come from.
    """

    def __init__(self, own: Capture, driver: Capture) -> None:
        self._driver = driver
        self._own_rest, rest = Rest.of(own), Rest.of(driver)
        target, source = self._own_rest.track, rest.track
        self._alignment = RestAlignment.between(rest.pose, self._own_rest.pose)
        why = _mismatch(target, source)
        self._neutral = why is not None
        self.expressions = "the driver's coefficients" if why is None else f"neutral throughout: {why}"

    def track(self, segment: Segment) -> HeadTrack:
        """A segment of the driver as the avatar follows it, at the driver's frame rate."""
        source, target = self._driver.track(segment), self._own_rest.track
        expressions = source.expressions
        if self._neutral:
            expressions = np.zeros((segment.count, target.expressions.shape[1]), np.float32)
        return replace(
            self._alignment.track(source),
            expressions=expressions,
            gravity=target.gravity,
            expression_basis=target.expression_basis,
        )


def another_person(own: Capture, other: Capture) -> bool:
    """Whether two captures show different heads, by their shapes at rest, whatever their poses.

    Compared are the tracked meshes, or the landmarks where these have not the same topology; captures that have neither
    are taken to be of one person.
    """
    if same_folder(own.path, other.path):
        return False
    for points, most in ((_mesh_points, SAME_MESH), (_landmarks, SAME_LANDMARKS)):
        shapes = points(own), points(other)
        if shapes[0] is not None and shapes[1] is not None and shapes[0].shape == shapes[1].shape:
            return _distance(shapes[0], shapes[1]) > most
    return False


def _mismatch(own: HeadTrack, other: HeadTrack) -> str | None:
    """Why the coefficients of one head's expressions are no good for another's; None if they are."""
    bases = own.expression_basis, other.expression_basis
    if bases[0] is not None and bases[1] is not None and not bases[0].matches(bases[1]):
        return f"the driver's are of the face model '{bases[1].name}', the avatar's of '{bases[0].name}'"
    sizes = own.expressions.shape[1], other.expressions.shape[1]
    return None if sizes[0] == sizes[1] else f"the driver has {sizes[1]} coefficients, the avatar {sizes[0]}"


def _mesh_points(capture: Capture) -> Float64[np.ndarray, "p 3"] | None:
    mesh = capture.mesh
    if mesh is None:
        return None
    return capture.vertices(Rest.of(capture).frame)[mesh.follow >= ON_HEAD].astype(np.float64)


def _landmarks(capture: Capture) -> Float64[np.ndarray, "p 3"] | None:
    try:
        return capture.landmarks_3d(Rest.of(capture).frame).astype(np.float64)
    except DynhairError:
        return None


def _distance(first: Float64[np.ndarray, "p 3"], second: Float64[np.ndarray, "p 3"]) -> float:
    """Mean distance of corresponding points once one set is moved onto the other, rigidly."""
    first, second = first - first.mean(axis=0), second - second.mean(axis=0)
    turn = Rotation.align_vectors(first, second)[0]
    return float(np.linalg.norm(first - turn.apply(second), axis=1).mean())
