"""The study of users: blind while it runs, and summed up as SciPy's exact test has it."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from made_comparisons import SIZE, write_video
from rich.console import Console
from scipy.stats import binomtest

from dynhair import cli
from dynhair.errors import DynhairError
from dynhair.report import sum_user_study
from dynhair.report.answers import ANSWERS_KIND, KEY_KIND
from dynhair.report.clips import Clip
from dynhair.report.study import QUESTIONS, Pair, write_study

BUDGET = 10_000_000


def pairs(folder: Path) -> list[Pair]:
    clips = {}
    for method in ("ours", "gha", "ga"):
        write_video(folder / f"{method}.mp4", method)
        clips[method] = Clip(folder / f"{method}.mp4", 1, SIZE[0] / SIZE[1])
    truth = Clip(folder / "ours.mp4", 0, SIZE[0] / SIZE[1])
    return [Pair("long", "nod", method.upper(), truth, clips["ours"], clips[method]) for method in ("gha", "ga")]


def content_of(page: Path) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="content">(.*?)</script>', page.read_text(), re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def key_file(folder: Path, **changes: Any) -> Path:
    trials = {
        f"t{method}{i}": {"ours": f"o{i}", "other": f"{method}{i}", "label": method}
        for method in ("GHA", "GA")
        for i in range(20)
    }
    questions = [{"id": "motion", "text": "Which moves better?"}, {"id": "fidelity", "text": "Which is truer?"}]
    value = {"kind": KEY_KIND, "study": "s1", "questions": questions, "trials": trials} | changes
    (folder / "key.json").write_text(json.dumps(value))
    return folder / "key.json"


def answers_file(folder: Path, participant: str, ours: dict[tuple[str, str], int], of: int, **changes: Any) -> Path:
    """A participant who chose ours so often of the first trials, by method and question."""
    answers = [
        {"trial": f"t{method}{i}", "question": question, "chosen": f"o{i}" if i < count else f"{method}{i}"}
        for (method, question), count in ours.items()
        for i in range(of)
    ]
    value = {"kind": ANSWERS_KIND, "study": "s1", "participant": participant, "answers": answers} | changes
    path = folder / f"answers_{participant}.json"
    path.write_text(json.dumps(value))
    return path


def test_the_page_does_not_tell_the_methods(tmp_path: Path) -> None:
    page = write_study(pairs(tmp_path), tmp_path / "out", BUDGET)
    assert page is not None
    text = re.sub(r"base64,[\w+/=]+", "", page.read_text())
    for word in ("ours", "GHA", "GA", "gha", "secret", "other_video"):
        assert not re.search(rf"\b{word}\b", text)
    assert "://" not in text
    content = content_of(page)
    assert [trial["clips"] for trial in content["trials"]] == [sorted(trial["clips"]) for trial in content["trials"]]
    assert [trial["id"] for trial in content["trials"]] == sorted(trial["id"] for trial in content["trials"])


def test_page_and_key_belong_together(tmp_path: Path) -> None:
    page = write_study(pairs(tmp_path), tmp_path / "out", BUDGET)
    assert page is not None
    content, key = content_of(page), json.loads((tmp_path / "out" / "user_study_key.json").read_text())
    assert content["study"] == key["study"]
    assert {trial["id"] for trial in content["trials"]} == set(key["trials"])
    assert {secret["label"] for secret in key["trials"].values()} == {"GHA", "GA"}
    for trial in content["trials"]:
        secret = key["trials"][trial["id"]]
        assert set(trial["clips"]) == {secret["ours"], secret["other"]}
        for clip in (trial["truth"], *trial["clips"]):
            head, data = content["sources"][clip].split(",")
            assert head == "data:video/mp4;base64"
            assert base64.b64decode(data)[4:8] == b"ftyp"


def test_the_same_clips_make_the_same_study(tmp_path: Path) -> None:
    judged = pairs(tmp_path)
    for out in ("a", "b"):
        write_study(judged, tmp_path / out, BUDGET)
    keys = [(tmp_path / out / "user_study_key.json").read_text() for out in ("a", "b")]
    assert keys[0] == keys[1]


def test_large_clips_lie_beside_the_page(tmp_path: Path) -> None:
    page = write_study(pairs(tmp_path), tmp_path / "out", 0)
    assert page is not None
    sources = content_of(page)["sources"]
    assert len(sources) == 4
    for name, source in sources.items():
        assert source == f"user_study/{name}.mp4"
        assert (page.parent / source).stat().st_size > 0


def test_no_pair_makes_no_study(tmp_path: Path) -> None:
    assert write_study([], tmp_path, BUDGET) is None
    assert not list(tmp_path.iterdir())


def test_clips_that_do_not_differ_are_no_pair(tmp_path: Path) -> None:
    pair, _ = pairs(tmp_path)
    same = Pair(pair.capture, pair.clip, "twin", pair.truth_video, pair.our_video, pair.our_video)
    assert write_study([same], tmp_path / "out", BUDGET) is None
    page = write_study([same, pair], tmp_path / "out", BUDGET)
    assert page is not None
    assert len(content_of(page)["trials"]) == 1


def test_methods_with_the_same_clip_are_asked_about_each(tmp_path: Path) -> None:
    pair, _ = pairs(tmp_path)
    twin = Pair(pair.capture, pair.clip, "TWIN", pair.truth_video, pair.our_video, pair.other_video)
    page = write_study([pair, twin], tmp_path / "out", BUDGET)
    assert page is not None
    trials = [trial["id"] for trial in content_of(page)["trials"]]
    key = json.loads((tmp_path / "out" / "user_study_key.json").read_text())["trials"]
    assert sorted(trials) == sorted(key)
    assert sorted(secret["label"] for secret in key.values()) == ["GHA", "TWIN"]


def test_a_clip_counts_once_against_the_budget(tmp_path: Path) -> None:
    pair, _ = pairs(tmp_path)
    copied = Clip(tmp_path / "copy.mp4", pair.our_video.panel, pair.our_video.aspect)
    copied.path.write_bytes(pair.our_video.path.read_bytes())
    write_study([pair], tmp_path / "linked", 0)
    size = sum(file.stat().st_size for file in (tmp_path / "linked" / "user_study").iterdir())
    # of the two clips; written twice, each may take a few bytes more or less
    page = write_study([pair, replace(pair, our_video=copied)], tmp_path / "held", size * 5 // 4)
    assert page is not None
    assert all(source.startswith("data:") for source in content_of(page)["sources"].values())


@pytest.mark.parametrize(("first", "second", "of"), [(7, 9, 10), (0, 0, 4), (20, 20, 20), (1, 0, 1)])
def test_sums_are_those_of_the_exact_test(tmp_path: Path, first: int, second: int, of: int) -> None:
    key = key_file(tmp_path)
    files = [
        answers_file(tmp_path, "a", {("GHA", "motion"): first, ("GA", "fidelity"): 1}, of),
        answers_file(tmp_path, "b", {("GHA", "motion"): second}, of),
    ]
    summary = sum_user_study(files, key)
    assert summary.participants == 2
    assert [(p.question, p.other) for p in summary.preferences] == [("motion", "GHA"), ("fidelity", "GA")]
    motion = summary.preferences[0]
    expected = binomtest(first + second, 2 * of)
    assert (motion.ours, motion.answers) == (first + second, 2 * of)
    assert motion.share == pytest.approx(expected.statistic)
    assert (motion.low, motion.high) == pytest.approx(expected.proportion_ci(0.95, method="exact"))
    assert motion.p_value == pytest.approx(expected.pvalue)


def test_a_console_prints_the_sums(tmp_path: Path) -> None:
    summary = sum_user_study([answers_file(tmp_path, "a", {("GHA", "motion"): 15}, 20)], key_file(tmp_path))
    console = Console(record=True, width=120, quiet=False, file=(tmp_path / "out.txt").open("w"))
    console.print(summary)
    text = console.export_text()
    console.file.close()
    assert re.search(r"motion\s+GHA\s+15 of 20\s+75\.0%\s+50\.9% to 91\.3%\s+0\.041", text)
    assert "Which moves better?" in text


def test_the_command_line_sums_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answers = answers_file(tmp_path, "ada", {("GHA", "motion"): 3}, of=4)
    cli.user_study(key_file(tmp_path), (answers,))
    assert "GHA" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "letter"}, "its kind is 'letter'"),
        ({"study": "s2"}, "of the study 's2'"),
        ({"answers": 3}, "'answers' is not a list"),
        ({"answers": [3]}, "'answers' is not a list"),
        ({"answers": [{"trial": "t9", "question": "motion", "chosen": "o0"}]}, "no trial 't9'"),
        ({"answers": [{"trial": "tGA1", "question": "taste", "chosen": "o1"}]}, "question 'taste'"),
        ({"answers": [{"trial": "tGA1", "question": "motion", "chosen": "o2"}]}, "has no clip 'o2'"),
        ({"answers": [{"trial": "tGA1", "question": "motion", "chosen": "o1"}] * 2}, "answers 'motion' twice"),
        ({"answers": [None]}, "'answers' is not a list"),
    ],
)
def test_answers_that_do_not_fit_are_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(DynhairError, match=message):
        sum_user_study([answers_file(tmp_path, "a", {}, 1, **changes)], key_file(tmp_path))


def test_a_participant_counts_once(tmp_path: Path) -> None:
    first = answers_file(tmp_path, "a", {("GA", "motion"): 1}, 1)
    again = tmp_path / "copy.json"
    again.write_text(first.read_text())
    with pytest.raises(DynhairError, match="participant 'a' has answered in"):
        sum_user_study([first, again], key_file(tmp_path))


def test_a_key_that_is_none_is_refused(tmp_path: Path) -> None:
    answers = answers_file(tmp_path, "a", {}, 1)
    with pytest.raises(DynhairError, match="its kind is"):
        sum_user_study([answers], answers)
    with pytest.raises(DynhairError, match="it has no trials"):
        sum_user_study([answers], key_file(tmp_path, trials=None))
    with pytest.raises(DynhairError, match="the file is missing"):
        sum_user_study([answers], tmp_path / "nothing.json")
    with pytest.raises(DynhairError, match="there are no answers"):
        sum_user_study([], key_file(tmp_path))


def test_truth_stands_beside_fidelity_alone() -> None:
    assert {question.id for question in QUESTIONS if question.beside_truth} == {"fidelity"}
