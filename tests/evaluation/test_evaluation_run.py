"""The whole evaluation as the command runs it: table, figures, pictures."""

from __future__ import annotations

import io
from pathlib import Path

import av
import pytest
from PIL import Image
from rich.console import Console
from stand_ins import SEGMENTS, StandInAvatar, StandInCapture, rigid_twin

from dynhair.errors import DynhairError
from dynhair.evaluation import run
from dynhair.evaluation.protocol import evaluate_avatar
from dynhair.evaluation.recorder import Recorder, most_frontal_view
from dynhair.evaluation.records import EvaluatedFrame
from dynhair.evaluation.report import evaluation_table, format_figure
from dynhair.storage import read_json


@pytest.fixture
def on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Opens the stand-ins in the place of folders."""
    monkeypatch.setattr(run, "open_driven_head", lambda path, device: StandInAvatar())
    monkeypatch.setattr(run.Capture, "open", lambda path, **_: StandInCapture())


def count_frames(path: Path) -> int:
    with av.open(str(path)) as container:
        return sum(1 for _ in container.decode(video=0))


@pytest.mark.usefixtures("on_disk")
def test_an_evaluation_writes_figures_videos_and_a_sheet(tmp_path: Path) -> None:
    output = io.StringIO()
    evaluation = run.run_evaluation("head.avatar", "capture", tmp_path / "out", console=Console(file=output, width=100))
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "contact_sheet.png",
        "metrics.json",
        "series.npz",
        "test_nod.mp4",
        "test_stop.mp4",
    ]
    written = read_json(tmp_path / "out" / "metrics.json")
    assert evaluation.motion is not None
    assert written["avatar"] == "head.avatar"
    assert written["psnr"] == evaluation.motion.avatar.values["psnr"]
    assert count_frames(tmp_path / "out" / "test_stop.mp4") == 4
    assert count_frames(tmp_path / "out" / "test_nod.mp4") == 3
    with Image.open(tmp_path / "out" / "contact_sheet.png") as sheet:
        assert sheet.width > 6 * 72
    printed = output.getvalue()
    assert "stop (test)" in printed
    assert format_figure(evaluation.motion.avatar.values["psnr"], 2) in printed
    assert format_figure(rigid_twin(evaluation.motion).values["psnr"], 2) in printed
    assert all(f"wrote {tmp_path / 'out' / name}" in printed for name in ("metrics.json", "test_nod.mp4"))


def test_the_frontal_camera_is_found_in_the_head_frame() -> None:
    assert most_frontal_view(StandInCapture(), SEGMENTS[0], 0) == 1


def test_an_error_leaves_neither_half_a_video_nor_a_sheet(tmp_path: Path) -> None:
    def fail(frame: EvaluatedFrame) -> None:
        recorder(frame)
        if (frame.segment.name, frame.index) == ("nod", 1):
            raise DynhairError("enough")

    with pytest.raises(DynhairError), Recorder(StandInCapture(), tmp_path) as recorder:
        evaluate_avatar(StandInAvatar(), StandInCapture(), observe=fail)
    assert [path.name for path in tmp_path.iterdir()] == ["test_stop.mp4"]


def test_a_capture_without_test_segments_yields_no_pictures(tmp_path: Path) -> None:
    capture = StandInCapture(segments=SEGMENTS[:1])
    with Recorder(capture, tmp_path) as recorder:
        evaluate_avatar(StandInAvatar(), capture, observe=recorder)
    assert recorder.written == list(tmp_path.iterdir()) == []


def test_the_tables_fit_80_columns_and_say_what_is_missing() -> None:
    evaluation = evaluate_avatar(StandInAvatar(), StandInCapture(strands=False))
    output = io.StringIO()
    Console(file=output, width=80).print(evaluation_table(evaluation))
    lines = output.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    assert "…" not in output.getvalue()
    assert sum("rigid" in line for line in lines) == len(SEGMENTS) + 1 + 3 * 3  # tests alone in all but the first table
    titles = ("segment ", "head ", "hair, networks ", "motion ")
    assert all(any(line.startswith(title) for line in lines) for title in titles)
    assert sum(line.startswith("turn") for line in lines) == 1
    assert "n/a" in next(line for line in lines if line.startswith("turn (train)"))
    assert "the capture holds no true strands" in " ".join(output.getvalue().split())


@pytest.mark.parametrize(
    ("value", "text"), [(None, "n/a"), (-1e-9, "0.000"), (0.12345, "0.123"), (-0.25, "-0.250"), (1.0, "1.000")]
)
def test_figures_are_never_a_negative_zero(value: float | None, text: str) -> None:
    assert format_figure(value, 3) == text
