"""``.usd``, ``.usda``, ``.usdc`` and ``.usdz`` files: the BasisCurves of a stage, at their first time, in metres, y up.

Read through OpenUSD itself (the optional package usd-core): the binary kind is a database of its own, and layers,
references and variants are composed by nothing else.
"""

# Its modules do not declare what is in them.
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynhair.errors import DynhairError
from dynhair.strands.files.curves import Curves, joined_curves
from dynhair.strands.files.strand_file import StrandFile

_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_OPEN = ("nonperiodic", "pinned")


def read_usd(path: Path) -> StrandFile:
    """Read the curves of a USD stage.

    Raises:
        DynhairError: usd-core is not installed, or the file cannot be read or holds no curves.
    """
    try:
        from pxr import Tf, Usd, UsdGeom
    except ImportError:
        raise DynhairError(
            "USD files are read through usd-core, which is not installed",
            path=path,
            mend="pip install dynhair[usd], or export the strands as .abc",
        ) from None
    if not path.is_file():
        raise DynhairError("No such file", path=path, expected="a USD stage")
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise DynhairError(f"it cannot be read ({error})", path=path, expected="a USD stage") from None
    first = Usd.TimeCode.EarliestTime()
    to_world = UsdGeom.XformCache(first)
    to_metres = UsdGeom.GetStageMetersPerUnit(stage) * np.diag([1.0, 1, 1, 0]) + np.diag([0.0, 0, 0, 1])
    is_z_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    to_head = to_metres @ _Z_UP if is_z_up else to_metres
    found = []
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.BasisCurves):
            continue
        curves = UsdGeom.BasisCurves(prim)
        if curves.GetWrapAttr().Get(first) not in _OPEN:
            raise DynhairError(f"the curves {prim.GetPath()} are closed", path=path, expected="open curves")
        is_linear = curves.GetTypeAttr().Get(first) == UsdGeom.Tokens.linear
        widths = curves.GetWidthsAttr().Get(first)
        found.append(
            Curves(
                points=np.array(curves.GetPointsAttr().Get(first) or (), np.float64).reshape(-1, 3),
                counts=np.array(curves.GetCurveVertexCountsAttr().Get(first) or (), np.int64),
                basis="linear" if is_linear else curves.GetBasisAttr().Get(first),
                widths=None if widths is None else np.array(widths, np.float64),
                # USD's matrices are for row vectors
                matrix=to_head @ np.array(to_world.GetLocalToWorldTransform(prim)).T,
            )
        )
    return joined_curves(path, found)
