"""A blind study of users: which of two clips they choose, on a page that does not know the methods."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dynhair.report.answers import ANSWERS_KIND, KEY_KIND
from dynhair.report.clips import Clip, data_url, write_clip
from dynhair.report.templates import render
from dynhair.storage import atomic_file, write_json

STUDY_PAGE = "user_study.html"
STUDY_KEY = "user_study_key.json"


@dataclass(frozen=True)
class Question:
    """What participants are asked of each pair.

    Attributes:
        id: in the answers.
        text: as they read it.
        beside_truth: whether the recording is shown above the two clips.
    """

    id: str
    text: str
    beside_truth: bool


QUESTIONS = (
    Question("motion", "In which clip does the hair move more naturally?", False),
    Question("appearance", "Which clip looks more realistic, the hair above all?", False),
    Question("fidelity", "In which clip does the hair move more like that of the recording above?", True),
)


@dataclass(frozen=True)
class Pair:
    """Ours and another method, of one motion and camera.

    Attributes:
        capture: where the motion is from.
        clip: name of the motion's video.
        other: label of the other method.
        truth_video: the recording.
        our_video: the clip of ours.
        other_video: the clip of the other.
    """

    capture: str
    clip: str
    other: str
    truth_video: Clip
    our_video: Clip
    other_video: Clip


def write_study(pairs: Sequence[Pair], out: Path, budget: int) -> Path | None:
    """Write the page of the study and, beside it, the key that tells which clip is whose.

    Clips are named by what is in them, so that the page gives nothing away and the same clips make the same study.

    Args:
        pairs: to be judged.
        out: folder.
        budget: bytes of clips that the page may hold itself; if they are more, they go to ``user_study/``.

    Returns:
        The page; None where there is no pair.
    """
    with tempfile.TemporaryDirectory() as temporary:
        files = _cut(pairs, Path(temporary))
        trials = sorted(_trials(pairs, files), key=lambda trial: trial.id)
        if not trials:
            return None
        shown = dict.fromkeys(clip for trial in trials for clip in (trial.truth, trial.ours, trial.other))
        sources = _sources(sorted({file for file in files.values() if file.stem in shown}), out, budget)
    study = _digest(*(trial.id for trial in trials))
    questions = [asdict(question) for question in QUESTIONS]
    secrets = {trial.id: trial.secret() for trial in trials}
    write_json(out / STUDY_KEY, {"kind": KEY_KIND, "study": study, "questions": questions, "trials": secrets})
    content = {
        "kind": ANSWERS_KIND,
        "study": study,
        "questions": questions,
        "trials": [trial.shown() for trial in trials],
        "sources": sources,
    }
    page = out / STUDY_PAGE
    with atomic_file(page) as temporary_page:
        temporary_page.write_text(render("user_study.html.jinja", content=_script_json(content)), encoding="utf-8")
    return page


@dataclass(frozen=True)
class _Trial:
    """A pair by the names of its clips."""

    pair: Pair
    truth: str
    ours: str
    other: str

    @property
    def id(self) -> str:
        # several methods may have the same clip, and the order of clips must not show
        return _digest(*sorted((self.ours, self.other)), self.pair.capture, self.pair.clip, self.pair.other)

    def shown(self) -> dict[str, Any]:
        """What participants may know: nothing in the order of the clips tells which is ours."""
        return {"id": self.id, "truth": self.truth, "clips": sorted((self.ours, self.other))}

    def secret(self) -> dict[str, str]:
        pair = self.pair
        return {
            "ours": self.ours,
            "other": self.other,
            "label": pair.other,
            "capture": pair.capture,
            "clip": pair.clip,
        }


def _cut(pairs: Sequence[Pair], folder: Path) -> dict[Clip, Path]:
    """Write each clip once, named by its content."""
    files: dict[Clip, Path] = {}
    for pair in pairs:
        for clip in (pair.truth_video, pair.our_video, pair.other_video):
            if clip not in files:
                unnamed = folder / "clip.mp4"
                name = write_clip(clip, unnamed)
                files[clip] = unnamed.rename(folder / f"{name}.mp4")
    return files


def _trials(pairs: Sequence[Pair], files: Mapping[Clip, Path]) -> Iterator[_Trial]:
    for pair in pairs:
        truth, ours, other = (files[clip].stem for clip in (pair.truth_video, pair.our_video, pair.other_video))
        if ours != other:  # two clips that do not differ are no choice
            yield _Trial(pair, truth, ours, other)


def _sources(files: Sequence[Path], out: Path, budget: int) -> dict[str, str]:
    if sum(file.stat().st_size for file in files) <= budget:
        return {file.stem: data_url(file, "video/mp4") for file in files}
    for file in files:
        with atomic_file(out / "user_study" / file.name) as written:
            written.write_bytes(file.read_bytes())
    return {file.stem: f"user_study/{file.name}" for file in files}


def _digest(*names: str) -> str:
    return hashlib.sha256(" ".join(names).encode()).hexdigest()[:12]


def _script_json(value: Mapping[str, Any]) -> str:
    """JSON that can stand in a script element: nothing in it ends the element."""
    return json.dumps(value, ensure_ascii=True).replace("<", "\\u003c")
