"""The figures of an evaluation: what each means, and their running means over images and frames."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.evaluation.definitions import (
    BOUNDARY_FIGURES,
    DEFINITIONS,
    FACE_FIGURES,
    MOTION,
    STILL_FIGURES,
    TORSO_FIGURES,
)
from dynhair.evaluation.hair_motion import motion_explained

_NOT_SEEN = {
    FACE_FIGURES: "no evaluated image shows the face",
    BOUNDARY_FIGURES: "no evaluated image shows an edge of hair",
    STILL_FIGURES: "no motion begins with a head that rests for two frames",
    TORSO_FIGURES: "no evaluated image shows edges of the torso in two frames",
}
"""Why figures have no samples where all that they need is there."""


@dataclass(frozen=True)
class Figures:
    """Means over some frames and all their views.

    Attributes:
        values: by name of figure; None where it could not be measured.
        reasons: why, for each that is None.
        samples: over how many images, pairs of images or (for the motion) frames each was averaged.
        frames: frames evaluated.
        images: images evaluated, one for each frame and view.
    """

    values: Mapping[str, float | None]
    reasons: Mapping[str, str]
    samples: Mapping[str, int]
    frames: int
    images: int

    @classmethod
    def unmeasured(cls, reason: str) -> Figures:
        """Leave out all figures for one reason."""
        return cls(dict.fromkeys(DEFINITIONS), dict.fromkeys(DEFINITIONS, reason), dict.fromkeys(DEFINITIONS, 0), 0, 0)

    def to_json(self) -> dict[str, Any]:
        """Lay out the figures by name, then their counts and reasons."""
        return {
            **self.values,
            "frames": self.frames,
            "images": self.images,
            "samples": dict(self.samples),
            "reasons": dict(self.reasons),
        }


@runtime_checkable
class _Mergeable(Protocol):
    def merge(self, other: Any, /) -> None: ...


class FigureSums:
    """Running sums in double precision: constant memory however many frames are added.

    Args:
        held_out: for each view whether training held it out.

    Attributes:
        frames: that were added.
        images: that were added.
        held_out: sums over the views held out alone; None where there are none.
    """

    def __init__(self, held_out: Sequence[bool] = ()) -> None:
        self.frames = 0
        self.images = 0
        self.held_out: FigureSums | None = FigureSums() if any(held_out) else None
        self._held_out_views = torch.tensor(list(held_out), dtype=torch.bool)
        self._sums: defaultdict[str, float] = defaultdict(float)
        self._samples: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._pools: dict[tuple[str, ...], tuple[_Mergeable, Callable[[Any], Sequence[float]]]] = {}

    def add_frame(self, images: int) -> None:
        """Count one frame seen from ``images`` cameras."""
        self.frames += 1
        self.images += images
        if self.held_out is not None:
            self.held_out.add_frame(int(self._held_out_views.sum()))

    def add(self, name: str, values: Float[Tensor, " v"]) -> None:
        """Add one value a view; ``nan`` marks a view where the figure is not defined, and is left out."""
        defined = values[~values.isnan()].double()
        self._sums[name] += defined.sum().item()
        self._samples[name] += len(defined)
        if self.held_out is not None:
            self.held_out.add(name, values[self._held_out_views])

    def add_value(self, name: str, value: float) -> None:
        """Add what is of all views together; ``nan`` where the figure is not defined is left out."""
        if not math.isnan(value):
            self._sums[name] += value
            self._samples[name] += 1

    def add_motion(self, error: float, rigid_error: float) -> None:
        """Add one frame's mean errors of hair motion, the avatar's and a rigid hairstyle's, metres."""
        self._sums["error"] += error
        self._sums["rigid_error"] += rigid_error
        self._samples[MOTION] += 1

    def add_optional(self, name: str, value: float | None) -> None:
        """Add what is of a whole segment; None where the figure is not defined is left out."""
        if value is not None:
            self.add_value(name, value)

    def pool(
        self, names: Sequence[str], sums: _Mergeable, read: Callable[[Any], Sequence[float]], samples: int
    ) -> None:
        """Add sums of another kind, behind figures that are no means of values.

        Args:
            names: of the figures.
            sums: that can ``merge`` others of their kind.
            read: takes the figures of such sums, in the order of the names; ``nan`` where not defined.
            samples: what they were taken of.
        """
        names = tuple(names)
        if names in self._pools:
            self._pools[names][0].merge(sums)
        else:
            self._pools[names] = deepcopy(sums), read
        self._samples.update(dict.fromkeys(names, samples))

    def explain(self, reason: str, *names: str) -> None:
        """Say why these figures have no samples, should it stay so."""
        self._reasons.update(dict.fromkeys(names, reason))
        if self.held_out is not None:
            self.held_out.explain(reason, *names)

    def merge(self, other: FigureSums) -> None:
        """Add all that ``other`` has seen."""
        self.frames += other.frames
        self.images += other.images
        for name, value in other._sums.items():
            self._sums[name] += value
        pooled = {name for names in other._pools for name in names}
        self._samples.update({name: count for name, count in other._samples.items() if name not in pooled})
        for names, (pool, read) in other._pools.items():
            self.pool(names, pool, read, other._samples[names[0]])
        self._reasons.update(other._reasons)
        if self.held_out is not None and other.held_out is not None:
            self.held_out.merge(other.held_out)

    def figures(self) -> Figures:
        """Take the means of all that was added."""
        means = {name: self._mean(name) for name in DEFINITIONS}
        for names, (pool, read) in self._pools.items():
            values = zip(names, read(pool), strict=True)
            means.update({name: None if math.isnan(value) else value for name, value in values})
        reasons = {
            name: self._reasons.get(name, self._default_reason(name)) for name, mean in means.items() if mean is None
        }
        samples = {name: self._samples[name] for name in DEFINITIONS}
        return Figures(means, reasons, samples, self.frames, self.images)

    def _mean(self, name: str) -> float | None:
        count = self._samples[name]
        if not count:
            return None
        if name != MOTION:
            return self._sums[name] / count
        explained = motion_explained(self._sums["error"] / count, self._sums["rigid_error"] / count)
        return None if math.isnan(explained) else explained

    def _default_reason(self, name: str) -> str:
        if self._samples[name]:
            return "the truth's hair stands still in these frames"
        return next((reason for names, reason in _NOT_SEEN.items() if name in names), "no evaluated image shows hair")
