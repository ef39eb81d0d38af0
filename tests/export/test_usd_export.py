"""USD stages of strands in motion, read back by OpenUSD alone."""

# OpenUSD's modules do not declare what is in them.
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from any_motion import any_motion
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.export import usd
from dynhair.export.colours import linear_colours
from dynhair.export.strand_motion import MotionFrame
from dynhair.export.usd import write_usd
from dynhair.strands.files import read_strands
from tiny_avatars import front_camera

pxr = pytest.importorskip("pxr")
from pxr import Gf, Usd, UsdGeom  # noqa: E402


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    ending=st.sampled_from([".usd", ".usdc", ".usdz"]),
    strands=st.integers(1, 300),
    points=st.integers(2, 9),
    frames=st.integers(1, 6),
    mesh=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_motion_comes_back(
    ending: str, strands: int, points: int, frames: int, mesh: bool, seed: int, tmp_path: Path
) -> None:
    motion = any_motion(strands, points, frames, mesh=mesh, seed=seed)
    write_usd(tmp_path / f"hair{ending}", motion)
    stage = Usd.Stage.Open(str(tmp_path / f"hair{ending}"))
    curves = UsdGeom.BasisCurves(stage.GetDefaultPrim().GetChild("strands"))
    assert list(curves.GetCurveVertexCountsAttr().Get()) == [points] * strands
    assert curves.GetPointsAttr().GetTimeSamples() == list(range(frames))
    skin, place = stage.GetDefaultPrim().GetChild("skin"), stage.GetDefaultPrim().GetChild("head")
    assert bool(skin) == mesh
    for time, frame in enumerate(motion):
        assert np.array_equal(curves.GetPointsAttr().Get(time), frame.strands.reshape(-1, 3))
        to_world = np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(place))
        assert np.array_equal(to_world.T, motion.head_transforms[time])
        for drawn in (curves.GetPrim(), skin) if mesh else (curves.GetPrim(),):
            own = UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(drawn), time)
            np.testing.assert_allclose(UsdGeom.Boundable(drawn).GetExtentAttr().Get(time), own, atol=1e-6)
        if mesh:
            assert frame.head is not None
            assert np.array_equal(UsdGeom.Mesh(skin).GetPointsAttr().Get(time), frame.head)


def test_looks_and_units(tmp_path: Path) -> None:
    motion = any_motion()
    write_usd(tmp_path / "hair.usdc", motion)
    stage = Usd.Stage.Open(str(tmp_path / "hair.usdc"))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y
    assert (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()) == (25, 25)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 2)
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/avatar/strands"))
    assert curves.GetTypeAttr().Get() == "linear"
    assert curves.GetWidthsInterpolation() == "vertex"
    assert np.array_equal(curves.GetWidthsAttr().Get(), motion.widths.ravel())
    colours = curves.GetDisplayColorPrimvar()
    assert colours.GetInterpolation() == "vertex"
    assert np.array_equal(colours.Get(), linear_colours(motion.colours).reshape(-1, 3))
    primvars = UsdGeom.PrimvarsAPI(curves)
    for name, expected in (("st", motion.root_uvs), ("strandId", motion.ids)):
        assert primvars.GetPrimvar(name).GetInterpolation() == "uniform"
        assert np.array_equal(primvars.GetPrimvar(name).Get(), expected)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/avatar/skin"))
    assert motion.head_faces is not None
    assert list(mesh.GetFaceVertexIndicesAttr().Get()) == motion.head_faces.ravel().tolist()
    assert motion.head_colours is not None
    assert np.array_equal(mesh.GetDisplayColorPrimvar().Get(), linear_colours(motion.head_colours))
    assert mesh.GetDisplayColorPrimvar().GetInterpolation() == "vertex"
    assert UsdGeom.Mesh.ValidateTopology(
        mesh.GetFaceVertexIndicesAttr().Get(), mesh.GetFaceVertexCountsAttr().Get(), 7
    ) == (True, "")


def test_text_says_the_same_as_binary(tmp_path: Path) -> None:
    for ending in ("usda", "usdc"):
        write_usd(tmp_path / f"hair.{ending}", any_motion(), camera=front_camera())
    text, binary = (Usd.Stage.Open(str(tmp_path / f"hair.{ending}")) for ending in ("usda", "usdc"))
    assert (tmp_path / "hair.usda").read_text().startswith("#usda 1.0")
    assert text.GetRootLayer().ExportToString() == binary.GetRootLayer().ExportToString()


def test_our_own_reader_finds_the_first_frame(tmp_path: Path) -> None:
    motion = any_motion()
    write_usd(tmp_path / "hair.usd", motion)
    found = read_strands(tmp_path / "hair.usd")
    assert np.array_equal(found.points.numpy(), motion.at(0).strands.reshape(-1, 3))
    assert found.widths is not None
    np.testing.assert_allclose(found.widths.numpy(), motion.widths.ravel(), rtol=1e-6)


@pytest.mark.parametrize("ending", [".usdc", ".usdz"])
def test_every_validator_of_openusd_is_content(ending: str, tmp_path: Path) -> None:
    validation = pytest.importorskip("pxr.UsdValidation")
    write_usd(tmp_path / f"hair{ending}", any_motion(), camera=front_camera())
    validators = validation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    found = validation.ValidationContext(validators).Validate(Usd.Stage.Open(str(tmp_path / f"hair{ending}")))
    assert [error.GetMessage() for error in found] == []


def test_the_camera_sees_what_ours_sees(tmp_path: Path) -> None:
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(0)))[0]
    turn *= torch.det(turn).sign()
    w2c = torch.cat([turn, torch.tensor([[0.1], [-0.2], [0.9]])], 1)
    camera = Camera(w2c, torch.tensor([[300.0, 0, 190], [0, 280, 170], [0, 0, 1]]), 400, 320)
    write_usd(tmp_path / "hair.usda", any_motion(), camera=camera)
    stage = Usd.Stage.Open(str(tmp_path / "hair.usda"))
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/avatar/camera")).GetCamera(0).frustum
    to_clip = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    local = torch.tensor([[0.0, 0.0, 1.0], [0.3, 0.1, 0.7], [-0.2, 0.4, 2.0]])
    points = (local - w2c[:, 3]) @ turn
    pixels, _ = camera.project(points)
    for point, pixel in zip(points.tolist(), pixels.tolist(), strict=True):
        x, y, _ = to_clip.Transform(Gf.Vec3d(*point))
        assert ((x + 1) / 2 * 400, (1 - y) / 2 * 320) == pytest.approx(pixel, abs=1e-2)


def test_long_motions_are_saved_as_they_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usd, "_UNSAVED_BYTES", 1000)
    motion, sizes = any_motion(20, 8, 9), list[int]()

    def watched(index: int) -> MotionFrame:
        sizes.append(sum(path.stat().st_size for path in tmp_path.iterdir()))
        return motion.at(index)

    write_usd(tmp_path / "hair.usdc", replace(motion, at=watched))
    assert sizes == sorted(sizes)
    assert sizes[-1] > 6 * motion.at(0).strands.nbytes
    stage = Usd.Stage.Open(str(tmp_path / "hair.usdc"))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/avatar/strands"))
    for time, frame in enumerate(motion):
        assert np.array_equal(curves.GetPointsAttr().Get(time), frame.strands.reshape(-1, 3))


@pytest.mark.parametrize("ending", [".usda", ".usdc", ".usdz"])
def test_a_motion_that_breaks_leaves_no_file(ending: str, tmp_path: Path) -> None:
    motion = any_motion()
    broken = replace(motion, at=lambda index: motion.at(index) if index < 2 else MotionFrame(np.zeros((0, 4, 3), "f4")))
    with pytest.raises(DynhairError, match="frame 2 has 0 x 4 points"):
        write_usd(tmp_path / f"hair{ending}", broken)
    assert list(tmp_path.iterdir()) == []


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match=r"the ending `.abc`(.|\n)*.usdz"):
        write_usd(tmp_path / "hair.abc", any_motion())


def test_without_usd_core_it_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(DynhairError, match=r"pip install dynhair\[usd\]"):
        write_usd(tmp_path / "hair.usdc", any_motion())
