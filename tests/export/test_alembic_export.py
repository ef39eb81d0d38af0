"""Alembic archives of strands in motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from alembic_samples import Reader
from any_motion import any_motion
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.export.alembic import write_alembic
from dynhair.export.colours import linear_colours
from dynhair.export.strand_motion import MotionFrame, StrandMotion
from dynhair.strands.files import read_strands

STRANDS, SKIN = "/groom/strands/.geom", "/skin/surface/.geom"


def read(motion: StrandMotion, path: Path, units_per_metre: float = 100.0) -> Reader:
    write_alembic(path, motion, units_per_metre=units_per_metre)
    return Reader(path)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    strands=st.integers(1, 400),
    points=st.integers(2, 9),
    frames=st.integers(1, 9),
    mesh=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_motion_comes_back(strands: int, points: int, frames: int, mesh: bool, seed: int, tmp_path: Path) -> None:
    motion = any_motion(strands, points, frames, mesh=mesh, seed=seed)
    found = read(motion, tmp_path / "hair.abc", 1.0)
    expected = list(motion)
    for name, field in ((STRANDS, "strands"), (SKIN, "head")) if mesh else ((STRANDS, "strands"),):
        positions, boxes = found.properties[f"{name}/P"], found.properties[f"{name}/.selfBnds"]
        assert positions.times == pytest.approx(np.arange(frames) / 25)
        for frame, sample, box in zip(expected, positions.samples, boxes.samples, strict=True):
            points_there = getattr(frame, field).reshape(-1, 3)
            assert np.array_equal(sample, points_there)
            assert np.array_equal(box[0], [*points_there.min(0), *points_there.max(0)])
    assert (f"{SKIN}/P" in found.properties) == mesh
    matrices = np.stack(found.properties["/head/.xform/.vals"].samples).reshape(-1, 4, 4)
    assert np.array_equal(matrices.transpose(0, 2, 1), motion.head_transforms)
    inherits = found.properties["/head/.xform/.inherits"]
    assert inherits.times == found.properties[f"{STRANDS}/P"].times
    assert (inherits.stored, inherits.samples[-1].item()) == (1, True)
    first = read_strands(tmp_path / "hair.abc")
    assert first.counts.tolist() == [points] * strands
    assert np.array_equal(first.points.numpy(), expected[0].strands.reshape(-1, 3))
    assert first.widths is not None
    assert np.array_equal(first.widths.numpy(), motion.widths.ravel())


def test_lengths_are_centimetres_by_default(tmp_path: Path) -> None:
    motion = any_motion()
    found = read(motion, tmp_path / "hair.abc")
    np.testing.assert_allclose(found.properties[f"{STRANDS}/P"].samples[2].ravel(), 100 * motion.at(2).strands.ravel())
    np.testing.assert_allclose(found.properties[f"{STRANDS}/width"].samples[0].ravel(), 100 * motion.widths.ravel())
    matrix = found.properties["/head/.xform/.vals"].samples[1].reshape(4, 4)
    np.testing.assert_allclose(matrix[3, :3], 100 * motion.head_transforms[1, :3, 3])
    assert found.description["_ai_Description"] == "100 units are a metre"
    assert found.description["FramesPerTimeUnit"] == "25.0"


def test_it_is_a_groom_to_unreal(tmp_path: Path) -> None:
    motion = any_motion()
    properties = read(motion, tmp_path / "hair.abc").properties
    expected = {
        "groom_width": ("vtx", "float32_t", 1, None, 100 * motion.widths.reshape(-1, 1)),
        "groom_color": ("vtx", "float32_t", 3, "rgb", linear_colours(motion.colours).reshape(-1, 3)),
        "groom_root_uv": ("uni", "float32_t", 2, "vector", motion.root_uvs),
        "groom_id": ("uni", "int32_t", 1, None, motion.ids[:, None]),
        "groom_group_id": ("con", "int32_t", 1, None, [[0]]),
        "groom_guide": ("con", "int16_t", 1, None, [[0]]),
    }
    for name, (scope, kind, extent, interpretation, values) in expected.items():
        found = properties[f"{STRANDS}/.arbGeomParams/{name}"]
        (sample,) = found.samples
        np.testing.assert_allclose(sample, values, rtol=1e-6)
        assert found.metadata["geoScope"] == scope
        assert found.metadata["podName"] == kind
        assert found.metadata["podExtent"] == str(extent)
        assert found.metadata.get("interpretation") == interpretation
        assert found.metadata["isGeomParam"] == "true"
    for name, number in (("major", 1), ("minor", 5)):
        found = properties[f"/groom/.xform/.arbGeomParams/groom_version_{name}"]
        assert found.samples[0].item() == number
        assert found.samples[0].dtype == np.int16


def test_objects_have_the_schemas_of_curves_meshes_and_transforms(tmp_path: Path) -> None:
    found = read(any_motion(), tmp_path / "hair.abc")
    for path, schema in (
        ("/groom", "AbcGeom_Xform_v3"),
        ("/head", "AbcGeom_Xform_v3"),
        ("/groom/strands", "AbcGeom_Curve_v2"),
        ("/skin/surface", "AbcGeom_PolyMesh_v1"),
    ):
        assert found.schemas[path]["schema"] == schema
        name = ".xform" if "Xform" in schema else ".geom"
        assert found.schemas[path]["schemaObjTitle"] == f"{schema}:{name}"
        assert found.schemas[f"{path}/{name}"]["schema"] == schema
    assert found.properties[f"{STRANDS}/curveBasisAndType"].samples[0].tolist() == [[1, 0, 0, 0]]
    # clockwise from outside
    assert found.properties[f"{SKIN}/.faceIndices"].samples[0].ravel().tolist() == [2, 1, 0, 5, 4, 3, 6, 5, 4]
    assert found.properties[f"{SKIN}/.faceCounts"].samples[0].ravel().tolist() == [3, 3, 3]


def test_the_skin_is_coloured_where_its_colours_are_known(tmp_path: Path) -> None:
    motion, name = any_motion(), f"{SKIN}/.arbGeomParams/Cd"
    assert motion.head_colours is not None
    found = read(motion, tmp_path / "hair.abc").properties[name]
    assert np.array_equal(found.samples[0], linear_colours(motion.head_colours))
    assert (found.metadata["geoScope"], found.metadata["interpretation"]) == ("vtx", "rgb")
    assert name not in read(replace(motion, head_colours=None), tmp_path / "plain.abc").properties


@pytest.mark.parametrize(
    ("order", "stored"),
    [
        ([0], 1),
        ([0, 0, 0], 1),
        ([0, 1, 2], 3),
        ([0, 0, 1, 2, 2], 3),
        ([0, 1, 1, 2], 4),
        ([0, 1, 0, 1], 4),
        ([0, 0, 1, 1, 0, 0], 4),
    ],
)
def test_what_does_not_change_is_stored_once(order: list[int], stored: int, tmp_path: Path) -> None:
    motion = any_motion(300, 8)
    repeated = replace(
        motion, at=lambda index: motion.at(order[index]), head_transforms=motion.head_transforms[order].copy()
    )
    found = read(repeated, tmp_path / "hair.abc", 1.0)
    positions = found.properties[f"{STRANDS}/P"]
    assert [sample.tolist() for sample in positions.samples] == [
        motion.at(index).strands.reshape(-1, 3).tolist() for index in order
    ]
    assert positions.stored == stored
    constant = (tmp_path / "hair.abc").stat().st_size - len(set(order)) * motion.at(0).strands.nbytes
    assert constant < 2.2 * motion.at(0).strands.nbytes  # colours, widths once, and the rest


def test_a_head_that_stands_still_has_no_animated_channels(tmp_path: Path) -> None:
    motion = any_motion()
    moving = read(motion, tmp_path / "moving.abc").properties
    assert moving["/head/.xform/.animChans"].samples[0].ravel().tolist() == [0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14]
    still = replace(motion, head_transforms=motion.head_transforms[[0, 0, 0]])
    assert "/head/.xform/.animChans" not in read(still, tmp_path / "still.abc").properties


def test_many_frames_have_larger_counts_in_headers(tmp_path: Path) -> None:
    motion = any_motion(1, 2, 300)
    positions = read(motion, tmp_path / "hair.abc", 1.0).properties[f"{STRANDS}/P"]
    assert len(positions.samples) == 300
    assert np.array_equal(positions.samples[299], motion.at(299).strands[0])


def test_the_same_motion_is_the_same_file(tmp_path: Path) -> None:
    for name in ("a.abc", "b.abc"):
        write_alembic(tmp_path / name, any_motion())
    assert (tmp_path / "a.abc").read_bytes() == (tmp_path / "b.abc").read_bytes()


def test_a_motion_that_breaks_leaves_no_file(tmp_path: Path) -> None:
    motion = any_motion()

    def breaking(index: int) -> MotionFrame:
        frame = motion.at(index)
        return frame if index < 2 else replace(frame, strands=frame.strands * np.float32("nan"))

    with pytest.raises(DynhairError, match="frame 2 is not finite"):
        write_alembic(tmp_path / "hair.abc", replace(motion, at=breaking))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("srgb", "linear"), [(0.0, 0.0), (0.04045, 0.0031308), (0.5, 0.2140411), (1.0, 1.0)])
def test_colours_of_srgb_in_linear_light(srgb: float, linear: float) -> None:
    np.testing.assert_allclose(linear_colours(np.full((2, 3), srgb)), linear, atol=1e-7)
