"""Strands as files hold them: any number of points each, with widths and colours where the file has them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32, Int64
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.strands.geometry import resample_strands


@dataclass(frozen=True)
class StrandFile:
    """Strands laid end to end, in the file's own unit and axes and in its order, which may be tip first.

    Attributes:
        points: points of all strands, strand by strand.
        counts: points of each strand, at least one; they sum to ``p``.
        widths: full width at each point, in the points' unit.
        transparencies: 0 opaque to 1 invisible, at each point.
        colours: red, green and blue at each point, 0 to 1.
    """

    points: Float32[Tensor, "p 3"]
    counts: Int64[Tensor, " n"]
    widths: Float32[Tensor, " p"] | None = None
    transparencies: Float32[Tensor, " p"] | None = None
    colours: Float32[Tensor, "p 3"] | None = None

    @classmethod
    def of(cls, strands: Float[Tensor, "n l 3"]) -> StrandFile:
        """Strands of equally many points each."""
        count, length, _ = strands.shape
        points = strands.detach().cpu().to(torch.float32).reshape(-1, 3).contiguous()
        return cls(points=points, counts=torch.full((count,), length, dtype=torch.int64))

    @classmethod
    def from_arrays(
        cls,
        path: Path,
        points: np.ndarray,
        counts: np.ndarray,
        *,
        widths: np.ndarray | None = None,
        transparencies: np.ndarray | None = None,
        colours: np.ndarray | None = None,
    ) -> StrandFile:
        """Arrays as a reader found them, as float32 and int64.

        Raises:
            DynhairError: the file holds no strands or impossible ones, see :meth:`check`.
        """
        given = {"points": points, "widths": widths, "transparencies": transparencies, "colours": colours}
        with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused
            found = {name: np.array(array, np.float32) for name, array in given.items() if array is not None}
        strands = cls(
            counts=torch.from_numpy(np.array(counts, np.int64)),
            **{name: torch.from_numpy(array) for name, array in found.items()},
        )
        strands.check(path)
        return strands

    def check(self, path: Path) -> None:
        """Refuse what no file of strands can hold.

        Args:
            path: the file concerned, for errors.

        Raises:
            DynhairError: there are no strands, counts do not add up to the points, or numbers are not finite.
        """
        if not len(self.counts):
            raise DynhairError("there are no strands in it", path=path)
        least, most = int(self.counts.min()), int(self.counts.max())
        if least < 1 or most > len(self.points) or int(self.counts.sum()) != len(self.points):
            raise DynhairError(
                f"{len(self.counts)} strands of {least} to {most} points are not its {len(self.points)} points",
                path=path,
                expected="strands of a point or more",
            )
        for field in fields(self):
            values = getattr(self, field.name)
            if values is None or field.name == "counts":
                continue
            if len(values) != len(self.points):
                raise DynhairError(f"there are {len(values)} {field.name} for {len(self.points)} points", path=path)
            if not torch.isfinite(values).all():
                bad = int((~torch.isfinite(values)).sum())
                raise DynhairError(
                    f"{bad} of the {values.numel()} numbers of its {field.name} are NaN or infinite",
                    path=path,
                    mend="export the strands again, without those that are broken",
                )

    def resampled(self, count: int) -> Float[Tensor, "n count 3"]:
        """Strands of equally many points, at equal steps of arc length, in the file's order.

        Strands of a single point, by which some data sets say that nothing grows on a root, are left out.

        Args:
            count: points of each strand.

        Raises:
            DynhairError: no strand has two points.
        """
        kept = self.counts >= 2
        if not kept.any():
            raise DynhairError("no strand has more than one point", expected="polylines")
        starts = self.counts.cumsum(0) - self.counts
        strands = self.points.new_empty(len(self.counts), count, 3)
        for length in self.counts[kept].unique().tolist():
            alike = (self.counts == length).nonzero()[:, 0]
            strands[alike] = resample_strands(self.points[starts[alike, None] + torch.arange(length)], count)
        return strands[kept]
