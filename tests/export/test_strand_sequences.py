"""Numbered files of strands and of the head mesh."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
from any_motion import any_motion

from dynhair.errors import DynhairError
from dynhair.export.mesh_sequences import write_mesh_sequence
from dynhair.export.strand_sequences import StrandEnding, write_strand_sequence
from dynhair.face.wavefront import read_triangles, read_vertices
from dynhair.strands.files import read_strands


@pytest.mark.parametrize("ending", get_args(StrandEnding))
def test_strands_come_back_from_every_format(ending: StrandEnding, tmp_path: Path) -> None:
    motion = any_motion()
    paths = write_strand_sequence(tmp_path, motion, ending, first=7)
    assert [path.name for path in paths] == [f"{number:04d}.{ending}" for number in (7, 8, 9)]
    for path, frame in zip(paths, motion, strict=True):
        found = read_strands(path)
        np.testing.assert_array_equal(found.points.reshape(frame.strands.shape), frame.strands)
        assert found.counts.tolist() == [4] * 5
        if ending != "data":
            assert found.widths is not None
            assert found.colours is not None
            assert torch.equal(found.widths, torch.from_numpy(motion.widths).flatten())
            assert torch.equal(found.colours, torch.from_numpy(motion.colours).reshape(-1, 3))


def test_the_head_mesh_comes_back(tmp_path: Path) -> None:
    motion = any_motion()
    for path, frame in zip(write_mesh_sequence(tmp_path, motion), motion, strict=True):
        assert frame.head is not None
        np.testing.assert_array_equal(read_vertices(path, 7).astype(np.float32), frame.head)
        np.testing.assert_array_equal(read_triangles(path), [[0, 1, 2], [3, 4, 5], [4, 5, 6]])


def test_a_motion_without_head_mesh_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="no head mesh"):
        write_mesh_sequence(tmp_path, any_motion(mesh=False))
