"""``.abc``: strands and head in motion as an Alembic archive, with the attributes that Unreal reads grooms by.

Written by :mod:`dynhair.export.ogawa_writer`: Alembic's own library is on PyPI only as repackaged by others, and large.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import dynhair
from dynhair.export.colours import linear_colours
from dynhair.export.ogawa_writer import Node, Properties, Samples, archive, as_metadata
from dynhair.export.strand_motion import StrandMotion
from dynhair.storage import atomic_file
from dynhair.strands.files.alembic import LINEAR, OPEN

GROOM_VERSION = 1, 5
CENTIMETRES = 100.0
"""Units of a file in a metre: Alembic knows no unit, and Unreal and Maya take a file's to be centimetres."""

_MATRIX = 3 << 4
_BOX = as_metadata(interpretation="box")
_POINTS = as_metadata(geoScope="vtx", interpretation="point")
_CONSTANT, _UNIFORM, _VERTEX = "con", "uni", "vtx"


def write_alembic(path: Path | str, motion: StrandMotion, *, units_per_metre: float = CENTIMETRES) -> None:
    """Write a motion as an Alembic archive, atomically; a frame is in memory at a time.

    It holds the curves ``groom/strands``, the head's place ``head`` and, if there is one, the mesh ``skin/surface``.
    Points are in the world, y up; frame ``i`` is at ``i / fps`` seconds; colours are linear.

    Args:
        path: of the file, ``.abc``.
        motion: what to write.
        units_per_metre: of the file's lengths.

    Raises:
        DynhairError: a frame does not fit the motion, or it cannot be written.
    """
    description = as_metadata(
        FramesPerTimeUnit=motion.fps,
        _ai_AlembicVersion="Alembic 1.8.3",
        _ai_Application=f"dynhair {dynhair.__version__}",
        _ai_Description=f"{units_per_metre:g} units are a metre",
    )
    with atomic_file(path) as temporary, archive(temporary, motion.fps, description) as top:
        strands = _Points(_curves(top, motion, units_per_metre))
        _head(top, motion.head_transforms, units_per_metre)
        skin = None if motion.head_faces is None else _Points(_mesh(top, motion.head_faces, motion.head_colours))
        for frame in motion:
            strands.add(units_per_metre * frame.strands.reshape(-1, 3))
            if skin is not None and frame.head is not None:
                skin.add(units_per_metre * frame.head)


class _Points:
    """What moves of curves or of a mesh: points, and the box around them."""

    def __init__(self, geometry: Properties) -> None:
        self._bounds = geometry.scalar(".selfBnds", "<f8", 6, _BOX, times=True)
        self._points = geometry.array("P", "<f4", 3, _POINTS, times=True)

    def add(self, points: np.ndarray) -> None:
        self._bounds.add(np.concatenate([points.min(0), points.max(0)]))
        self._points.add(points)


def _curves(top: Node, motion: StrandMotion, units_per_metre: float) -> Properties:
    """The strands, but for their points; returns where these belong."""
    count, length = motion.widths.shape
    groom, transform = _transform(top, "groom")
    general = transform.compound(".arbGeomParams")
    for name, number in zip(("groom_version_major", "groom_version_minor"), GROOM_VERSION, strict=True):
        general.scalar(name, "<i2").add(np.array(number))

    geometry = _shape(groom, "strands", "AbcGeom_Curve_v2")
    geometry.array("nVertices", "<i4").add(np.full(count, length))
    geometry.scalar("curveBasisAndType", "u1", 4).add(np.array([LINEAR, OPEN, 0, 0]))
    widths = units_per_metre * motion.widths
    _parameter(geometry, "width", _VERTEX).add(widths)
    attributes = geometry.compound(".arbGeomParams")
    _parameter(attributes, "groom_width", _VERTEX).add(widths)
    _parameter(attributes, "groom_color", _VERTEX, extent=3, interpretation="rgb").add(linear_colours(motion.colours))
    _parameter(attributes, "groom_root_uv", _UNIFORM, extent=2, interpretation="vector").add(motion.root_uvs)
    _parameter(attributes, "groom_id", _UNIFORM, "<i4").add(motion.ids)
    _parameter(attributes, "groom_group_id", _CONSTANT, "<i4").add(np.zeros(1))
    _parameter(attributes, "groom_guide", _CONSTANT, "<i2").add(np.zeros(1))  # none is: Unreal then makes its own
    return geometry


def _mesh(top: Node, faces: np.ndarray, colours: np.ndarray | None) -> Properties:
    """The mesh, but for its points; returns where these belong."""
    geometry = _shape(_transform(top, "skin")[0], "surface", "AbcGeom_PolyMesh_v1")
    # Alembic's faces are clockwise seen from outside
    geometry.array(".faceIndices", "<i4").add(faces[:, ::-1].ravel())
    geometry.array(".faceCounts", "<i4").add(np.full(len(faces), faces.shape[1]))
    if colours is not None:
        attributes = geometry.compound(".arbGeomParams")
        _parameter(attributes, "Cd", _VERTEX, extent=3, interpretation="rgb").add(linear_colours(colours))
    return geometry


def _head(top: Node, transforms: np.ndarray, units_per_metre: float) -> None:
    """The head's place: a transform with nothing below it."""
    # matrices are for row vectors
    matrices = transforms.transpose(0, 2, 1).copy()
    matrices[:, 3, :3] *= units_per_metre
    _, transform = _transform(top, "head", len(matrices))
    transform.scalar(".ops", "u1").add(np.array(_MATRIX))
    values = transform.scalar(".vals", "<f8", 16, times=True)
    for matrix in matrices:
        values.add(matrix)
    transform.scalar("isNotConstantIdentity", "?").add(np.array(True))
    channels = np.flatnonzero((matrices != matrices[0]).any(0))
    if len(channels):
        transform.array(".animChans", "<u4").add(channels)


def _transform(above: Node, name: str, samples: int = 1) -> tuple[Node, Properties]:
    """A transform, which changes nothing unless operations are added to its properties."""
    schema = "AbcGeom_Xform_v3"
    node = above.child(name, as_metadata(schema=schema, schemaObjTitle=f"{schema}:.xform"))
    properties = node.properties.compound(".xform", as_metadata(schema=schema))
    # what readers know the number of samples and their times by
    inherits = properties.scalar(".inherits", "?", times=samples > 1)
    for _ in range(samples):
        inherits.add(np.array(True))
    return node, properties


def _shape(above: Node, name: str, schema: str) -> Properties:
    """The properties of a geometric object."""
    kind = {"schema": schema, "schemaBaseType": "AbcGeom_GeomBase_v1"}
    node = above.child(name, as_metadata(**kind, schemaObjTitle=f"{schema}:.geom"))
    return node.properties.compound(".geom", as_metadata(**kind))


def _parameter(
    properties: Properties, name: str, scope: str, kind: str = "<f4", *, extent: int = 1, **interpretation: str
) -> Samples:
    """A parameter of a geometric object: of the whole object, of each strand or of each point, as ``scope`` says."""
    number = {"<f4": "float32_t", "<i4": "int32_t", "<i2": "int16_t"}[kind]
    described = {"isGeomParam": "true", "podName": number, "podExtent": extent, "arrayExtent": 1, "geoScope": scope}
    return properties.array(name, kind, extent, as_metadata(**described, **interpretation))
