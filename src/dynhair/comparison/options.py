"""What a user decides about the rows of a comparison or ablation; light to import, as the command line reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

PresetName = Literal["tiny", "small", "medium", "paper"]


@dataclass(frozen=True)
class RowOptions:
    """How rows are trained, and how many at once.

    Attributes:
        preset: Sizes and iterations of all rows.
        iterations: Steps of each training, if others than the preset's.
        seeds: Each row is trained once with each of these.
        jobs: How many rows run at once; one for each core by default, and one on a GPU.
        memory: GB that all rows may take together; 80 % of what is free by default.
    """

    preset: PresetName = "small"
    iterations: int | None = None
    seeds: tuple[int, ...] = (0,)
    jobs: int | None = None
    memory: float | None = None
