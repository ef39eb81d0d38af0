"""Run by Blender's own Python: hair dynamics of guide strands on a head that moves.

It imports nothing but NumPy and Blender's module. Arguments: the folder of the description (``head.npz`` and
``settings.json``, as :mod:`studies.hair_motion.simulation` writes them), and the ``.npy`` to write: the guides of
every frame.
"""

# pyright: reportMissingImports=false

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np


def simulate(parts: Path) -> np.ndarray:
    """Positions of the guides' points, (frames, strands, points, 3), in the world."""
    settings = json.loads((parts / "settings.json").read_text(encoding="utf-8"))
    with np.load(parts / "head.npz", allow_pickle=False) as arrays:
        head = dict(arrays)
    frames = len(head["vertices"])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.render.fps = 1, frames, round(settings["fps"])
    cache = parts / "head.pc2"
    write_point_cache(cache, head["vertices"])

    collider = moving_mesh("collider", head["vertices"][0], head["faces"], cache)
    collider.modifiers.new("collision", "COLLISION")
    collider.collision.thickness_outer = 0.002
    collider.collision.cloth_friction = 5.0
    collider.collision.damping = 0.5
    scalp = moving_mesh("scalp", head["vertices"][0], head["faces"][head["scalp"]], cache)
    grow(scalp, head["guides"])
    set_dynamics(scalp.particle_systems[0], settings["material"], frames)
    return np.stack([guides_at(scalp, frame, head["guides"].shape[:2]) for frame in range(1, frames + 1)])


def write_point_cache(path: Path, vertices: np.ndarray) -> None:
    """Positions of a mesh in each frame, as Blender's modifier reads them (PC2)."""
    count, points = vertices.shape[:2]
    with path.open("wb") as file:
        file.write(b"POINTCACHE2\0" + struct.pack("<iiffi", 1, points, 1.0, 1.0, count))
        file.write(vertices.astype("<f4").tobytes())


def moving_mesh(name: str, vertices: np.ndarray, faces: np.ndarray, cache: Path) -> Any:
    """An object of the scene that plays a point cache."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    mesh.update()
    added = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(added)
    playing = added.modifiers.new("cache", "MESH_CACHE")
    playing.cache_format, playing.filepath, playing.frame_start = "PC2", str(cache.resolve()), 1
    return added


def grow(scalp: Any, guides: np.ndarray) -> None:
    """Give the scalp a particle system of these strands: only particles have dynamics."""
    curves = bpy.data.hair_curves.new("guides")
    curves.add_curves([guides.shape[1]] * len(guides))
    curves.attributes["position"].data.foreach_set("vector", guides.astype(np.float32).ravel())
    added = bpy.data.objects.new("guides", curves)
    bpy.context.scene.collection.objects.link(added)
    curves.surface = scalp
    bpy.context.view_layer.objects.active = added
    added.select_set(True)
    bpy.ops.curves.convert_to_particle_system()
    bpy.data.objects.remove(added)
    found = len(scalp.particle_systems[0].particles)
    if found != len(guides):
        raise SystemExit(f"Blender made {found} strands of {len(guides)}")


def set_dynamics(system: Any, material: dict[str, float], frames: int) -> None:
    """Implicit mass-spring strands with bending, drag and collisions; no strand feels another."""
    system.use_hair_dynamics = True
    cloth = system.cloth.settings
    cloth.quality = 5
    cloth.mass = material["mass"]
    cloth.bending_stiffness, cloth.bending_damping = material["bending"], material["bending_damping"]
    cloth.tension_stiffness, cloth.tension_damping = material["tension"], 5.0
    cloth.air_damping, cloth.internal_friction, cloth.pin_stiffness = material["air"], 0.0, 0.0
    contact = system.cloth.collision_settings
    contact.use_collision, contact.distance_min, contact.friction = True, 0.006, 0.5
    contact.collision_quality = 3
    system.point_cache.frame_start, system.point_cache.frame_end = 1, frames


def guides_at(scalp: Any, frame: int, shape: tuple[int, int]) -> np.ndarray:
    """The strands of one frame; frames are asked for in order, for each is simulated from the one before."""
    bpy.context.scene.frame_set(frame)
    evaluated = scalp.evaluated_get(bpy.context.evaluated_depsgraph_get())
    modifier = next(each for each in evaluated.modifiers if each.type == "PARTICLE_SYSTEM")
    strands = np.empty((*shape, 3), np.float32)
    for strand, particle in zip(strands, evaluated.particle_systems[0].particles, strict=True):
        for point, key in zip(strand, particle.hair_keys, strict=True):
            point[:] = key.co_object(evaluated, modifier, particle)
    return strands


if __name__ == "__main__":
    described, written = map(Path, (sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])[:2])
    np.save(written, simulate(described), allow_pickle=False)
