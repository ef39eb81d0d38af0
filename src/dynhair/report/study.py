"""A blind study of users: which of two clips they choose, on a page that does not know the methods."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dynhair.report.clips import Clip, data_url, write_clip
from dynhair.report.templates import render
from dynhair.storage import atomic_file, write_json

STUDY_PAGE = "user_study.html"
STUDY_KEY = "user_study_key.json"
KEY_KIND = "dynhair user study key"
ANSWERS_KIND = "dynhair user study answers"


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
    if not pairs:
        return None
    with tempfile.TemporaryDirectory() as temporary:
        files: dict[Clip, Path] = {}
        for pair in pairs:
            for clip in (pair.truth_video, pair.our_video, pair.other_video):
                if clip not in files:
                    written = Path(temporary) / f"{len(files)}.mp4"
                    write_clip(clip, written)
                    files[clip] = written.rename(written.with_name(_name_of(written) + ".mp4"))
        sources = _sources(list(files.values()), out, budget)
    trials = {}
    for pair in pairs:
        ours, other = files[pair.our_video].stem, files[pair.other_video].stem
        if ours == other:
            continue  # two clips that do not differ are no choice
        trials[_digest(f"{ours} {other}")] = {
            "truth": files[pair.truth_video].stem,
            "clips": sorted((ours, other)),
            "key": {"ours": ours, "other": other, "label": pair.other, "capture": pair.capture, "clip": pair.clip},
        }
    study = _digest(" ".join(sorted(trials)))
    questions = [asdict(question) for question in QUESTIONS]
    write_json(
        out / STUDY_KEY,
        {
            "kind": KEY_KIND,
            "study": study,
            "questions": questions,
            "trials": {name: trial["key"] for name, trial in trials.items()},
        },
    )
    shown = [{"id": name, "truth": trials[name]["truth"], "clips": trials[name]["clips"]} for name in sorted(trials)]
    content = {"kind": ANSWERS_KIND, "study": study, "questions": questions, "trials": shown, "sources": sources}
    page = out / STUDY_PAGE
    with atomic_file(page) as written:
        written.write_text(render("user_study.html.jinja", content=_script_json(content)), encoding="utf-8")
    return page


def _sources(files: Sequence[Path], out: Path, budget: int) -> dict[str, str]:
    if sum(file.stat().st_size for file in files) <= budget:
        return {file.stem: data_url(file, "video/mp4") for file in sorted(files)}
    for file in files:
        with atomic_file(out / "user_study" / file.name) as written:
            written.write_bytes(file.read_bytes())
    return {file.stem: f"user_study/{file.name}" for file in sorted(files)}


def _name_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:12]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _script_json(value: Mapping[str, Any]) -> str:
    """JSON that can stand in a script element: nothing in it ends the element."""
    return json.dumps(value, ensure_ascii=True).replace("<", "\\u003c")
