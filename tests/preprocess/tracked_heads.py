"""The open head moving before cameras, with all that is true of it known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.spatial.transform import Rotation

from dynhair.face import FaceModel, open_head
from dynhair.face.anchors import Anchors
from dynhair.preprocess.tracking import Observations, TrackingResult
from dynhair.preprocess.tracking.anchored_head import AnchoredHead, Person
from dynhair.preprocess.tracking.head_motion import HeadMotion
from dynhair.preprocess.tracking.reprojection import project

FPS = 30.0
REST = np.array([0.1, 1.5, -0.2])


@dataclass(frozen=True)
class Scene:
    """A moving head and what cameras see of it."""

    person: Person
    motion: HeadMotion
    observed: Observations


def landmark_anchors(model: FaceModel, deviation: float = 1e-3) -> Anchors:
    """The iBUG-68 landmarks as anchors: corners of triangles."""
    triangles = model.faces.numpy()
    faces = np.array([np.flatnonzero((triangles == v).any(1))[0] for v in model.landmarks68.numpy()])
    barycentric = (triangles[faces] == model.landmarks68.numpy()[:, None]).astype(np.float64)
    return Anchors(np.arange(68), faces, barycentric, np.full(68, deviation), np.zeros((68, 3, 2)))


def smooth_motion(frames: int, modes: int, *, angle: float = 0.5, hertz: float = 0.8) -> HeadMotion:
    """A swing about the vertical with some nodding, shifting and talking."""
    phase = 2 * np.pi * hertz * np.arange(frames) / FPS
    vectors = angle * np.stack([0.4 * np.sin(0.7 * phase), np.sin(phase), 0.2 * np.sin(1.3 * phase + 1)], -1)
    shift = 0.03 * np.stack([np.sin(phase), 0.3 * np.cos(phase), 0.5 * np.sin(0.6 * phase)], -1)
    expressions = np.zeros((frames, modes))
    expressions[:, 20:24] = 0.3 * (1 - np.cos(phase[:, None] + np.arange(4)))
    return HeadMotion(Rotation.from_rotvec(vectors).as_matrix(), shift + REST, expressions)


def cameras_around(
    frames: int, angles: tuple[float, ...]
) -> tuple[Float[ndarray, "f v 3 4"], Float[ndarray, "f v 3 3"]]:
    """Cameras 1.3 m before the head, turned by angles in degrees."""
    w2c = []
    for angle in np.radians(angles):
        turn = np.diag([1.0, -1, -1]) @ Rotation.from_rotvec([0, -angle, 0]).as_matrix()
        centre = REST + 1.3 * np.array([np.sin(angle), 0, np.cos(angle)])
        w2c.append(np.c_[turn, -turn @ centre])
    K = np.array([[900.0, 0, 320], [0, 900, 240], [0, 0, 1]])
    return np.tile(w2c, (frames, 1, 1, 1)), np.tile(K, (frames, len(angles), 1, 1))


def scene(
    frames: int = 40,
    angles: tuple[float, ...] = (-45, -10, 15, 50),
    *,
    noise: float = 0.0,
    outliers: float = 0.0,
    scale: float = 1.0,
    unlike: float = 0.7,
    motion: HeadMotion | None = None,
    seed: int = 0,
) -> Scene:
    """Landmarks of a head, in pixels with normal errors, some of them anywhere about the face.

    Args:
        frames: how many.
        angles: of the cameras, degrees.
        noise: standard deviation, pixels.
        outliers: share of landmarks that are anywhere.
        scale: of the head.
        unlike: how uncommon the head is, standard deviations of the identity.
        motion: a swing by default.
        seed: of identity and noise.
    """
    rng = np.random.default_rng(seed)
    model = open_head()
    head = AnchoredHead.of(model, landmark_anchors(model))
    identity = unlike * rng.normal(size=head.identity_modes.shape[-1])
    person = Person(scale, identity, np.zeros_like(head.mean))
    motion = motion or smooth_motion(frames, head.expression_modes.shape[-1])
    w2c, K = cameras_around(frames, angles)
    points = project(motion.to_world(head.points(person, motion.expressions)), w2c, K)[0]
    wrong = rng.random(points.shape[:3]) < outliers
    points = points + noise * rng.normal(size=points.shape) + 60 * wrong[..., None] * rng.normal(size=points.shape)
    return Scene(person, motion, Observations(points, np.ones(points.shape[:3]), w2c, K, None, FPS, "swing"))


def without(observed: Observations, frames: slice = slice(None), views: slice = slice(None)) -> Observations:
    """Nothing seen in some frames of some views."""
    scores, points = observed.scores.copy(), observed.points.copy()
    scores[frames, views], points[frames, views] = 0, np.nan
    return replace(observed, scores=scores, points=points)


def rotation_errors(result: TrackingResult, truth: HeadMotion) -> Float[ndarray, " f"]:
    """Degrees between tracked and true rotations."""
    turned = truth.rotations.swapaxes(-1, -2) @ result.takes[0].motion.rotations
    return np.degrees(Rotation.from_matrix(turned).magnitude())


def position_errors(result: TrackingResult, truth: HeadMotion) -> Float[ndarray, " f"]:
    """Millimetres between tracked and true positions of the head."""
    return 1e3 * np.linalg.norm(result.takes[0].motion.translations - truth.translations, axis=1)
