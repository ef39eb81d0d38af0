"""Bringing other people's face models to this project's conventions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int64

from dynhair.errors import DynhairError
from dynhair.face.model import FaceModel

BLENDSHAPES = {"expression_range": (0.0, 1.0), "expression_deviation": 0.3}
PRINCIPAL_COMPONENTS = {"expression_range": (-3.0, 3.0), "expression_deviation": 1.0}

# Seen in profile, the open head's hairline from the nape over the ear to the forehead, and the plane between its head
# and its neck, fitted to its scalp and to its skinning weights. Forward from the front of the ears and up from the
# brows, in units of the height from the base of the nose to the brows.
_HAIRLINE = np.array([[-1.5, -0.82], [-1.1, -0.6], [-0.8, 0.02], [0.0, 0.06], [0.3, 0.31], [0.9, 0.65]])
_NECK_TOP, _NECK_SLOPE, _NECK_LENGTH = -1.5, -0.8, 1.25


def foreign_model(
    path: Path,
    *,
    name: str,
    mean: Float[np.ndarray, "v 3"],
    identity_modes: Float[np.ndarray, "k v 3"],
    expression_modes: Float[np.ndarray, "e v 3"],
    expression_names: tuple[str, ...],
    expression_range: tuple[float, float],
    expression_deviation: float,
    faces: Int64[np.ndarray, "f 3"],
    landmarks68: Int64[np.ndarray, " 68"],
    head_weight: Float[np.ndarray, " v"] | None = None,
) -> FaceModel:
    """Make a model of arrays in metres, with y up and the face towards +z.

    Triangles may be wound either way. Where the file does not say which faces grow hair, or what moves with the head,
    that is taken from the open head's hairline and neck, laid over the model's landmarks.

    Args:
        path: the file or folder that the arrays came from, for errors.
        name: which model it is.
        mean: the average head.
        identity_modes: offsets of one standard deviation each.
        expression_modes: offsets for a coefficient of 1.
        expression_names: what the expression coefficients do.
        expression_range: coefficients beyond it are not natural.
        expression_deviation: standard deviation of the expression coefficients.
        faces: triangles.
        landmarks68: vertex indices of the iBUG-68 landmarks.
        head_weight: skinning weight of the head's bone.

    Raises:
        DynhairError: the landmarks do not form an upright face of natural size.
    """
    indices = np.concatenate([faces.ravel(), landmarks68])
    finite = all(np.isfinite(array).all() for array in (mean, identity_modes, expression_modes))
    if not finite or indices.min() < 0 or indices.max() >= len(mean) or not _is_face(mean[landmarks68]):
        raise DynhairError(
            "this is no face that stands upright, looks towards +z and has a natural size",
            path=path,
            expected=f"the arrays of {name} as it is published",
            mend="check that the file is of that model, in its own unit and axes",
        )
    profile = _profile(mean, landmarks68)
    if head_weight is None:
        head_weight = _neck_weight(profile)
    return FaceModel(
        name=name,
        mean=torch.from_numpy(mean.astype(np.float32)),
        identity_modes=torch.from_numpy(identity_modes.astype(np.float32)),
        expression_modes=torch.from_numpy(expression_modes.astype(np.float32)),
        expression_names=expression_names,
        expression_range=expression_range,
        expression_deviation=expression_deviation,
        faces=torch.from_numpy(_counter_clockwise(mean, faces, int(landmarks68[30]))),
        scalp=torch.from_numpy(_hairy_faces(profile, faces)),
        head_weight=torch.from_numpy(head_weight.astype(np.float32)),
        landmarks68=torch.from_numpy(landmarks68),
    )


def _is_face(marks: Float[np.ndarray, "68 3"]) -> bool:
    right_eye, left_eye = marks[36:42].mean(0), marks[42:48].mean(0)
    eyes, nose, mouth, chin = (right_eye + left_eye) / 2, marks[30], marks[48:].mean(0), marks[8]
    upright = eyes[1] > nose[1] > mouth[1] > chin[1] and nose[2] > eyes[2] > marks[[0, 16], 2].mean()
    across = (left_eye - right_eye)[0]
    return bool(upright and 0.04 < across < 0.09 and 0.06 < eyes[1] - chin[1] < 0.18)


def _profile(vertices: Float[np.ndarray, "v 3"], landmarks68: Int64[np.ndarray, " 68"]) -> Float[np.ndarray, "v 2"]:
    """How far forward of the ears and above the brows, in heights from the base of the nose to the brows."""
    marks = vertices[landmarks68]
    brows, base, ears = marks[17:27, 1].mean(), marks[33, 1], marks[[0, 16], 2].mean()
    return (vertices[:, [2, 1]] - [ears, brows]) / (brows - base)


def _hairy_faces(profile: Float[np.ndarray, "v 2"], faces: Int64[np.ndarray, "f 3"]) -> Int64[np.ndarray, " s"]:
    forward, up = profile[faces].mean(1).T
    return np.flatnonzero(up > np.interp(forward, *_HAIRLINE.T))


def _neck_weight(profile: Float[np.ndarray, "v 2"]) -> Float[np.ndarray, " v"]:
    forward, up = profile.T
    return np.clip(1 + (up - _NECK_TOP - _NECK_SLOPE * forward) / _NECK_LENGTH, 0, 1)


def _counter_clockwise(
    vertices: Float[np.ndarray, "v 3"], faces: Int64[np.ndarray, "f 3"], nose: int
) -> Int64[np.ndarray, "f 3"]:
    """Triangles wound so that the tip of the nose looks forward."""
    a, b, c = vertices[faces[(faces == nose).any(1)]].swapaxes(0, 1)
    forward = np.cross(b - a, c - a)[:, 2].sum() >= 0
    return np.ascontiguousarray(faces if forward else faces[:, ::-1])
