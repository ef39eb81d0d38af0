"""Motions of random strands and meshes."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from dynhair.export.strand_motion import MotionFrame, StrandMotion


def any_motion(
    strands: int = 5, points: int = 4, frames: int = 3, *, mesh: bool = True, fps: float = 25.0, seed: int = 0
) -> StrandMotion:
    random = np.random.default_rng(seed)
    moving = random.normal(size=(frames, strands, points, 3)).astype(np.float32)
    skin = random.normal(size=(frames, 7, 3)).astype(np.float32)
    transforms = np.tile(np.eye(4), (frames, 1, 1))
    transforms[:, :3, :3] = Rotation.from_rotvec(random.normal(size=(frames, 3))).as_matrix()
    transforms[:, :3, 3] = random.normal(size=(frames, 3))
    return StrandMotion(
        at=lambda index: MotionFrame(moving[index], skin[index] if mesh else None),
        fps=fps,
        widths=random.uniform(1e-4, 1e-3, (strands, points)).astype(np.float32),
        colours=random.random((strands, points, 3), np.float32),
        root_uvs=random.random((strands, 2), np.float32),
        ids=np.sort(random.choice(10 * strands, strands, replace=False)),
        head_transforms=transforms,
        head_faces=np.array([[0, 1, 2], [3, 4, 5], [4, 5, 6]]) if mesh else None,
        head_colours=random.random((7, 3), np.float32) if mesh else None,
    )
