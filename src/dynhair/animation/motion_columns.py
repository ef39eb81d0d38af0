"""What a motion file holds, whatever its format: named columns, and what makes them a sound motion."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from dynhair.animation.procedural import PIVOT
from dynhair.animation.timed_motion import EARTH_GRAVITY, RestPose, TimedMotion
from dynhair.capture import ExpressionBasis
from dynhair.errors import DynhairError

Columns = dict[str, np.ndarray]


class Column(NamedTuple):
    """A column of a motion file.

    Attributes:
        shapes: that it may have, without the frames' axis; None stands for any number.
        per_frame: whether it has a row for each frame.
        text: whether it holds words.
    """

    shapes: tuple[tuple[int | None, ...], ...]
    per_frame: bool = False
    text: bool = False


COLUMNS = {
    "time": Column(((),), per_frame=True),
    "fps": Column(((),)),
    "rotation": Column(((4,), (3,), (3, 3)), per_frame=True),
    "translation": Column(((3,),), per_frame=True),
    "expression": Column(((None,),), per_frame=True),
    "expression_names": Column(((None,),), text=True),
    "expression_basis": Column(((),), text=True),
    "gravity": Column(((3,),)),
    "rest_rotation": Column(((4,), (3,), (3, 3))),
    "rest_translation": Column(((3,),)),
    "rest_expression": Column(((None,),)),
}

_UNIT = 0.05
"""By which a quaternion's length, and a matrix' columns, may be off before they are no rotation."""

_ROOM = 10.0
"""Metres; a head that travels further was probably given in millimetres."""


def motion_columns(motion: TimedMotion) -> Columns:
    """The columns that a motion is written as; rotations as unit quaternions, wxyz."""
    basis, rest = motion.expression_basis, motion.rest
    columns = {
        "time": motion.times,
        "rotation": _quaternions(motion.rotations),
        "translation": motion.translations,
        "expression": motion.expressions,
        "gravity": motion.gravity,
        "rest_rotation": _quaternions(rest.rotation),
        "rest_translation": rest.translation,
        "rest_expression": rest.expression,
    }
    if basis is not None:
        columns["expression_basis"] = np.array(basis.name)
        if basis.names:
            columns["expression_names"] = np.array(basis.names)
    return columns


def motion_of_columns(columns: Columns, path: Path) -> TimedMotion:
    """Make sure that columns hold a sound motion, and return it.

    Raises:
        DynhairError: a column is missing, of another shape, or does not hold what it should.
    """
    columns = {name: _checked(name, value, path) for name, value in columns.items() if name in COLUMNS}
    if "rotation" not in columns:
        raise DynhairError("there is no `rotation`", path=path, expected="rotations of the head, a row for each frame")
    frames = len(columns["rotation"])
    for name, value in columns.items():
        if COLUMNS[name].per_frame and len(value) != frames:
            raise DynhairError(f"`{name}` has {len(value)} rows", path=path, expected=f"{frames}, as `rotation` has")
    if frames < 2:
        raise DynhairError("the motion has a single frame", path=path, expected="two or more")
    rotations = _rotations("rotation", columns["rotation"], path)
    translations = columns.get("translation", PIVOT - rotations @ PIVOT)
    rest_translation = columns["rest_translation"] if "rest_translation" in columns else translations[0]
    travel = float(np.ptp(np.append(translations, rest_translation[None], axis=0), axis=0).max())
    if travel > _ROOM:
        raise DynhairError(
            f"the head travels {travel:.0f} m" + (", from rest" if "rest_translation" in columns else ""),
            path=path,
            expected="metres",
            mend="divide what is in mm by 1000: `translation`, and `rest_translation` if it is told",
        )
    expressions = columns.get("expression", np.zeros((frames, 0))).astype(np.float32)
    rest_rotation = columns.get("rest_rotation")
    return TimedMotion(
        times=_times(columns, frames, path),
        rotations=rotations,
        translations=translations,
        expressions=expressions,
        rest=RestPose(
            rotations[0] if rest_rotation is None else _rotations("rest_rotation", rest_rotation[None], path)[0],
            rest_translation,
            _rest_expression(columns, expressions, path),
        ),
        gravity=columns.get("gravity", np.array(EARTH_GRAVITY)),
        expression_basis=_basis(columns, expressions.shape[1], path),
    )


def _checked(name: str, value: np.ndarray, path: Path) -> np.ndarray:
    """The column as float64, or as text, of a shape that it may have."""
    column = COLUMNS[name]
    rows: tuple[str, ...] = ("frames",) if column.per_frame else ()
    if not any(_fits(value.shape, len(rows), shape) for shape in column.shapes):
        wanted = ((*rows, *("any" if size is None else size for size in shape)) for shape in column.shapes)
        raise DynhairError(
            f"`{name}` has the shape {value.shape}",
            path=path,
            expected=" or ".join(f"({', '.join(map(str, shape))})" for shape in wanted),
        )
    if value.size == 0 and not column.text:
        return value.astype(np.float64)
    if column.text:
        if value.dtype.kind != "U" and value.size:
            raise DynhairError(f"`{name}` holds {value.dtype}", path=path, expected="text")
        return value
    if value.dtype.kind not in "fiu":
        raise DynhairError(f"`{name}` holds {value.dtype}", path=path, expected="numbers")
    if not np.isfinite(value).all():
        place = int(np.argwhere(~np.isfinite(value))[0][0]) if value.ndim else 0
        raise DynhairError(f"`{name}` holds a value that is not finite, first in row {place}", path=path)
    return value.astype(np.float64)


def _fits(found: tuple[int, ...], rows: int, wanted: tuple[int | None, ...]) -> bool:
    """Whether a shape is the wanted one behind ``rows`` axes of any length."""
    return len(found) == rows + len(wanted) and all(map(_agree, found[rows:], wanted))


def _agree(found: int, wanted: int | None) -> bool:
    return wanted in (None, found)


def _times(columns: Columns, frames: int, path: Path) -> Float64[np.ndarray, " f"]:
    if "time" in columns:
        times = columns["time"]
        steps = np.diff(times)
        if not (steps > 0).all():
            place = int(np.argmax(~(steps > 0))) + 1
            raise DynhairError(
                f"`time` goes from {times[place - 1]:g} s to {times[place]:g} s in frame {place}",
                path=path,
                expected="seconds that increase",
                mend="sort the frames by time, and keep one of those at the same instant",
            )
        return times
    if "fps" not in columns:
        raise DynhairError("neither `time` nor `fps` is told", path=path, expected="one of them")
    fps = float(columns["fps"])
    if not fps > 0:
        raise DynhairError(f"`fps` is {fps:g}", path=path, expected="a positive number")
    return np.arange(frames) / fps


def _rotations(name: str, values: np.ndarray, path: Path) -> Float64[np.ndarray, "f 3 3"]:
    """Rotation matrices of quaternions (wxyz), rotation vectors (radians) or matrices."""
    if values.shape[1:] == (3,):
        return Rotation.from_rotvec(values).as_matrix()
    if values.shape[1:] == (4,):
        off, what = np.abs(np.linalg.norm(values, axis=1) - 1), "unit quaternions, w x y z"
    else:
        gram = values.transpose(0, 2, 1) @ values - np.eye(3)
        off = np.where(np.linalg.det(values) > 0, np.abs(gram).max(axis=(1, 2)), np.inf)
        what = "rotation matrices, orthonormal and right-handed"
    if off.max() > _UNIT:
        raise DynhairError(f"row {int(off.argmax())} of `{name}` is no rotation", path=path, expected=what)
    if values.shape[1:] == (4,):
        return Rotation.from_quat(np.roll(values, -1, axis=1)).as_matrix()
    return Rotation.from_matrix(values).as_matrix()


def _quaternions(rotations: Float64[np.ndarray, "*f 3 3"]) -> Float64[np.ndarray, "*f 4"]:
    return np.roll(Rotation.from_matrix(rotations).as_quat(), 1, axis=-1)


def _rest_expression(columns: Columns, expressions: np.ndarray, path: Path) -> np.ndarray:
    """The neutral expression: as told, or all coefficients 0."""
    told = columns.get("rest_expression", np.zeros(expressions.shape[1]))
    if len(told) != expressions.shape[1]:
        raise DynhairError(
            f"`rest_expression` has {len(told)} coefficients",
            path=path,
            expected=f"{expressions.shape[1]}, as `expression` has",
        )
    return told.astype(np.float32)


def _basis(columns: Columns, count: int, path: Path) -> ExpressionBasis | None:
    names = tuple(str(name) for name in columns.get("expression_names", ()))
    if "expression_basis" not in columns and not names:
        return None
    told = [name for name in names if name]
    if len(set(told)) < len(told):
        twice = next(name for place, name in enumerate(told) if name in told[:place])
        raise DynhairError(f"two of `expression_names` are '{twice}'", path=path, expected="names that differ")
    basis = ExpressionBasis(str(columns.get("expression_basis", "unknown")), names)
    basis.require_size(count, path)
    return basis
