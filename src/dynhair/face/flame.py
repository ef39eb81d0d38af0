"""FLAME, from the user's own file.

Li et al., "Learning a model of facial shape and expression from 4D scans", SIGGRAPH Asia 2017.
"""

from __future__ import annotations

from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from dynhair.errors import DynhairError
from dynhair.face.array_pickle import read_arrays
from dynhair.face.foreign import PRINCIPAL_COMPONENTS, foreign_model
from dynhair.face.model import FaceModel

FIELDS = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "f")
VERTICES = 5023
IDENTITIES = 100  # of the 300 that precede the expressions in shapedirs
EXPRESSIONS = 50
_FIRST_EXPRESSION = 300

# Joints: 0 the trunk, 1 the neck, 2 the jaw, 3 and 4 the eyes.
_TRUNK, _NECK, _JAW = 0, 1, 2
# Axis times angle of one standard deviation: open, to the left. ARKit's names would promise strengths.
_JAW_TURNS = {"jawPitch": (0.15, 0.0, 0.0), "jawYaw": (0.0, 0.05, 0.0)}

# iBUG-68: the vertices nearest to the landmarks that are published with FLAME.
_RIM = (2210, 1963, 3056, 3424, 3423, 3421, 3419, 3416, 3414, 3635, 3643, 3646, 3650, 3652, 2004, 568, 728)
_BROWS = (2567, 337, 338, 3154, 3712, 3868, 2135, 27, 18, 1430)
_NOSE = (3560, 3561, 3501, 3564, 2751, 2793, 3556, 1676, 1623)
_EYES = (2428, 2453, 2494, 3631, 2278, 2359, 3832, 1343, 1218, 1154, 995, 829)
_OUTER_LIPS = (2820, 2864, 2774, 3543, 1657, 1749, 1703, 1774, 1802, 3503, 2905, 2881)
_INNER_LIPS = (2845, 2787, 3531, 1670, 1730, 1804, 3504, 2907)
LANDMARKS68 = (*_RIM, *_BROWS, *_NOSE, *_EYES, *_OUTER_LIPS, *_INNER_LIPS)


def flame(path: Path) -> FaceModel:
    """Read FLAME 2020 or 2023 from its pickle, or from an .npz of the same fields.

    The pickle is read without running it (`array_pickle`). The first 100 identities and 50 expressions are taken. FLAME
    opens its mouth with a joint: two more expressions are straight lines in its place, from the average head to where
    it opens by 17 degrees, or moves to the left by 6, pose correctives included; a chin at 30 degrees is then off by a
    tenth of its way. Neck and eyes do not turn. The origin is the neck joint of the average head; everything but the
    trunk's share moves with the head.

    Raises:
        DynhairError: the file is missing, is not FLAME's, or its pickle names anything but arrays.
    """
    arrays = _npz(path) if path.suffix == ".npz" else read_arrays(path, FIELDS)
    try:
        mean = arrays["v_template"].astype(np.float64).reshape(VERTICES, 3)
        shapes = arrays["shapedirs"].astype(np.float64).reshape(VERTICES, 3, -1)
        correctives = arrays["posedirs"].astype(np.float64).reshape(VERTICES, 3, 4, 9)
        joints = arrays["J_regressor"].astype(np.float64).reshape(5, VERTICES) @ mean
        weights = arrays["weights"].astype(np.float64).reshape(VERTICES, 5)
        faces = arrays["f"].astype(np.int64).reshape(-1, 3)
    except ValueError as error:
        raise DynhairError(f"its fields have other sizes: {error}", path=path, expected="FLAME 2020 or 2023") from error
    last = _FIRST_EXPRESSION + EXPRESSIONS
    if shapes.shape[2] < last:
        raise DynhairError(f"shapedirs has {shapes.shape[2]} components", path=path, expected=f"{last} or more")
    jaw = [
        _jaw_mode(deviation, mean, joints[_JAW], weights[:, _JAW], correctives[:, :, _JAW - 1])
        for deviation in _JAW_TURNS.values()
    ]
    components = np.moveaxis(shapes, 2, 0)
    names = tuple(f"expression{index:02d}" for index in range(EXPRESSIONS))
    return foreign_model(
        path,
        name="FLAME",
        mean=mean - joints[_NECK],
        identity_modes=components[:IDENTITIES],
        expression_modes=np.concatenate([components[_FIRST_EXPRESSION:last], jaw]),
        expression_names=(*names, *_JAW_TURNS),
        faces=faces,
        landmarks68=np.array(LANDMARKS68),
        head_weight=1 - weights[:, _TRUNK],
        **PRINCIPAL_COMPONENTS,
    )


def _jaw_mode(
    deviation: tuple[float, float, float],
    mean: Float[np.ndarray, "v 3"],
    joint: Float[np.ndarray, " 3"],
    weights: Float[np.ndarray, " v"],
    correctives: Float[np.ndarray, "v 3 9"],
) -> Float[np.ndarray, "v 3"]:
    """Half of how vertices move when a joint turns by two standard deviations: linear blend skinning with correctives.

    Args:
        deviation: axis times angle of one standard deviation.
        mean: vertices at rest.
        joint: what they turn about.
        weights: skinning weights of the joint.
        correctives: offsets for each entry of the joint's rotation matrix less the identity, row by row.
    """
    turn = Rotation.from_rotvec(2 * np.array(deviation)).as_matrix()
    corrected = mean + correctives @ (turn - np.eye(3)).ravel()
    turned = joint + (corrected - joint) @ turn.T
    return (corrected + weights[:, None] * (turned - corrected) - mean) / 2


def _npz(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in FIELDS}
    except (OSError, BadZipFile, EOFError, KeyError, ValueError) as error:
        raise DynhairError(f"not readable as .npz: {error}", path=path, expected=", ".join(FIELDS)) from error
