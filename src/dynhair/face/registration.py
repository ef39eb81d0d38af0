"""Registering a face model to 3-D landmarks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.face.model import FaceModel
from dynhair.face.open_head import open_head

_LANDMARK_ERROR = 3e-3  # standard deviation, metres on the model
_WORST_MEDIAN = 0.012
_ITERATIONS = 30
_MOVES = 7  # unknowns of a similarity

_CHIN = 8
_OUTLINE = np.delete(np.arange(17), _CHIN)
_FIRM = np.delete(np.arange(66), _OUTLINE)


@dataclass(frozen=True)
class Registration:
    """A face model placed on landmarks: ``x = scale * rotation @ x_model + translation``.

    Attributes:
        model: what was placed.
        scale: units of the landmarks per metre of the model.
        rotation: model to landmarks.
        translation: of the model's origin, in units of the landmarks.
        identity: coefficients in standard deviations.
        expression: coefficients of the model's expression modes.
        landmark_distance: median distance to the model's landmarks, those of the outline apart, in the landmarks' unit.
    """

    model: FaceModel
    scale: float
    rotation: Float[Tensor, "3 3"]
    translation: Float[Tensor, "3"]
    identity: Float[Tensor, " k"]
    expression: Float[Tensor, " e"]
    landmark_distance: float

    def vertices(self, change: Float[Tensor, " e"] | None = None) -> Float[Tensor, "v 3"]:
        """The registered head in the landmarks' frame and unit.

        Args:
            change: added to the expression.
        """
        expression = self.expression if change is None else self.expression + change
        return self.scale * self.model.vertices(self.identity, expression) @ self.rotation.T + self.translation

    def expression_change(self, moved: Float[Tensor, "66 3"]) -> Float[Tensor, " e"]:
        """The change of expression that moves the landmarks most nearly as given.

        Ridge regression with the same errors and the same prior as the registration. It sees only how far landmarks
        moved: where they lie otherwise than the model's, that does not count as expression.

        Args:
            moved: displacement of each landmark since the registration, in the landmarks' frame and unit.
        """
        modes = self.model.expression_modes[:, self.model.landmarks66].flatten(1).double().T
        target = (moved.double() @ self.rotation.double() / self.scale).flatten()
        penalty = (_LANDMARK_ERROR / self.model.expression_deviation) ** 2
        ridge = penalty * torch.eye(modes.shape[1], dtype=torch.float64)
        return torch.linalg.solve(modes.T @ modes + ridge, modes.T @ target).float()


def register(landmarks: Float[Tensor, "66 3"], model: FaceModel | None = None) -> Registration:
    """Fit place, size, identity and expression of a face model to the landmarks of one frame.

    Maximum a posteriori, by Gauss-Newton from the closed-form similarity of the average head: identity coefficients
    have standard deviation 1 around nought, expression coefficients the model's; landmarks have heavy-tailed errors
    (Student's t), so that a few false ones do little. Landmarks may have any unit and any pose.

    Where along the face's outline the jaw's landmarks lie is a matter of the tracker's convention, and may differ by 3
    cm in depth. They therefore say only that the skin passes through them, except for the chin.

    Args:
        landmarks: iBUG-68 without 48 and 54.
        model: the open head by default.

    Raises:
        DynhairError: they are not finite, or do not form a face.
    """
    observed = landmarks.detach().double().numpy()
    if not np.isfinite(observed).all():
        raise DynhairError("3-D landmarks are not finite", expected="66 points", mend="run the landmark tracker again")
    head = open_head() if model is None else model
    mean = head.mean.double().numpy()
    modes = torch.cat([head.identity_modes, head.expression_modes]).double().numpy()
    sizes = len(head.identity_modes), len(head.expression_modes)
    prior = np.diag(np.repeat([0.0, 1.0, head.expression_deviation**-2], [_MOVES, *sizes]))
    firm = head.landmarks66.numpy()[_FIRM]
    skin = np.flatnonzero(head.head_weight.numpy() > 0.9)
    normals = _vertex_normals(mean, head.faces.numpy())

    scale, rotation, translation = closest_similarity(mean[firm], observed[_FIRM])
    coefficients = np.zeros(len(modes))
    for _ in range(_ITERATIONS if scale > 0 else 0):
        shape = mean + np.tensordot(coefficients, modes, axes=1)
        target = (observed - translation) @ rotation / scale
        outline = skin[cdist(target[_OUTLINE], shape[skin]).argmin(1)]
        outwards = normals[outline]
        gap = target[_FIRM] - shape[firm]
        height = ((target[_OUTLINE] - shape[outline]) * outwards).sum(1)
        weights = np.concatenate(
            [np.repeat(_student_weights(np.linalg.norm(gap, axis=1)), 3), _student_weights(height)]
        )
        # The unknowns: a turn, growth and shift of the model, each small, and the new coefficients as a whole.
        at_firm = _columns(shape[firm], modes[:, firm])
        at_outline = np.einsum("ni,niu->nu", outwards, _columns(shape[outline], modes[:, outline]))
        columns = np.concatenate([at_firm.reshape(-1, at_firm.shape[-1]), at_outline])
        wanted = np.concatenate([gap.ravel(), height]) + columns[:, _MOVES:] @ coefficients
        weighted = columns * weights[:, None]
        solution = np.linalg.solve(weighted.T @ columns + prior * _LANDMARK_ERROR**2, weighted.T @ wanted)
        turn, growth, shift, coefficients = np.split(solution, [3, 4, _MOVES])
        translation = translation + scale * rotation @ shift
        rotation = rotation @ Rotation.from_rotvec(turn).as_matrix()
        scale *= float(np.exp(growth[0]))

    fitted = scale * (mean[firm] + np.tensordot(coefficients, modes[:, firm], axes=1)) @ rotation.T + translation
    distance = float(np.median(np.linalg.norm(fitted - observed[_FIRM], axis=1)))
    mirrored = np.linalg.det((observed[_FIRM] - observed[_FIRM].mean(0)).T @ (mean[firm] - mean[firm].mean(0))) < 0
    if mirrored or not distance < _WORST_MEDIAN * scale:
        raise DynhairError(
            "3-D landmarks do not form a face",
            expected="iBUG-68 without 48 and 54, in that order, the person's right first",
            mend="check the order of the landmarks, and that x, y and z make a right-handed frame",
        )
    identity, expression = np.split(coefficients.astype(np.float32), [sizes[0]])
    return Registration(
        model=head,
        scale=scale,
        rotation=torch.from_numpy(rotation).float(),
        translation=torch.from_numpy(translation).float(),
        identity=torch.from_numpy(identity),
        expression=torch.from_numpy(expression),
        landmark_distance=distance,
    )


def closest_similarity(
    source: Float[np.ndarray, "n 3"], target: Float[np.ndarray, "n 3"]
) -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """Scale, rotation and translation that bring points closest to others (Umeyama, PAMI 1991, eq. 39 to 43)."""
    from_mean, to_mean = source.mean(0), target.mean(0)
    centred = source - from_mean
    left, singular, right = np.linalg.svd((target - to_mean).T @ centred)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left * signs) @ right
    scale = float((singular * signs).sum() / (centred**2).sum())
    return scale, rotation, to_mean - scale * rotation @ from_mean


def _columns(points: Float[np.ndarray, "n 3"], modes: Float[np.ndarray, "m n 3"]) -> Float[np.ndarray, "n 3 u"]:
    """How points change with a turn (3), growth (1) and shift (3) of the model, and with its coefficients (m)."""
    axes = np.eye(3)[:, None]
    moves = [np.cross(axes, points), points[None], np.broadcast_to(axes, (3, *points.shape))]
    return np.moveaxis(np.concatenate([*moves, modes]), 0, -1)


def _student_weights(distances: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Weights of iteratively reweighted least squares for Student's t with 3 degrees of freedom, up to a factor."""
    return 1 / (1 + (distances / _LANDMARK_ERROR) ** 2 / 3)


def _vertex_normals(vertices: Float[np.ndarray, "v 3"], faces: Int64[np.ndarray, "f 3"]) -> Float[np.ndarray, "v 3"]:
    a, b, c = vertices[faces].swapaxes(0, 1)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], np.cross(b - a, c - a))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
