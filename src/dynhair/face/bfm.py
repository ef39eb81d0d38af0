"""The Basel Face Model of 2009, from the user's own MATLAB file.

Paysan et al., "A 3D Face Model for Pose and Illumination Invariant Face Recognition", AVSS 2009.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynhair.errors import DynhairError
from dynhair.face.foreign import PRINCIPAL_COMPONENTS, foreign_model
from dynhair.face.model import FaceModel

IDENTITIES = 80

_DEEP3D_FIELDS = ("meanshape", "idBase", "exBase", "tri", "keypoints")
_ORIGINAL_FIELDS = ("shapeMU", "shapePC", "shapeEV", "tl")
_DECIMETRE, _MICROMETRE = 0.1, 1e-6

# iBUG-68 on the original mesh of 53,490 vertices (A. Bas, BFMLandmarks), counted from 1.
_RIGHT_JAW = (22143, 22813, 22840, 23250, 44124, 45884, 47085, 47668, 48188)
_LEFT_JAW = (48708, 49299, 50498, 52457, 32022, 32386, 32359, 32979)
_BROWS = (38886, 39636, 40030, 40238, 40433, 41172, 41368, 41578, 42011, 42646)
_NOSE = (8291, 8305, 8314, 8320, 6783, 7687, 8331, 8977, 9879)
_EYES = (1832, 3760, 5050, 6087, 4546, 3516, 10731, 11758, 12919, 14859, 13191, 12157)
_OUTER_LIPS = (5523, 6155, 7442, 8345, 9506, 10799, 11199, 10179, 9277, 8374, 7471, 6566)
_INNER_LIPS = (5909, 7322, 8354, 9386, 10941, 9141, 8367, 7194)
LANDMARKS68 = (*_RIGHT_JAW, *_LEFT_JAW, *_BROWS, *_NOSE, *_EYES, *_OUTER_LIPS, *_INNER_LIPS)


def bfm(path: Path) -> FaceModel:
    """Read BFM with expressions as Deep3DFaceReconstruction and its followers store it, or the original without.

    The former (BFM09_model_info.mat, BFM_model_front.mat) holds 80 identities and 64 expressions, in decimetres; the
    latter (01_MorphableModel.mat) holds identities alone, in micrometres. The origin is the files': 13 cm behind the
    tip of the nose, at its height. There is no cranium: hair grows only where the mesh reaches above the hairline.

    Raises:
        DynhairError: the file is missing, is no MATLAB file, or has other fields.
    """
    from scipy.io import loadmat

    try:
        content = loadmat(path, variable_names=[*_DEEP3D_FIELDS, *_ORIGINAL_FIELDS])
    except (OSError, ValueError, TypeError, NotImplementedError, EOFError) as error:
        raise DynhairError(
            "the file is missing or is no MATLAB file", path=path, expected="BFM09_model_info.mat"
        ) from error
    fields = {name: array for name, array in content.items() if isinstance(array, np.ndarray)}
    if all(name in fields for name in _DEEP3D_FIELDS):
        read, expected = _deep3d, _DEEP3D_FIELDS
    elif all(name in fields for name in _ORIGINAL_FIELDS):
        read, expected = _original, _ORIGINAL_FIELDS
    else:
        missing = [name for name in _DEEP3D_FIELDS if name not in fields]
        raise DynhairError(
            f"there are no fields {', '.join(missing)}",
            path=path,
            expected=f"{', '.join(_DEEP3D_FIELDS)}; or {', '.join(_ORIGINAL_FIELDS)}",
        )
    try:
        mean, identities, expressions, faces, landmarks68 = read(fields)
        identities, expressions = identities.reshape(-1, *mean.shape), expressions.reshape(-1, *mean.shape)
        faces, landmarks68 = faces.astype(np.int64).reshape(-1, 3), landmarks68.astype(np.int64).reshape(68)
    except ValueError as error:
        raise DynhairError(
            f"its fields do not fit together: {error}", path=path, expected=f"one face in {', '.join(expected)}"
        ) from error
    return foreign_model(
        path,
        name="BFM 2009",
        mean=mean,
        identity_modes=identities[:IDENTITIES],
        expression_modes=expressions,
        expression_names=tuple(f"expression{index:02d}" for index in range(len(expressions))),
        faces=faces - 1,
        landmarks68=landmarks68 - 1,
        **PRINCIPAL_COMPONENTS,
    )


def _deep3d(fields: dict[str, np.ndarray]) -> tuple[np.ndarray, ...]:
    mean = fields["meanshape"].reshape(-1, 3) * _DECIMETRE
    identities, expressions = fields["idBase"].T * _DECIMETRE, fields["exBase"].T * _DECIMETRE
    return mean, identities, expressions, fields["tri"], fields["keypoints"]


def _original(fields: dict[str, np.ndarray]) -> tuple[np.ndarray, ...]:
    mean = fields["shapeMU"].reshape(-1, 3) * _MICROMETRE
    identities = (fields["shapePC"] * fields["shapeEV"].ravel()).T[:IDENTITIES] * _MICROMETRE
    return mean, identities, np.empty((0, *mean.shape)), fields["tl"], np.array(LANDMARKS68)
