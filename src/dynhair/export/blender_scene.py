"""Run by Blender's own Python: build the scene that :mod:`dynhair.export.blender` describes, and save it.

It imports nothing but NumPy and Blender's module. Arguments: the folder of the description, the ``.blend`` to write.
"""

# pyright: reportMissingImports=false

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Quaternion

POSITIONS = "position_"
"""The attributes of each frame's positions begin with this, and end with its number."""

COLOUR = "colour"
SKIN = (0.55, 0.36, 0.28, 1.0)


def build(parts: Path) -> None:
    """Fill Blender's scene with what the folder describes."""
    description = json.loads((parts / "scene.json").read_text(encoding="utf-8"))
    arrays = {path.stem: np.load(path, mmap_mode="r", allow_pickle=False) for path in parts.glob("*.npy")}
    for each in (bpy.data.objects, bpy.data.meshes, bpy.data.lights, bpy.data.cameras, bpy.data.materials):
        bpy.data.batch_remove(list(each))
    scene = bpy.context.scene
    frames = len(arrays["strands"])
    set_time(scene, frames, description["fps"])
    scene.unit_settings.system, scene.unit_settings.length_unit = "METRIC", "METERS"

    group = playing_nodes(frames)
    head = None
    if "head" in arrays:
        colours = arrays.get("head_colours")
        head = add_object("head", head_mesh(arrays["head"][0], arrays["head_faces"], colours), skin_material(colours))
        play(head, arrays["head"], group)
    hair = add_object("hair", hair_curves(arrays, description["points"]), hair_material())
    hair.data.surface = head
    play(hair, arrays["strands"], group)
    animate(add_object("head_pose", None), arrays["head_transforms"])
    add_view(scene, description["camera"])


def set_time(scene: Any, frames: int, fps: float) -> None:
    """Frame rate and length; the first frame is 0."""
    scene.render.fps = max(1, round(fps))
    scene.render.fps_base = scene.render.fps / fps
    scene.frame_start, scene.frame_end = 0, frames - 1
    scene.frame_set(0)


def add_object(name: str, data: Any, material: Any = None) -> Any:
    """An object of the scene; an empty where there are no data."""
    added = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(added)
    if material is not None:
        data.materials.append(material)
    return added


def hair_curves(arrays: dict[str, np.ndarray], points: int) -> Any:
    """Hair curves with their looks; they stand as in the first frame."""
    curves = bpy.data.hair_curves.new("hair")
    curves.add_curves([points] * len(arrays["ids"]))
    curves.set_types(type="POLY")
    curves.position_data.foreach_set("vector", flat(arrays["strands"][0]))
    attribute(curves, "radius", "FLOAT", "POINT").foreach_set("value", flat(arrays["radii"]))
    set_colours(curves, arrays["colours"].reshape(-1, 3))
    attribute(curves, "surface_uv_coordinate", "FLOAT2", "CURVE").foreach_set("vector", flat(arrays["root_uvs"]))
    attribute(curves, "strand_id", "INT", "CURVE").foreach_set("value", arrays["ids"])
    return curves


def head_mesh(vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray | None) -> Any:
    """A smooth mesh that stands as in the first frame."""
    mesh = bpy.data.meshes.new("head")
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    mesh.shade_smooth()
    if colours is not None:
        set_colours(mesh, colours)
    return mesh


def set_colours(data: Any, colours: np.ndarray) -> None:
    """Keep linear colours with the points of curves or of a mesh."""
    opaque = np.append(colours, np.ones((len(colours), 1), np.float32), 1)
    attribute(data, COLOUR, "FLOAT_COLOR", "POINT").foreach_set("color", flat(opaque))


def attribute(data: Any, name: str, kind: str, domain: str) -> Any:
    """The values of an attribute, which is made if there is none."""
    found = data.attributes.get(name) or data.attributes.new(name, kind, domain)
    return found.data


def flat(array: np.ndarray) -> np.ndarray:
    """What ``foreach_set`` takes."""
    return np.ascontiguousarray(array, np.float32).ravel()


def play(moving: Any, positions: np.ndarray, group: Any) -> None:
    """Keep every frame's positions with an object, and let the nodes move it through them."""
    for frame, points in enumerate(positions):
        attribute(moving.data, f"{POSITIONS}{frame}", "FLOAT_VECTOR", "POINT").foreach_set("vector", flat(points))
    moving.modifiers.new("play", "NODES").node_group = group


def playing_nodes(frames: int) -> Any:
    """Geometry nodes that move points to where the current frame has them, and halfway between frames halfway."""
    group = bpy.data.node_groups.new("play positions", "GeometryNodeTree")
    group.is_modifier = True
    for way in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    nodes = _Nodes(group)
    time = nodes.add("GeometryNodeInputSceneTime").outputs["Frame"]
    now = nodes.number("MINIMUM", nodes.number("MAXIMUM", time, 0), frames - 1)
    before = nodes.number("FLOOR", now)
    after = nodes.number("MINIMUM", nodes.number("ADD", before, 1), frames - 1)
    mix = nodes.add("ShaderNodeMix", data_type="VECTOR")
    factor, a, b = (next(s for s in mix.inputs if s.identifier == name) for name in _MIXED)
    nodes.join(nodes.number("FRACT", now), factor)
    nodes.join(nodes.positions(before), a)
    nodes.join(nodes.positions(after), b)
    move = nodes.add("GeometryNodeSetPosition")
    nodes.join(nodes.add("NodeGroupInput").outputs[0], move.inputs["Geometry"])
    nodes.join(next(s for s in mix.outputs if s.identifier == "Result_Vector"), move.inputs["Position"])
    tidy = nodes.add("GeometryNodeRemoveAttribute")  # the frames' positions are of no use further on
    tidy.inputs["Pattern Mode"].default_value = "Wildcard"
    tidy.inputs["Name"].default_value = f"{POSITIONS}*"
    nodes.join(move.outputs["Geometry"], tidy.inputs["Geometry"])
    nodes.join(tidy.outputs["Geometry"], nodes.add("NodeGroupOutput").inputs[0])
    return group


_MIXED = ("Factor_Float", "A_Vector", "B_Vector")


class _Nodes:
    """Adds nodes to a group, from left to right."""

    def __init__(self, group: Any) -> None:
        self._group = group

    def add(self, kind: str, **settings: str) -> Any:
        node = self._group.nodes.new(kind)
        node.location = (180 * len(self._group.nodes), 0)
        for name, value in settings.items():
            setattr(node, name, value)
        return node

    def join(self, output: Any, given: Any) -> None:
        self._group.links.new(output, given)

    def number(self, operation: str, value: Any, other: float | None = None) -> Any:
        """What an operation makes of a number, and of a constant if it takes two."""
        node = self.add("ShaderNodeMath", operation=operation)
        self.join(value, node.inputs[0])
        if other is not None:
            node.inputs[1].default_value = other
        return node.outputs[0]

    def positions(self, frame: Any) -> Any:
        """The positions of a whole frame."""
        text = self.add("FunctionNodeValueToString")
        self.join(frame, text.inputs["Value"])
        name = self.add("GeometryNodeStringJoin")
        beginning = self.add("FunctionNodeInputString")
        beginning.string = POSITIONS
        # what is joined to a socket of many later comes first
        self.join(text.outputs[0], name.inputs["Strings"])
        self.join(beginning.outputs[0], name.inputs["Strings"])
        named = self.add("GeometryNodeInputNamedAttribute", data_type="FLOAT_VECTOR")
        self.join(name.outputs[0], named.inputs["Name"])
        return named.outputs["Attribute"]


def animate(moving: Any, transforms: np.ndarray) -> None:
    """Key an object's pose in every frame, linear between them."""
    moving.rotation_mode = "QUATERNION"
    moving.empty_display_size = 0.1
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    last = Quaternion()
    for frame, transform in enumerate(transforms):
        place, turn, _ = Matrix(transform.tolist()).decompose()
        turn.make_compatible(last)
        moving.location, moving.rotation_quaternion, last = place, turn, turn
        moving.keyframe_insert("location", frame=frame)
        moving.keyframe_insert("rotation_quaternion", frame=frame)


def hair_material() -> Any:
    """Hair in the colours of its points."""
    material, nodes, links = _material("hair")
    shader, colour = nodes.new("ShaderNodeBsdfHairPrincipled"), nodes.new("ShaderNodeAttribute")
    shader.parametrization, colour.attribute_name = "COLOR", COLOUR
    links.new(colour.outputs["Color"], shader.inputs["Color"])
    links.new(shader.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def skin_material(colours: np.ndarray | None) -> Any:
    """Skin in the colours of its points, or plain where there are none."""
    material, nodes, links = _material("skin")
    shader = nodes.new("ShaderNodeBsdfPrincipled")
    shader.inputs["Base Color"].default_value = SKIN
    shader.inputs["Roughness"].default_value = 0.6
    if colours is not None:
        colour = nodes.new("ShaderNodeAttribute")
        colour.attribute_name = COLOUR
        links.new(colour.outputs["Color"], shader.inputs["Base Color"])
    links.new(shader.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    material.diffuse_color = SKIN  # in viewports that show no materials
    return material


def _material(name: str) -> tuple[Any, Any, Any]:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, material.node_tree.nodes, material.node_tree.links


def add_view(scene: Any, described: dict[str, Any]) -> None:
    """The camera, a light beside it, a bright world, and viewports that look through the camera."""
    data = bpy.data.cameras.new("camera")
    data.sensor_fit = "AUTO"  # the longer side, by which the focal length and the shifts are measured
    data.lens = described["focal_length"] * data.sensor_width
    data.shift_x, data.shift_y = described["shift"]
    data.clip_start = 0.01
    camera = add_object("camera", data)
    camera.matrix_world = Matrix(described["matrix"])
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = described["width"], described["height"]
    aspect = described["pixel_aspect"]
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = max(1.0, 1 / aspect), max(1.0, aspect)

    sun = bpy.data.lights.new("light", "SUN")
    sun.energy, sun.angle = 3.0, 0.3
    light = add_object("light", sun)
    light.matrix_world = camera.matrix_world @ Matrix.Rotation(0.4, 4, "Y") @ Matrix.Rotation(-0.5, 4, "X")
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.3, 0.3, 0.3, 1)
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                area.spaces[0].region_3d.view_perspective = "CAMERA"
                area.spaces[0].shading.type = "MATERIAL"


def main() -> None:
    """Build and save."""
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parts, out = map(Path, arguments)
    build(parts)
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(out), compress=True)


if __name__ == "__main__":
    main()
