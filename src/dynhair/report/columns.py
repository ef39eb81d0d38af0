"""The columns of the tables: which figures, how they are headed and rounded, and which values are good."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import Enum

from dynhair.report.comparison import TableName

EXTENDED_ABLATIONS = ("no-colour-terms", "no-raised-perceptual", "one-view")
"""The rows of the paper's Table 4; those of all other ablations are in Table 2."""


class Goal(Enum):
    """Which values are good: the sign that stands beside a heading."""

    HIGH = "↑"
    LOW = "↓"
    ZERO = "→0"
    TRUTH = "→truth"
    NONE = ""


@dataclass(frozen=True)
class Column:
    """One figure.

    Attributes:
        key: of the figure in ``metrics.json``.
        heading: in tables; ``_`` begins a subscript, which is the rest.
        name: in sentences.
        goal: which values are good.
        decimals: shown; three significant digits of the largest value where None.
        scale: by which the figure is multiplied when it is shown.
        unit: after scaling, for sentences.
        without_truth: which values are good where the truth's own figure is unknown, if the goal is the truth.
    """

    key: str
    heading: str
    name: str
    goal: Goal
    decimals: int | None
    scale: float = 1.0
    unit: str = ""
    without_truth: Goal = Goal.NONE

    @property
    def truth(self) -> str:
        """Key of the truth's own figure."""
        return f"{self.key}_truth"

    def goal_without_truth(self) -> Goal:
        """What is good where the truth's own figure is unknown."""
        return self.without_truth if self.goal is Goal.TRUTH else self.goal

    def places(self, values: Collection[float]) -> int:
        """Decimals that all of a column's values are shown with."""
        if self.decimals is not None:
            return self.decimals
        largest = max((abs(self.scale * value) for value in values), default=0.0)
        return max(0, 2 - math.floor(math.log10(largest))) if largest else 0

    def shown(self, value: float, places: int) -> str:
        """A value as readers see it, never a negative zero."""
        return f"{round(self.scale * value, places) + 0.0:.{places}f}"


@dataclass(frozen=True)
class Group:
    """Columns under one heading."""

    heading: str
    columns: tuple[Column, ...]


@dataclass(frozen=True)
class Layout:
    """A table before it is filled.

    Attributes:
        name: of its files.
        title: above it.
        groups: of columns.
        methods: of its rows; None for all. The method itself is always there.
        without: methods that it leaves out.
    """

    name: str
    title: str
    groups: tuple[Group, ...]
    methods: Collection[str] | None = None
    without: Collection[str] = ()

    @property
    def columns(self) -> tuple[Column, ...]:
        """All columns, in order."""
        return tuple(column for group in self.groups for column in group.columns)


PSNR = Column("psnr", "PSNR", "PSNR of the whole image", Goal.HIGH, 2, unit="dB")
SSIM = Column("ssim", "SSIM", "SSIM of the whole image", Goal.HIGH, 4)
LPIPS = Column("lpips", "LPIPS", "LPIPS of the whole image", Goal.LOW, 4)
FID = Column("fid", "FID", "FID of the whole image", Goal.LOW, 2)
HAIR_PSNR = Column("hair_psnr", "PSNR", "PSNR of the hair", Goal.HIGH, 2, unit="dB")
HAIR_SSIM = Column("hair_ssim", "SSIM", "SSIM of the hair", Goal.HIGH, 4)
HAIR_LPIPS = Column("hair_lpips", "LPIPS", "LPIPS of the hair", Goal.LOW, 4)
HAIR_FID = Column("hair_fid", "FID", "FID of the hair", Goal.LOW, 2)
IOU = Column("hair_iou", "IoU_hair", "IoU of the hair's silhouettes", Goal.HIGH, 3)
TIOU = Column("hair_tiou", "tIoU_hair", "tIoU of the hair from frame to frame", Goal.TRUTH, 3)
FLICKER = Column("hair_tlpips_excess", "tLPIPS_ex", "excess of temporal LPIPS", Goal.ZERO, 4)
VELOCITY = Column("hair_velocity", "vel., mm/s", "velocity of the hair", Goal.TRUTH, None, 1e3, "mm/s")
ACCELERATION = Column("hair_acceleration", "accel., mm/s²", "acceleration of the hair", Goal.TRUTH, None, 1e3, "mm/s²")

# The paper has the lowest values for the best; but rigid hair has 0, and where the truth is known, it moves.
PHYSICS = Group(
    "Physics",
    (
        Column("ver", "VER", "velocity explosion ratio", Goal.TRUTH, None, without_truth=Goal.LOW),
        Column("p95_disp", "P95", "spikes of displacement (P95)", Goal.TRUTH, None, without_truth=Goal.LOW),
        Column("cts", "CTS", "change of curvature over time (CTS)", Goal.TRUTH, None, without_truth=Goal.LOW),
        Column("amd", "AMD", "drift of angular momentum (AMD)", Goal.TRUTH, None, without_truth=Goal.LOW),
    ),
)
SILHOUETTE = Group(
    "Silhouette and appearance",
    (IOU, TIOU, Column("hair_lpips", "LPIPS_hair", "LPIPS of the hair", Goal.LOW, 4), FLICKER),
)

TABLE_1 = Layout(
    "table1",
    "Appearance and motion, as in the paper's Table 1",
    (
        Group("Full image", (PSNR, SSIM, LPIPS, FID)),
        Group("Hair region", (HAIR_PSNR, HAIR_SSIM, HAIR_LPIPS, IOU, TIOU, HAIR_FID)),
        Group("Temporal", (FLICKER,)),
        Group("Motion", (VELOCITY, ACCELERATION)),
    ),
)
TABLE_2 = Layout(
    "table2",
    "Physical realism of the hair's motion, as in the paper's Table 2",
    (SILHOUETTE, PHYSICS),
    without=EXTENDED_ABLATIONS,
)
TABLE_4 = Layout(
    "table4",
    "Colour terms, weight of the perceptual term and views, as in the paper's Table 4",
    (
        Group("Full image", (PSNR, SSIM, LPIPS)),
        Group("Hair region", (HAIR_PSNR, HAIR_SSIM, HAIR_LPIPS)),
        Group("Temporal", (FLICKER,)),
        Group("Hair silhouette", (Column("hair_iou", "IoU", IOU.name, Goal.HIGH, 3), TIOU)),
    ),
    methods=EXTENDED_ABLATIONS,
)
STRANDS = Group(
    "Strands",
    (
        Column("penetration_rate", "inside, %", "share of points inside the body", Goal.LOW, 3, 100.0, "%"),
        Column("penetration_depth_mm", "depth, mm", "depth inside the body", Goal.LOW, 2, unit="mm"),
        Column("stretch", "stretch, %", "stretch of the strands", Goal.ZERO, 2, 100.0, "%"),
    ),
)
SETTLING = Column("settling_s", "settling, s", "time to settle", Goal.TRUTH, 2, unit="s")
TABLE_DRIVEN = Layout(
    "driven",
    "Motion of the hair",
    (
        Group("Motion", (VELOCITY, ACCELERATION, SETTLING)),
        # beside nothing true the lowest, which are those of rigid hair, say nothing
        Group(PHYSICS.heading, tuple(replace(column, without_truth=Goal.NONE) for column in PHYSICS.columns)),
        STRANDS,
    ),
)
TABLE_MOTION = Layout(
    "motion",
    "How true the motion is, and what else the paper does not measure",
    (
        Group(
            "Against the true strands",
            (
                Column("hair_motion_explained", "explained", "share of the true motion explained", Goal.HIGH, 3),
                Column("tip_error_mm", "tips, mm", "error at the tips", Goal.LOW, 2, unit="mm"),
                Column("phase_lag_ms", "lag, ms", "lag behind the true motion", Goal.ZERO, 1, unit="ms"),
                SETTLING,
            ),
        ),
        STRANDS,
        Group(
            "Perception",
            (
                Column("flip", "FLIP", "FLIP of the whole image", Goal.LOW, 4),
                Column("lpips_vgg", "LPIPS_VGG", "LPIPS (VGG) of the whole image", Goal.LOW, 4),
                Column("hair_lpips_vgg", "hair LPIPS_VGG", "LPIPS (VGG) of the hair", Goal.LOW, 4),
            ),
        ),
    ),
)

LAYOUTS: dict[TableName, tuple[Layout, ...]] = {
    "baselines": (TABLE_1, TABLE_2, TABLE_MOTION),
    "ablations": (TABLE_2, TABLE_4, TABLE_MOTION),
}
"""The tables of each kind of comparison."""


def figures_of(table: TableName) -> tuple[Column, ...]:
    """Each figure of a comparison's tables once, in their order."""
    columns: dict[str, Column] = {}
    for layout in LAYOUTS[table]:
        for column in layout.columns:
            columns.setdefault(column.key, column)
    return tuple(columns.values())
