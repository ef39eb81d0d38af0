"""A filmed person's expressions, counted from the person's own neutral face."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64

from dynhair.face import FaceModel
from dynhair.preprocess.landmarks import BLENDSHAPE_NAMES

_RESTING = 0.1
"""Quantile of each facial action that counts as neutral: who smiles through most of a film is smiling still."""


def expression_hints(model: FaceModel, blendshapes: Float64[np.ndarray, "f 52"]) -> Float64[np.ndarray, "f m"] | None:
    """What the detector says of a face model's expressions.

    A network that knows no person takes lids that are low by nature for half closed ones: what it says in nearly all
    frames is shape, and only what goes beyond is expression.

    Args:
        model: the face model.
        blendshapes: strengths of ``BLENDSHAPE_NAMES``.

    Returns:
        Strengths of the model's expressions; None if it has none of those.
    """
    column = {name: i for i, name in enumerate(BLENDSHAPE_NAMES)}
    if not column.keys() & set(model.expression_names):
        return None
    above = np.maximum(blendshapes - np.quantile(blendshapes, _RESTING, axis=0), 0.0)
    nothing = np.zeros(len(above))
    return np.stack([above[:, column[n]] if n in column else nothing for n in model.expression_names], axis=1)


def neutral_expression(model: FaceModel, expressions: Float32[np.ndarray, "f m"]) -> Float32[np.ndarray, " m"]:
    """The coefficients that are neutral for a person: none of those that start at nought, of others the median.

    Args:
        model: the face model.
        expressions: as they were tracked, with ``expression_hints`` where there are any.
    """
    if model.expression_range[0] >= 0:
        return np.zeros(expressions.shape[1], np.float32)
    return np.median(expressions, axis=0).astype(np.float32)
