"""``.usd``, ``.usdc``, ``.usda`` and ``.usdz``: strands and head in motion as a USD stage.

Written by OpenUSD itself (the optional package usd-core).
"""

# Its modules do not declare what is in them.
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.export.colours import linear_colours
from dynhair.export.strand_motion import StrandMotion
from dynhair.storage import atomic_file

if TYPE_CHECKING:
    from pxr import Usd

ENDINGS = (".usd", ".usdc", ".usda", ".usdz")
APERTURE = 0.36
"""Width of a camera's film in tenths of a metre, which USD measures it in: that of 35 mm film."""

_UNSAVED_BYTES = 1 << 26
"""Points that wait in memory for the file to be saved: what has been saved, OpenUSD reads from there."""


def write_usd(path: Path | str, motion: StrandMotion, *, camera: Camera | None = None) -> None:
    """Write a motion as a USD stage, atomically.

    It holds, below ``/avatar``, the BasisCurves ``strands``, the head's place ``head``, the Mesh ``skin`` if there is
    one, and the Camera ``camera`` if one is given. Points are in the world, metres, y up; frame ``i`` is at time code
    ``i``; colours are linear.

    Args:
        path: of the file, one of :data:`ENDINGS`.
        motion: what to write.
        camera: that stands still.

    Raises:
        DynhairError: usd-core is not installed, the file's ending is another, a frame does not fit the motion, or it
            cannot be written.
    """
    path = Path(path)
    if path.suffix not in ENDINGS:
        raise DynhairError(f"the ending `{path.suffix}`", path=path, expected=" or ".join(ENDINGS))
    try:
        from pxr import Sdf, UsdUtils
    except ImportError:
        raise DynhairError(
            "USD files are written through usd-core, which is not installed", path=path, mend="pip install dynhair[usd]"
        ) from None
    with atomic_file(path) as temporary:
        if path.suffix in (".usd", ".usdc"):
            _write_stage(temporary, motion, camera)
            return
        # Text and packages are made from a binary file, which need not be in memory as a whole.
        with TemporaryDirectory(prefix=f".{path.stem}-", dir=path.parent) as folder:
            binary = Path(folder) / f"{path.stem}.usdc"
            _write_stage(binary, motion, camera)
            if path.suffix == ".usda":
                written = Sdf.Layer.FindOrOpen(str(binary)).Export(str(temporary))
            else:
                written = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(binary)), str(temporary))
        if not written:
            raise DynhairError("OpenUSD could not write it", path=path, mend="see what it says above")


def _write_stage(path: Path, motion: StrandMotion, camera: Camera | None) -> None:
    from pxr import Kind, Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(motion.fps)
    stage.SetFramesPerSecond(motion.fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(motion) - 1)
    root = UsdGeom.Xform.Define(stage, "/avatar").GetPrim()
    stage.SetDefaultPrim(root)
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    strands = _strands(stage, motion)
    _head(stage, motion.head_transforms)
    skin = None if motion.head_faces is None else _mesh(stage, motion.head_faces, motion.head_colours)
    if camera is not None:
        _camera(stage, camera)

    margin, unsaved = float(motion.widths.max()) / 2, 0
    for time, frame in enumerate(motion):
        _add(strands, frame.strands.reshape(-1, 3), margin, time)
        unsaved += frame.strands.nbytes
        if skin is not None and frame.head is not None:
            _add(skin, frame.head, 0.0, time)
            unsaved += frame.head.nbytes
        if unsaved > _UNSAVED_BYTES:
            stage.Save()
            unsaved = 0
    stage.Save()


def _strands(stage: Usd.Stage, motion: StrandMotion) -> Any:
    """The curves, but for what moves.

    They are linear: the avatar's strands are polylines, drawn segment by segment. Cubic curves would be rounder than
    what was fitted to the images.
    """
    from pxr import Sdf, UsdGeom, Vt

    count, length = motion.widths.shape
    curves = UsdGeom.BasisCurves.Define(stage, "/avatar/strands")
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    curves.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
    curves.CreateCurveVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(count, length, np.int32)))
    curves.CreateWidthsAttr(Vt.FloatArray.FromNumpy(motion.widths.ravel()))
    curves.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
    colours = Vt.Vec3fArray.FromNumpy(linear_colours(motion.colours).reshape(-1, 3))
    curves.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(colours)
    primvars = UsdGeom.PrimvarsAPI(curves)
    for name, kind, values in (
        ("st", Sdf.ValueTypeNames.TexCoord2fArray, Vt.Vec2fArray.FromNumpy(motion.root_uvs)),
        ("strandId", Sdf.ValueTypeNames.IntArray, Vt.IntArray.FromNumpy(motion.ids.astype(np.int32))),
    ):
        primvars.CreatePrimvar(name, kind, UsdGeom.Tokens.uniform).Set(values)
    return curves


def _mesh(stage: Usd.Stage, faces: np.ndarray, colours: np.ndarray | None) -> Any:
    """The mesh, but for what moves."""
    from pxr import UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, "/avatar/skin")
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), faces.shape[1], np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32).ravel()))
    if colours is not None:
        linear = Vt.Vec3fArray.FromNumpy(linear_colours(colours))
        mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(linear)
    return mesh


def _add(geometry: Any, points: np.ndarray, margin: float, time: int) -> None:
    """What moves, at one time: points, and the box around them and ``margin`` more."""
    from pxr import Vt

    geometry.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), time)
    box = np.stack([points.min(0) - margin, points.max(0) + margin]).astype(np.float32)
    geometry.GetExtentAttr().Set(Vt.Vec3fArray.FromNumpy(box), time)


def _head(stage: Usd.Stage, transforms: np.ndarray) -> None:
    """The head's place: a transform with nothing below it."""
    from pxr import Gf, UsdGeom

    place = UsdGeom.Xform.Define(stage, "/avatar/head").AddTransformOp()
    for time, matrix in enumerate(transforms):
        place.Set(Gf.Matrix4d(matrix.T), time)  # for row vectors


def _camera(stage: Usd.Stage, camera: Camera) -> None:
    """A camera, which looks along its own -z with y up, and whose film lies off its axis where ``K`` says so."""
    from pxr import Gf, UsdGeom

    to_camera = np.eye(4)
    to_camera[:3] = np.diag([1.0, -1, -1]) @ camera.w2c.double().cpu().numpy()
    (fx, _, cx), (_, fy, cy) = camera.K[:2].tolist()
    per_pixel = APERTURE / camera.width
    focal = per_pixel * fx
    made = UsdGeom.Camera.Define(stage, "/avatar/camera")
    made.AddTransformOp().Set(Gf.Matrix4d(np.linalg.inv(to_camera).T))
    made.CreateFocalLengthAttr(focal)
    made.CreateHorizontalApertureAttr(APERTURE)
    made.CreateVerticalApertureAttr(camera.height / fy * focal)
    made.CreateHorizontalApertureOffsetAttr((camera.width / 2 - cx) / fx * focal)
    made.CreateVerticalApertureOffsetAttr((cy - camera.height / 2) / fy * focal)
    made.CreateClippingRangeAttr(Gf.Vec2f(0.01, 100))
