"""What is in the scenes under ``data``.

Control point ``k`` of an object whose points are counted from ``start`` is ``(i / 8, sin i, cos i)`` with
``i = start + k``.

``blender.abc`` and ``blender.usdc`` were exported by Blender 5.0.1 with its own settings: hair curves "fringe" (3, 5
and 2 points from 0, radius (i + 1) / 64) moved by location (1, 2, 3), Euler angles XYZ (0.3, 0.5, 0.7) and scale 2,
below an empty "head", turned by 90 degrees about z, that moves from (0, 0, -1) at frame 1 to (5, 5, 5) at frame 3; and
"back" (4 and 2 points from 20), not moved. ``mesh.abc`` was too, and holds a triangle.

``operations.abc`` was written by Alembic 1.8.12 through its Python bindings, and its matrices were read back by them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

DATA = Path(__file__).parent / "data"


def control_points(start: int, count: int) -> np.ndarray:
    i = np.arange(start, start + count)
    return np.stack([i / 8, np.sin(i), np.cos(i)], axis=1)


def blender_scene() -> tuple[list[list[int]], list[np.ndarray], list[np.ndarray]]:
    """Counts, points (y up) and widths of the fringe and of the back at frame 1."""
    fringe = 2 * Rotation.from_euler("xyz", [0.3, 0.5, 0.7]).apply(control_points(0, 10)) + [1, 2, 3]
    fringe = Rotation.from_euler("z", 90, degrees=True).apply(fringe) - np.eye(3)[2]
    points = [np.stack([p[:, 0], p[:, 2], -p[:, 1]], axis=1) for p in (fringe, control_points(20, 6))]
    return [[3, 5, 2], [4, 2]], points, [2 * 2 * np.arange(1, 11) / 64, 2 * np.arange(21, 27) / 64]
