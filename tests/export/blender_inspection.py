"""Run by Blender's own Python: play a file, and write what is seen to an ``.npz``."""

# pyright: reportMissingImports=false

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

LOOKS = {
    "radius": ("value", 1),
    "colour": ("color", 4),
    "surface_uv_coordinate": ("vector", 2),
    "strand_id": ("value", 1),
}


def played(name: Any) -> np.ndarray:
    """World positions of an object's points in the present frame."""
    evaluated = name.evaluated_get(bpy.context.evaluated_depsgraph_get())
    positions = evaluated.data.attributes["position"].data
    points = values(positions, "vector", 3)
    matrix = np.array(evaluated.matrix_world)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def values(data: Any, name: str, width: int) -> np.ndarray:
    """Values of an attribute, (n, width)."""
    found = np.empty(len(data) * width, np.int32 if data and isinstance(getattr(data[0], name), int) else np.float32)
    data.foreach_get(name, found)
    return found.reshape(-1, width)


def main() -> None:
    """Open, play, write."""
    path, out = map(Path, (sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]))
    if path.suffix == ".blend":
        bpy.ops.wm.open_mainfile(filepath=str(path))
    else:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        if path.suffix == ".abc":
            bpy.ops.wm.alembic_import(filepath=str(path), set_frame_range=True, scale=0.01)
        else:
            bpy.ops.wm.usd_import(filepath=str(path), set_frame_range=True)
    scene = bpy.context.scene
    hair = next(each for each in scene.objects if each.type == "CURVES")
    heads = [each for each in scene.objects if each.type == "MESH"]
    poses = [each for each in scene.objects if each.type == "EMPTY" and each.name.startswith("head")]
    frames = range(scene.frame_start, scene.frame_end + 1)
    strands, head, pose = [], [], []
    for frame in frames:
        scene.frame_set(frame)
        strands.append(played(hair))
        head += [played(each) for each in heads]
        pose += [np.array(each.matrix_world) for each in poses]
    found: dict[str, Any] = {"hair": strands, "range": [frames[0], frames[-1]]}
    found["fps"] = scene.render.fps / scene.render.fps_base
    found["counts"] = [curve.points_length for curve in hair.data.curves]
    found.update({name: every for name, every in (("head", head), ("head_pose", pose)) if every})
    attributes = hair.data.attributes
    looks = {name: values(attributes[name].data, *kind) for name, kind in LOOKS.items() if name in attributes}
    found.update({name: look[:, 0] if look.shape[1] == 1 else look[:, :3] for name, look in looks.items()})
    for each in heads:
        if "colour" in each.data.attributes:
            found["head_colour"] = values(each.data.attributes["colour"].data, "color", 4)[:, :3]
    scene.frame_set(frames[0], subframe=0.5)
    found["halfway"] = played(hair)
    scene.frame_set(frames[0])
    if scene.camera is not None:
        views = [world_to_camera_view(scene, scene.camera, Vector(point)) for point in strands[0].tolist()]
        found["projected"] = np.array(views)[:, :2]
    np.savez(out, allow_pickle=False, **{name: np.array(value) for name, value in found.items()})


if __name__ == "__main__":
    main()
