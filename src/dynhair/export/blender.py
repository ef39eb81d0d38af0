"""``.blend``: hair and head in motion as a Blender scene that plays when it is opened.

Blender itself writes it, in a process of its own, by :mod:`dynhair.export.blender_scene`. Its Python module, ``bpy``,
cannot be an extra: it wants NumPy 1 and one version of Python.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float64

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.export.colours import linear_colours
from dynhair.export.strand_motion import StrandMotion
from dynhair.storage import atomic_file, write_json

VARIABLE = "DYNHAIR_BLENDER"
"""Names the Blender to use, or a Python that has ``bpy``."""

SCENE = Path(__file__).with_name("blender_scene.py")

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""From our axes, y up, to Blender's, z up: what faces +z then faces -y, Blender's front."""


def write_blend(path: Path | str, motion: StrandMotion, camera: Camera | None = None) -> None:
    """Write a Blender scene, atomically: metres, z up, at the motion's frame rate, frame 0 the motion's first.

    - ``hair``: hair curves that move, with radii and the attributes ``colour`` (linear), ``surface_uv_coordinate`` (on
      the scalp) and ``strand_id``;
    - ``head``: the head mesh, if the motion has one, moving likewise, with the attribute ``colour`` if its colours are
      known;
    - ``head_pose``: an empty with the head's pose, to which things may be fastened;
    - ``camera``: a view of it all, and a light.

    Every frame's positions are in the file as attributes, between which geometry nodes interpolate: Blender has no
    shape keys for hair curves, and caches in files beside the scene get lost.

    Args:
        path: ends in ``.blend``.
        motion: what to write.
        camera: from where the scene is seen; without it, from before the hair.

    Raises:
        DynhairError: there is no Blender, it fails, or a frame is not what the motion says.
    """
    with tempfile.TemporaryDirectory() as parts, atomic_file(path) as temporary:
        _write_parts(Path(parts), motion, camera)
        run_in_blender(SCENE, Path(parts), temporary.resolve(), path)


def run_in_blender(script: Path, parts: Path, written: Path, path: Path | str) -> None:
    """Run a script in Blender.

    Args:
        script: the first of its arguments is where it reads, the second what it writes.
        parts: the folder that it reads.
        written: the file that it writes.
        path: what is made by it in the end, for the message of an error.

    Raises:
        DynhairError: there is no Blender, or it fails.
    """
    # what of our environment is for our Python is wrong for Blender's
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [*blender_program(script), str(parts), str(written)],
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if done.returncode or not written.exists() or not written.stat().st_size:
        said = "\n".join((done.stdout + done.stderr).strip().splitlines()[-12:])
        raise DynhairError(
            f"Blender failed with status {done.returncode}:\n{said}", path=path, expected="Blender 5.0 or later"
        )


def blender_program(script: Path = SCENE) -> list[str]:
    """The command that runs a script in Blender, but for the script's arguments.

    It is the program that the variable DYNHAIR_BLENDER names, ``blender`` on the path, or this Python if it has
    ``bpy``.

    Raises:
        DynhairError: there is none of them.
    """
    named = os.environ.get(VARIABLE)
    program = shutil.which(named or "blender")
    if program is None and named is None and find_spec("bpy") is not None:
        program = sys.executable
    if program is None:
        raise DynhairError(
            "there is no Blender" if named is None else f"{VARIABLE} names {named}, which is no program",
            expected="Blender 5.0 or later",
            mend=f"install Blender, or name it by {VARIABLE}; a Python that has bpy will do: "
            "python3.11 -m venv bpy && bpy/bin/pip install bpy==5.0.1, and then bpy/bin/python",
        )
    if Path(program).stem.lower().startswith("python"):
        return [program, str(script)]
    return [program, "--background", "--factory-startup", "--python-exit-code", "1", "--python", str(script), "--"]


def _write_parts(folder: Path, motion: StrandMotion, camera: Camera | None) -> None:
    """What the script reads: arrays of Blender's axes."""
    count, points = motion.widths.shape
    frames = len(motion)
    strands = np.lib.format.open_memmap(folder / "strands.npy", "w+", np.float32, (frames, count * points, 3))
    head = None
    for index, frame in enumerate(motion):
        strands[index] = frame.strands.reshape(-1, 3) @ Z_UP.T
        if frame.head is not None:
            if head is None:
                head = np.lib.format.open_memmap(folder / "head.npy", "w+", np.float32, (frames, *frame.head.shape))
            head[index] = frame.head @ Z_UP.T
    arrays = {
        "radii": motion.widths / 2,
        "colours": linear_colours(motion.colours),
        "root_uvs": motion.root_uvs,
        "ids": motion.ids.astype(np.int32),
        "head_transforms": _z_up(motion.head_transforms),
    }
    if motion.head_faces is not None:
        arrays["head_faces"] = motion.head_faces.astype(np.int32)
    if motion.head_colours is not None:
        arrays["head_colours"] = linear_colours(motion.head_colours)
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array, allow_pickle=False)
    camera = _camera_before(strands[0]) if camera is None else camera
    write_json(folder / "scene.json", {"fps": motion.fps, "points": points, "camera": _camera(camera)})


def _z_up(transforms: Float64[np.ndarray, "*f 4 4"]) -> Float64[np.ndarray, "*f 4 4"]:
    """Frames in Blender's axes, whose own axes stay what they are: an object fastened there keeps its coordinates."""
    turn = np.eye(4)
    turn[:3, :3] = Z_UP
    return turn @ transforms


def _camera(camera: Camera) -> dict[str, object]:
    """A camera as Blender has them: x right, y up, looking along -z."""
    to_world = np.eye(4)
    w2c = camera.w2c.double().cpu().numpy()
    to_world[:3, :3] = w2c[:, :3].T @ np.diag([1, -1, -1])
    to_world[:3, 3] = -w2c[:, :3].T @ w2c[:, 3]
    fx, fy, cx, cy = (float(camera.K[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    aspect = fx / fy  # height of a pixel in its widths
    longest = max(camera.width, aspect * camera.height)
    return {
        "matrix": _z_up(to_world).tolist(),
        "width": camera.width,
        "height": camera.height,
        "pixel_aspect": aspect,
        # in lengths of the image's longer side
        "focal_length": fx / longest,
        "shift": [(camera.width / 2 - cx) / longest, aspect * (cy - camera.height / 2) / longest],
    }


def _camera_before(strands: Float[np.ndarray, "p 3"]) -> Camera:
    """A camera before the hair, as far off as it is wide three times, in our axes."""
    points = strands @ Z_UP
    middle, extent = (points.max(0) + points.min(0)) / 2, float((points.max(0) - points.min(0)).max())
    turn = torch.diag(torch.tensor([1.0, -1, -1]))
    eye = torch.from_numpy(middle).float() + torch.tensor([0, 0, 3 * extent])
    K = torch.tensor([[1000.0, 0, 256], [0, 1000, 256], [0, 0, 1]])
    return Camera(torch.cat([turn, -(turn @ eye)[:, None]], 1), K, 512, 512)
