"""First guess of poses: every view alone by weak perspective, then what the views agree on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.spatial.transform import Rotation, Slerp

from dynhair.preprocess.tracking.observations import Observations

_FEWEST_LANDMARKS = 6
_ROUNDS = 15
_AGREE = np.radians(20)
_SMALLEST_BASELINE = 0.02  # of the distance: below it the depth of a head of unknown size is a matter of guessing


@dataclass(frozen=True)
class ViewPoses:
    """The pose of the average head at natural size, guessed from each view alone.

    Attributes:
        rotations: head to world.
        offsets: from the camera to the head joint in the world, metres.
        sizes: side of the face in the image, pixels.
        trust: weight of the guess; 0 where there is none.
    """

    rotations: Float[ndarray, "f v 3 3"]
    offsets: Float[ndarray, "f v 3"]
    sizes: Float[ndarray, "f v"]
    trust: Float[ndarray, "f v"]


def view_poses(points: Float[ndarray, "n 3"], observed: Observations) -> ViewPoses:
    """Weak-perspective pose from every view alone, robust to false landmarks.

    Pixels become rays, and rays are looked at by a virtual camera that faces the middle of the landmarks. There, pixels
    are an affine function of the model's points, found by iteratively reweighted least squares (Cauchy's weights about
    the median error), and its nearest scaled rotation is the pose.

    Args:
        points: the landmarks on the average head, metres.
        observed: landmarks of a take.
    """
    frames, views, count = observed.scores.shape
    valid = observed.scores > 0
    enough = valid.sum(-1) >= _FEWEST_LANDMARKS
    homogeneous = np.concatenate(
        [np.where(valid[..., None], observed.points, 0.0), np.ones((frames, views, count, 1))], -1
    )
    rays = homogeneous @ np.linalg.inv(observed.K).swapaxes(-1, -2)
    facing = _facing(_masked_median(rays, valid & enough[..., None]))  # camera to virtual camera
    seen = rays @ facing.swapaxes(-1, -2)
    flat = seen[..., :2] / np.where(seen[..., 2:] > 0.05, seen[..., 2:], np.inf)

    centre = points.mean(0)
    design = np.concatenate([points - centre, np.ones((count, 1))], 1)
    weights = np.where(enough[..., None], observed.scores, 0.0)
    belief = np.ones_like(weights)
    ridge = 1e-12 * np.eye(4)
    affine = np.zeros((frames, views, 4, 2))
    typical = np.zeros((frames, views))
    for _ in range(_ROUNDS):
        weighted = np.swapaxes((weights * belief)[..., None] * design, -1, -2)
        affine = np.linalg.solve(weighted @ design + ridge, weighted @ flat)
        errors = np.linalg.norm(flat - design @ affine, axis=-1)
        typical = np.maximum(_masked_median(errors[..., None], weights > 0)[..., 0], 1e-9)
        belief = 1 / (1 + (errors / typical[..., None]) ** 2)

    left, stretch, right = np.linalg.svd(affine[..., :3, :].swapaxes(-1, -2), full_matrices=False)
    magnification = np.maximum(stretch.mean(-1), 1e-9)
    rows = left @ right
    turn = np.concatenate([rows, np.cross(rows[..., :1, :], rows[..., 1:, :])], -2)
    ahead = np.concatenate([affine[..., 3, :], np.ones((frames, views, 1))], -1) / magnification[..., None]
    to_world = observed.w2c[..., :3].swapaxes(-1, -2) @ facing.swapaxes(-1, -2)
    extent = np.ptp((points - centre) @ rows.swapaxes(-1, -2), axis=-2).max(-1)
    focal = np.sqrt(observed.K[..., 0, 0] * observed.K[..., 1, 1])
    relative_error = typical / (magnification * np.maximum(extent, 1e-9))
    found = enough & (stretch[..., 1] > 1e-9)
    trust = observed.scores.mean(-1) / (0.02**2 + relative_error**2)
    return ViewPoses(
        rotations=to_world @ turn,
        offsets=(to_world @ (ahead - turn @ centre)[..., None])[..., 0],
        sizes=np.where(found, magnification * extent * focal, 1.0),
        trust=np.where(found, trust, 0.0),
    )


def agreed_rotations(poses: ViewPoses) -> Float[ndarray, "f 3 3"]:
    """One rotation a frame: of all views' the one that the others are closest to, averaged with those close to it.

    Frames without any view have the identity.
    """
    vectors = Rotation.from_matrix(
        (poses.rotations[:, :, None].swapaxes(-1, -2) @ poses.rotations[:, None]).reshape(-1, 3, 3)
    ).magnitude()
    angles = vectors.reshape(len(poses.trust), *2 * poses.trust.shape[1:])
    disagreement = (np.minimum(angles, _AGREE) * poses.trust[:, None]).sum(-1)
    best = np.where(poses.trust > 0, disagreement, np.inf).argmin(1)
    near = np.take_along_axis(angles, best[:, None, None], axis=1)[:, 0] < _AGREE
    total = ((poses.trust * near)[..., None, None] * poses.rotations).sum(1)
    total = np.where((poses.trust.sum(1) > 0)[:, None, None], total, np.eye(3))
    left, _, right = np.linalg.svd(total)
    sign = np.linalg.det(left @ right)[:, None] ** np.array([0, 0, 1])
    return (left * sign[:, None]) @ right


def agreed_scale(takes: Sequence[Observations], poses: Sequence[ViewPoses]) -> float:
    """The size of the head at which all views put it at the same place; 1 if the views cannot tell.

    A head of another size would be at another distance, but on the same ray: with head positions linear in the scale,
    the best scale is a least-squares solution.
    """
    products = squares = baselines = distances = 0.0
    for observed, guess in zip(takes, poses, strict=True):
        centres = camera_centres(observed.w2c)
        weights = (guess.trust / np.maximum(guess.trust.sum(1, keepdims=True), 1e-12))[..., None]
        apart = centres - (weights * centres).sum(1, keepdims=True)
        spread = guess.offsets - (weights * guess.offsets).sum(1, keepdims=True)
        products -= (weights * apart * spread).sum()
        squares += (weights * spread**2).sum()
        baselines += (weights * apart**2).sum()
        distances += (weights * guess.offsets**2).sum()
    if baselines <= _SMALLEST_BASELINE**2 * distances or products <= 0:
        return 1.0
    return float(products / squares)


def agreed_positions(observed: Observations, poses: ViewPoses, scale: float) -> Float[ndarray, "f 3"]:
    """Position of the head joint: the weighted geometric median of what the views guess; nought where there is none."""
    guesses = camera_centres(observed.w2c) + scale * poses.offsets
    weights = poses.trust
    position = np.zeros((len(guesses), 3))
    for _ in range(_ROUNDS):
        position = (weights[..., None] * guesses).sum(1) / np.maximum(weights.sum(1), 1e-12)[:, None]
        weights = poses.trust / np.maximum(np.linalg.norm(guesses - position[:, None], axis=-1), 1e-3)
    return position


def camera_centres(w2c: Float[ndarray, "*b 3 4"]) -> Float[ndarray, "*b 3"]:
    """Where cameras are in the world."""
    return -(w2c[..., :3].swapaxes(-1, -2) @ w2c[..., 3:])[..., 0]


def bridge(
    rotations: Float[ndarray, "f 3 3"], translations: Float[ndarray, "f 3"], known: Bool[ndarray, " f"]
) -> tuple[Float[ndarray, "f 3 3"], Float[ndarray, "f 3"]]:
    """Poses between known frames by interpolation; before the first and after the last, the nearest known one.

    Args:
        rotations: any rotation where not known.
        translations: anything where not known.
        known: at least one must be.
    """
    frames = np.flatnonzero(known).astype(np.float64)
    wanted = np.clip(np.arange(len(known)), frames[0], frames[-1])
    positions = np.stack([np.interp(wanted, frames, translations[known, axis]) for axis in range(3)], axis=-1)
    if len(frames) == 1:
        return np.repeat(rotations[known], len(known), axis=0), positions
    return Slerp(frames, Rotation.from_matrix(rotations[known]))(wanted).as_matrix(), positions


def _facing(direction: Float[ndarray, "f v 3"]) -> Float[ndarray, "f v 3 3"]:
    """The smallest turns that bring directions before the camera onto its axis."""
    unit = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    axis = np.cross(unit, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    vectors = axis / np.maximum(sine, 1e-12) * np.arctan2(sine, unit[..., 2:])
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(*direction.shape, 3)


def _masked_median(values: Float[ndarray, "f v n d"], valid: Bool[ndarray, "f v n"]) -> Float[ndarray, "f v d"]:
    """Median over valid points; of rays without any point the camera's axis, of other values 1."""
    ordered = np.sort(np.where(valid[..., None], values, np.inf), axis=2)
    middle = np.maximum(valid.sum(2) - 1, 0)[..., None, None] // 2
    median = np.take_along_axis(ordered, np.broadcast_to(middle, (*middle.shape[:2], 1, values.shape[-1])), axis=2)[
        :, :, 0
    ]
    fallback = np.eye(values.shape[-1])[-1]
    return np.where(np.isfinite(median), median, fallback)
