"""``capture.json``: what a capture says of itself, parsed and validated in one place."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from dynhair.capture.expression_basis import ExpressionBasis
from dynhair.capture.records import Segment
from dynhair.errors import DynhairError

VERSION = 1
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


@dataclass(frozen=True)
class Manifest:
    """The contents of ``capture.json``.

    Attributes:
        fps: frames per second.
        image_size: width and height in pixels.
        camera_names: as in the files' names, in the order of the file.
        segments: sorted by their first frame, without overlaps.
        gravity: m/s^2 in the world.
        background: sRGB in [0, 1] that the images stand on; None when they show their own background.
        static_frame: the frame whose head pose the static views show; None for the first frame of the capture.
        expression_basis: whose expression coefficients the frames hold; None if that is not known.
        notes: everything else in the file, kept as it is.
    """

    fps: float
    image_size: tuple[int, int]
    camera_names: tuple[str, ...]
    segments: tuple[Segment, ...]
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    background: tuple[float, float, float] | None = (0.0, 0.0, 0.0)
    static_frame: int | None = None
    expression_basis: ExpressionBasis | None = None
    notes: Mapping[str, Any] | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object that `parse_manifest` reads back."""
        notes = dict(self.notes or {})
        cameras = notes.pop("cameras", {})
        static = dict(notes.pop("static360", {}))
        if self.static_frame is not None:
            static["frame"] = self.static_frame
        return {
            "version": VERSION,
            "fps": self.fps,
            "image_size": list(self.image_size),
            "gravity": list(self.gravity),
            "background": None if self.background is None else list(self.background),
            "cameras": {name: cameras.get(name, {}) for name in self.camera_names},
            "segments": [
                {"motion": s.name, "start": s.start, "count": s.count, "split": s.split} for s in self.segments
            ],
            **({"static360": static} if static else {}),
            **({"expression_basis": self.expression_basis.to_json()} if self.expression_basis else {}),
            **notes,
        }


def parse_manifest(raw: Mapping[str, Any], path: Path) -> Manifest:
    """Read a manifest from the JSON object in ``path``.

    Raises:
        DynhairError: the first of the problems that `manifest_problems` lists.
    """
    parser = _Parser(path)
    manifest = parser.parse(raw)
    if parser.problems:
        raise parser.problems[0]
    return manifest


def manifest_problems(raw: Mapping[str, Any], path: Path) -> list[DynhairError]:
    """List everything that is wrong with a manifest; empty for a sound one."""
    parser = _Parser(path)
    parser.parse(raw)
    return parser.problems


class _Parser:
    """Reads field by field, noting each problem and going on with a stand-in, so that all are found at once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.problems: list[DynhairError] = []

    def parse(self, raw: Mapping[str, Any]) -> Manifest:
        version = raw.get("version", VERSION)  # the first captures were written without it
        if version != VERSION:
            self._problem(
                f"`version` is {version!r}", f"{VERSION}", "open it with the release of dynhair that wrote it, or newer"
            )
        known = {"version", "fps", "image_size", "gravity", "background", "segments", "expression_basis"}
        static = raw.get("static360", {})
        frame = static.get("frame") if isinstance(static, Mapping) else None
        return Manifest(
            fps=self._fps(raw.get("fps")),
            image_size=self._image_size(raw.get("image_size")),
            camera_names=self._cameras(raw.get("cameras")),
            segments=self._segments(raw.get("segments")),
            gravity=self._triple("gravity", raw.get("gravity", [0.0, -9.81, 0.0]), -math.inf, math.inf),
            background=None
            if raw.get("background") is None
            else self._triple("background", raw["background"], 0.0, 1.0),
            static_frame=frame if _is_count(frame) else None,
            expression_basis=self._expression_basis(raw.get("expression_basis")),
            notes={key: value for key, value in raw.items() if key not in known},
        )

    def _problem(self, found: str, expected: str, mend: str | None = None) -> None:
        self.problems.append(DynhairError(found, path=self.path, expected=expected, mend=mend))

    def _fps(self, value: Any) -> float:
        if _is_number(value) and 0 < value <= 1000:
            return float(value)
        self._problem(f"`fps` is {value!r}", "frames per second, a number above 0")
        return 25.0

    def _triple(self, key: str, value: Any, low: float, high: float) -> tuple[float, float, float]:
        if isinstance(value, list) and len(value) == 3 and all(_is_number(v) and low <= v <= high for v in value):
            return (float(value[0]), float(value[1]), float(value[2]))
        within = f" in [{low:g}, {high:g}]" if math.isfinite(high) else ""
        self._problem(f"`{key}` is {value!r}", f"a list of three numbers{within}")
        return (0.0, 0.0, 0.0)

    def _image_size(self, value: Any) -> tuple[int, int]:
        if isinstance(value, list) and len(value) == 2 and all(_is_count(v) and v > 0 for v in value):
            return (value[0], value[1])
        self._problem(f"`image_size` is {value!r}", "[width, height] in pixels")
        return (1, 1)

    def _cameras(self, value: Any) -> tuple[str, ...]:
        names = list(value) if isinstance(value, (Mapping, list)) else []
        if not names or len(set(map(str, names))) < len(names) or not all(_is_name(name) for name in names):
            self._problem(
                f"`cameras` is {_short(value)}",
                'an object or a list with a distinct name for each camera, such as {"00": {}, "01": {}}',
            )
            return ()
        return tuple(names)

    def _expression_basis(self, value: Any) -> ExpressionBasis | None:
        if value is None:
            return None
        if not isinstance(value, Mapping):
            self._problem(f"`expression_basis` is {_short(value)}", 'an object such as {"name": "BFM 2009"}')
            return None
        name: Any = value.get("name")
        names: Any = value.get("names", [])
        before = len(self.problems)
        if not _is_text(name):
            self._problem(f"`expression_basis`: `name` is {_short(name)}", "the name of a face model")
        if not isinstance(names, list) or not _are_names(names):
            self._problem(
                f"`expression_basis`: `names` is {_short(names)}",
                "a list of distinct names, empty for coefficients that have none, or no `names`",
            )
        return ExpressionBasis(name, tuple(names)) if len(self.problems) == before else None

    def _segments(self, value: Any) -> tuple[Segment, ...]:
        if not isinstance(value, list) or not value:
            self._problem(f"`segments` is {_short(value)}", "a list with at least one segment")
            return ()
        segments = [s for s in (self._segment(i, item) for i, item in enumerate(value)) if s is not None]
        self._check_order(segments)
        return tuple(segments)

    def _segment(self, index: int, item: Any) -> Segment | None:
        where = f"`segments[{index}]`"
        if not isinstance(item, Mapping):
            self._problem(f"{where} is {_short(item)}", 'an object with "motion", "start", "count" and "split"')
            return None
        name: Any = item.get("motion")
        start: Any = item.get("start")
        count: Any = item.get("count")
        split: Any = item.get("split")
        before = len(self.problems)
        if not _is_name(name):
            self._problem(f"{where}: `motion` is {name!r}", "a name of letters, digits, `_`, `-` and `.`")
        if not _is_count(start):
            self._problem(f"{where}: `start` is {start!r}", "a frame id, an integer from 0")
        if not (_is_count(count) and count > 0):
            self._problem(f"{where}: `count` is {count!r}", "a number of frames, an integer from 1")
        if split not in ("train", "test"):
            self._problem(f"{where}: `split` is {split!r}", "train or test")
        return Segment(name, start, count, split) if len(self.problems) == before else None

    def _check_order(self, segments: Sequence[Segment]) -> None:
        names = [s.name for s in segments]
        for name in sorted({n for n in names if names.count(n) > 1}):
            self._problem(f"two segments are called `{name}`", "a name for each segment of its own")
        for first, second in pairwise(segments):
            if second.start < first.start:
                self._problem(
                    f"segment `{second.name}` (from frame {second.start}) comes after `{first.name}` "
                    f"(from frame {first.start})",
                    "segments sorted by `start`",
                    "sort the list",
                )
        in_order = sorted(segments, key=lambda s: s.start)
        for first, second in pairwise(in_order):
            if first.start + first.count > second.start:
                self._problem(
                    f"segments `{first.name}` (frames {_span(first)}) and `{second.name}` (frames {_span(second)}) "
                    "overlap",
                    "each frame in one segment at most, or test frames leak into training",
                    "mend `start` and `count`",
                )


def _span(segment: Segment) -> str:
    return f"{segment.start}-{segment.start + segment.count - 1}"


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _is_name(value: Any) -> bool:
    # names become parts of file names
    return isinstance(value, str) and _NAME.fullmatch(value) is not None


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and bool(value.strip())


def _are_names(values: Sequence[Any]) -> bool:
    """Whether these are distinct texts, or empty ones."""
    told = [value for value in values if value != ""]
    return all(map(_is_text, told)) and len(set(told)) == len(told)


def _short(value: Any) -> str:
    if value is None:
        return "missing"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
