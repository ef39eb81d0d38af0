"""Moving strands as numbered files, one a frame, in the formats of single grooms."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import torch

from dynhair.export.strand_motion import MotionFrame, StrandMotion
from dynhair.strands.files import StrandFile, write_strands

StrandEnding = Literal["hair", "data", "npz", "ply"]


def numbered(folder: Path, number: int, ending: str) -> Path:
    """The file of one frame in a folder of a sequence; the names sort as the frames do."""
    return folder / f"{number:04d}.{ending}"


def strand_file(motion: StrandMotion, frame: MotionFrame) -> StrandFile:
    """One frame's strands with their widths (metres) and colours (sRGB in [0, 1]), as files of strands hold them."""
    strands, points, _ = frame.strands.shape
    return StrandFile(
        points=torch.from_numpy(frame.strands).reshape(-1, 3),
        counts=torch.full((strands,), points, dtype=torch.int64),
        widths=torch.from_numpy(motion.widths).flatten(),
        colours=torch.from_numpy(motion.colours).reshape(-1, 3),
    )


def write_strand_sequence(folder: Path, motion: StrandMotion, ending: StrandEnding, *, first: int = 0) -> list[Path]:
    """Write a file for each frame: world, metres, y up, root first.

    Args:
        folder: where; files in it are overwritten.
        motion: what.
        ending: of the files' names, which chooses the format; ``.data`` holds neither widths nor colours.
        first: number of the first frame.

    Returns:
        The files, in order.

    Raises:
        DynhairError: a frame is not what the motion says.
    """
    paths = []
    for number, frame in enumerate(motion, first):
        paths.append(numbered(folder, number, ending))
        write_strands(paths[-1], strand_file(motion, frame))
    return paths
