"""Splats in ``.ply`` files, as plyfile reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from plyfile import PlyData

from dynhair.export.splats import Splats


def read_splats(path: Path) -> Splats:
    table = PlyData.read(path)["vertex"]

    def columns(*names: str) -> torch.Tensor:
        return torch.from_numpy(np.stack([np.asarray(table[name], np.float32) for name in names], 1))

    base = columns(*(f"f_dc_{i}" for i in range(3)))
    higher = columns(*(f"f_rest_{i}" for i in range(45))).unflatten(1, (3, 15)).mT
    return Splats(
        means=columns("x", "y", "z"),
        quats=columns(*(f"rot_{i}" for i in range(4))),
        scales=columns(*(f"scale_{i}" for i in range(3))).exp(),
        opacities=columns("opacity")[:, 0].sigmoid(),
        harmonics=torch.cat([base[:, None], higher], 1),
    ).half_turned()
