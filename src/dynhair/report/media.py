"""Videos and contact sheets of a comparison: the truth and all methods, of the same frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from PIL import Image

from dynhair.errors import DynhairError
from dynhair.report.clips import METHOD_PANEL, TRUTH_PANEL, Clip, contact_sheet
from dynhair.report.comparison import OURS, Comparison, Row
from dynhair.report.study import Pair
from dynhair.storage import atomic_file

SHEET_FRAMES = 6
TRUTH, DRIVER = "truth", "driver"


@dataclass(frozen=True)
class Footage:
    """The videos of one motion and camera.

    Attributes:
        name: of the motion, and of its camera where there are several.
        truth: the recording, or that of the person who drives.
        methods: by label, ours first.
        ours: label of ours; None where it has no video.
        recorded: label of the recording.
    """

    name: str
    truth: Clip
    methods: dict[str, Clip]
    ours: str | None
    recorded: str = TRUTH

    @property
    def clips(self) -> list[Clip]:
        """Truth and methods."""
        return [self.truth, *self.methods.values()]

    @property
    def labels(self) -> list[str]:
        """Of all clips."""
        return [self.recorded, *self.methods]

    def pairs(self, capture: str) -> list[Pair]:
        """Ours with each other method."""
        if self.ours is None:
            return []
        ours = self.methods[self.ours]
        return [
            Pair(capture, self.name, label, self.truth, ours, clip)
            for label, clip in self.methods.items()
            if label != self.ours
        ]


def shown_rows(comparison: Comparison) -> list[Row]:
    """The first seed that is done of each method, ours first."""
    first: dict[str, Row] = {}
    for row in comparison.rows:
        if row.state == "done":
            first.setdefault(row.label, row)
    return sorted(first.values(), key=lambda row: row.method != OURS)


def find_footage(comparison: Comparison, problems: list[str], *, driven: bool = False) -> list[Footage]:
    """Collect the videos of the test motions, one method at least in each.

    Args:
        comparison: whose rows have videos.
        problems: gets what keeps a row's videos out.
        driven: whether it is another person who is seen beside the methods, and drives them.
    """
    prefix, recorded = ("cross_", DRIVER) if driven else ("test_", TRUTH)
    rows = [row for row in shown_rows(comparison) if any(row.evaluation.glob(f"{prefix}*.mp4"))]
    names = dict.fromkeys(path.stem for row in rows for path in sorted(row.evaluation.glob(f"{prefix}*.mp4")))
    aspects: dict[str, float] = {}
    for row in rows:
        try:
            aspects[row.label] = _aspect(row)
        except DynhairError as error:
            problems.append(str(error))
    footage = []
    for name in names:
        paths = {row.label: row.evaluation / f"{name}.mp4" for row in rows if row.label in aspects}
        methods = {label: Clip(path, METHOD_PANEL, aspects[label]) for label, path in paths.items() if path.exists()}
        if methods:
            truth = replace(next(iter(methods.values())), panel=TRUTH_PANEL)
            ours = next((row.label for row in rows if row.method == OURS and row.label in methods), None)
            footage.append(Footage(name.removeprefix(prefix), truth, methods, ours, recorded))
    return footage


def write_sheet(footage: Footage, path: Path) -> None:
    """Write a contact sheet, the truth above the methods."""
    sheet = Image.fromarray(contact_sheet(footage.clips, footage.labels, SHEET_FRAMES))
    with atomic_file(path) as temporary:
        sheet.save(temporary, quality=85, method=4)


def _aspect(row: Row) -> float:
    """Width over height of the images that were evaluated."""
    match row.metrics.get("image_size"):
        case [int(width), int(height)] if min(width, height) > 0:
            return width / height
        case found:
            raise DynhairError(
                f"the videos are not shown, for 'image_size' is {found!r}",
                path=row.evaluation / "metrics.json",
                expected="width and height of the evaluated images",
                mend="evaluate this row again",
            )
