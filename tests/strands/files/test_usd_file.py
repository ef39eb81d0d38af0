"""USD stages written by Blender and by OpenUSD."""

# OpenUSD's modules do not declare what is in them.
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import DATA, blender_scene, control_points

from dynhair.errors import DynhairError
from dynhair.strands.files import read_strands


def test_without_usd_core_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(DynhairError, match=r"pip install dynhair\[usd\]"):
        read_strands(DATA / "blender.usdc")


def stage_of(path: Path, *, unit: float | None = None, up: str = "Y", **attributes: Any) -> None:
    pytest.importorskip("pxr")
    from pxr import Gf, Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(path))
    if unit is not None:
        UsdGeom.SetStageMetersPerUnit(stage, unit)
    UsdGeom.SetStageUpAxis(stage, up)
    parent = UsdGeom.Xform.Define(stage, "/head")
    parent.AddTranslateOp().Set(Gf.Vec3d(0, 0, 10))
    curves = UsdGeom.BasisCurves.Define(stage, "/head/hair")
    curves.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    curves.CreateCurveVertexCountsAttr([2, 3])
    curves.CreateTypeAttr("linear")
    points = control_points(0, 5)
    # at a time of its own: what it is worth first must be asked for
    curves.CreatePointsAttr().Set((points + 1).tolist(), Usd.TimeCode(8))
    curves.GetPointsAttr().Set(points.tolist(), Usd.TimeCode(7))
    curves.CreateWidthsAttr([0.5])
    for name, value in attributes.items():
        getattr(curves, f"Create{name}Attr")(value)
    stage.GetRootLayer().Save()


def test_blenders_curves_are_where_they_are_at_the_first_frame() -> None:
    pytest.importorskip("pxr")
    found = read_strands(DATA / "blender.usdc")
    counts, points, widths = blender_scene()
    order = [0, 1] if found.counts[0] == counts[0][0] else [1, 0]
    assert found.counts.tolist() == [count for index in order for count in counts[index]]
    np.testing.assert_allclose(found.points, np.concatenate([points[index] for index in order]), atol=2e-6)
    assert found.widths is not None
    np.testing.assert_allclose(found.widths, np.concatenate([widths[index] for index in order]), rtol=1e-6)


@pytest.mark.parametrize("ending", [".usd", ".usda", ".usdc"])
@pytest.mark.parametrize(("unit", "metres"), [(1.0, 1.0), (None, 0.01), (0.001, 0.001)])
@pytest.mark.parametrize("up", ["Y", "Z"])
def test_units_axes_transforms_and_times(
    ending: str, unit: float | None, metres: float, up: str, tmp_path: Path
) -> None:
    stage_of(tmp_path / f"hair{ending}", unit=unit, up=up)
    found = read_strands(tmp_path / f"hair{ending}")
    assert found.counts.tolist() == [2, 3]
    x, y, z = (2 * control_points(0, 5) + [0, 0, 10]).T
    expected = np.stack([x, y, z] if up == "Y" else [x, z, -y], axis=1)
    np.testing.assert_allclose(found.points, metres * expected, rtol=1e-5, atol=1e-7)
    assert found.widths is not None
    np.testing.assert_allclose(found.widths, metres, rtol=1e-5)


def test_packages_are_opened(tmp_path: Path) -> None:
    stage_of(tmp_path / "hair.usdc")
    from pxr import UsdUtils

    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "hair.usdc"), str(tmp_path / "hair.usdz"))
    assert read_strands(tmp_path / "hair.usdz").counts.tolist() == [2, 3]


@pytest.mark.parametrize(
    ("found", "attributes"),
    [
        ("no curves in it", {"CurveVertexCounts": [], "Points": []}),
        ("2 curves of 2 to 4 points are not their 5 points", {"CurveVertexCounts": [2, 4]}),
        ("curves /head/hair are closed", {"Wrap": "periodic"}),
        ("bezier of 2 to 3 control points", {"Type": "cubic", "Basis": "bezier"}),
    ],
)
def test_other_curves_are_refused(found: str, attributes: dict[str, Any], tmp_path: Path) -> None:
    stage_of(tmp_path / "hair.usda", **attributes)
    with pytest.raises(DynhairError, match=found):
        read_strands(tmp_path / "hair.usda")


def test_files_that_are_no_stages_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    with pytest.raises(DynhairError, match="No such file"):
        read_strands(tmp_path / "nowhere.usda")
    (tmp_path / "wrong.usda").write_text("hair")
    with pytest.raises(DynhairError, match=r"wrong.usda: it cannot be read"):
        read_strands(tmp_path / "wrong.usda")
