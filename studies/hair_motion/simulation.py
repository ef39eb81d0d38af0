"""Guide strands on a moving head, simulated by Blender's hair dynamics; each motion is kept in a file of its own."""

from __future__ import annotations

import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation
from studies.hair_motion.grooms import GROOMS, HeadMesh, guides, head_mesh
from studies.hair_motion.motions import FPS, HeadMotion, head_motion

from dynhair.animation.procedural import PIVOT
from dynhair.errors import DynhairError
from dynhair.export.blender import Z_UP, run_in_blender
from dynhair.storage import atomic_file, write_json

SCRIPT = Path(__file__).with_name("blender_hair.py")

SETTLING = 90
"""Frames at rest in which combed hair takes the place that physics gives it."""

RESETTLING = 35
"""Frames at rest before each motion, whose hair is combed as it has settled."""


def simulated(folder: Path, groom: str, motion: str, disturbance: float = 0.0) -> Path:
    """Simulate one motion, unless its file is there already.

    The file holds ``guides``, positions in the head's frame, metres, frame by frame from the first after settling, and
    the head's ``rotations`` and ``translations``.

    Args:
        folder: where files are kept, one folder a groom.
        groom: one of `GROOMS`.
        motion: as `head_motion` knows it.
        disturbance: metres by which the strands are randomly displaced before they move: how far two runs part says
            how far the motion can be predicted at all.

    Raises:
        DynhairError: there is no such groom or motion, no Blender, or it fails.
    """
    if groom not in GROOMS:
        raise DynhairError(f"no groom is called `{groom}`", expected=" or ".join(GROOMS))
    path = folder / groom / (f"{motion}.npz" if disturbance == 0 else f"{motion}-disturbed.npz")
    if path.exists():
        return path
    moved = head_motion(motion)
    rest = _settled(folder / groom / "settled.npy", groom)
    if disturbance > 0:
        noise = np.random.Generator(np.random.PCG64(7)).standard_normal(rest.shape)
        rest = rest + disturbance * noise * (np.arange(rest.shape[1]) > 1)[:, None]
    world = _hair(groom, rest, moved, RESETTLING, path)
    in_head = np.einsum("fnkc,fcd->fnkd", world - moved.translations[:, None, None], moved.rotations)
    with atomic_file(path) as temporary:
        np.savez_compressed(
            temporary,
            guides=in_head.astype(np.float32),
            rotations=moved.rotations,
            translations=moved.translations,
        )
    return path


def _settled(path: Path, groom: str) -> Float64[np.ndarray, "n k 3"]:
    """The guides when they have come to rest on the motionless head."""
    if not path.exists():
        still = head_motion("turn", 1)
        with atomic_file(path) as temporary:
            np.save(temporary, _hair(groom, guides(groom).astype(np.float64), still, SETTLING, path)[-1])
    return np.load(path, allow_pickle=False)


def _hair(
    groom: str, rest: Float64[np.ndarray, "n k 3"], motion: HeadMotion, settling: int, path: Path
) -> Float64[np.ndarray, "f n k 3"]:
    """Guides in the world, in each frame of a motion that begins after some frames at rest."""
    head = head_mesh()
    vertices = np.concatenate([np.repeat(head.vertices[None], settling, 0), posed_head(head, motion)])
    with tempfile.TemporaryDirectory() as parts:
        np.savez(
            Path(parts) / "head.npz",
            vertices=(vertices @ Z_UP.T).astype(np.float32),
            faces=head.faces,
            scalp=head.scalp,
            guides=(rest @ Z_UP.T).astype(np.float32),
        )
        write_json(Path(parts) / "settings.json", {"fps": FPS, "material": asdict(GROOMS[groom].material)})
        return _blender(Path(parts), path)[settling:] @ Z_UP


def posed_head(head: HeadMesh, motion: HeadMotion) -> Float64[np.ndarray, "f v 3"]:
    """The mesh in each frame: a vertex turns about the neck by its share of the head's turn."""
    turns = Rotation.from_matrix(motion.rotations).as_rotvec()
    arms = head.vertices.astype(np.float64) - PIVOT
    frames = [Rotation.from_rotvec(head.weight[:, None] * turn).apply(arms) for turn in turns]
    return np.stack(frames) + PIVOT + motion.sway[:, None]


def _blender(parts: Path, path: Path) -> Float[np.ndarray, "f n k 3"]:
    written = parts / "guides.npy"
    run_in_blender(SCRIPT, parts, written, path)
    found = np.load(written, allow_pickle=False)
    if not np.isfinite(found).all():
        raise DynhairError("Blender's hair flew off", path=path, expected="finite positions")
    return found
