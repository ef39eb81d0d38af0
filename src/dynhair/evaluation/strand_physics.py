"""Physical realism of moving strands (paper, "Ablation Study", "Physical realism"): VER, CTS, P95-Disp and AMD.

With p_ij^t the j-th of M points of the i-th of N strands in frame t, and v_ij^t = (p_ij^(t+1) - p_ij^t) / dt,

    VER      = max_tij |v_ij^t| / (median_tij |v_ij^t| + e)                                      a ratio
    CTS      = mean_tij |c_ij^(t+1) - c_ij^t|,  c_ij = p_i(j+1) - 2 p_ij + p_i(j-1)               metres
    P95-Disp = 95th percentile over t of max_ij |p_ij^(t+1) - p_ij^t|                             metres
    AMD      = mean_t |L^t - L^1|,  L^t = sum_ij (p_ij^t - mean_ij p_ij^t) x v_ij^t               m^2/s

What the paper leaves open is decided by the size of its figures. Points are taken in the head's frame: there its
ratio of the fastest speed to the median, 27, is what real hair has (true strands of a head that starts and stops: 25,
against 11 in the world, where the head's own motion carries every point), and a rigid hairstyle scores 0. The
curvature vector is the plain second difference: its change is of the order of 1e-4 m as in the paper's table, and
1/m if it is divided by the squared length of a segment. So CTS depends on how many points a strand has, and AMD on how
many points there are in all: figures compare only at equal counts, see `StrandSample`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.evaluation.quantiles import QuantileSketch

LEAST_SPEED = 1e-3
"""The e of VER, m/s: below any motion of hair, above the rounding that a rigid hairstyle's poses leave."""


class PhysicsFigures(NamedTuple):
    """The four figures; ``nan`` where no two consecutive frames were seen.

    Attributes:
        ver: velocity explosion ratio. Its median is within 0.1%.
        cts: curvature temporal smoothness, metres.
        p95_disp: displacement spike, metres between two frames.
        amd: angular momentum drift, m^2/s of unit mass a point.
    """

    ver: float
    cts: float
    p95_disp: float
    amd: float


class StrandPhysics:
    """Adds up consecutive frames of a motion, remembering the last: constant memory but for one number a frame.

    Args:
        fps: frames per second.
    """

    def __init__(self, fps: float) -> None:
        if not fps > 0:
            raise DynhairError(f"the frame rate is {fps}", expected="a positive number")
        self._fps = fps
        self._last: Float[Tensor, "n l 3"] | None = None
        self._first_momentum: Float[Tensor, "3"] | None = None
        self._speeds = QuantileSketch()
        self._largest: list[float] = []
        self._bending_change, self._drift = 0.0, 0.0

    def add(self, strands: Float[Tensor, "n l 3"]) -> None:
        """Add the next frame.

        Args:
            strands: in the head's frame, metres; as many as in the frame before, of three points or more.
        """
        strands = strands.detach().cpu().double()
        last, self._last = self._last, strands
        if last is None:
            return
        if strands.shape != last.shape:
            raise DynhairError(f"strands of shape {list(strands.shape)}", expected=f"the {list(last.shape)} before")
        moved = strands - last
        distances = moved.norm(dim=-1)
        self._speeds.add((distances * self._fps).flatten().numpy())
        self._largest.append(distances.max().item())
        self._bending_change += moved.diff(n=2, dim=1).norm(dim=-1).mean().item()
        arms = last - last.mean(dim=(0, 1))
        momentum = torch.linalg.cross(arms, moved * self._fps).sum(dim=(0, 1))
        if self._first_momentum is None:
            self._first_momentum = momentum
        self._drift += (momentum - self._first_momentum).norm().item()

    def merge(self, other: StrandPhysics) -> None:
        """Add another motion, which drifts from its own first frame."""
        self._speeds.merge(other._speeds)
        self._largest += other._largest
        self._bending_change += other._bending_change
        self._drift += other._drift

    def figures(self) -> PhysicsFigures:
        """Take the figures of all that was added."""
        pairs = len(self._largest)
        if not pairs:
            return PhysicsFigures(math.nan, math.nan, math.nan, math.nan)
        largest = max(self._largest) * self._fps
        return PhysicsFigures(
            ver=largest / (self._speeds.quantile(0.5) + LEAST_SPEED),
            cts=self._bending_change / pairs,
            p95_disp=float(np.percentile(self._largest, 95)),
            amd=self._drift / pairs,
        )
