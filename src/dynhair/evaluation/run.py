"""Avatars on disk, evaluated against or driven by captures on disk."""

from __future__ import annotations

from pathlib import Path

import torch
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn, track

from dynhair import __version__
from dynhair.avatar import Avatar
from dynhair.capture import Capture
from dynhair.evaluation.pictures import picture
from dynhair.evaluation.protocol import EvaluatedFrame, Evaluation, evaluate_avatar, evaluated_indices
from dynhair.evaluation.recorder import Recorder
from dynhair.evaluation.report import evaluation_table
from dynhair.evaluation.video import video_writer
from dynhair.storage import write_json
from dynhair.threads import large_pieces

METRICS = "metrics.json"


def run_evaluation(
    avatar_path: Path | str,
    capture_path: Path | str,
    out: Path | str,
    *,
    device: torch.device | str = "cpu",
    console: Console | None = None,
) -> Evaluation:
    """Evaluate an avatar against a capture; print a table, and write figures and pictures.

    Args:
        avatar_path: the avatar's folder.
        capture_path: the capture's folder.
        out: folder for ``metrics.json``, ``test_<segment>.mp4`` and ``contact_sheet.png``.
        device: where the avatar is posed and rendered.
        console: where progress and table go; standard output when left out.

    Raises:
        DynhairError: the avatar or the capture cannot be read.
    """
    out, console = Path(out), console or Console()
    avatar, capture = Avatar.load(avatar_path, device), Capture.open(capture_path, cache_bytes=0)  # read once
    total = sum(len(evaluated_indices(segment)) for segment in capture.segments)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    bars = Progress(*columns, console=console, transient=True)
    with large_pieces(), bars as progress, Recorder(capture, out) as recorder:
        task = progress.add_task("evaluating", total=total)

        def observe(frame: EvaluatedFrame) -> None:
            recorder(frame)
            progress.update(task, advance=1, description=f"evaluating {frame.segment.name}")

        evaluation = evaluate_avatar(avatar, capture, observe=observe)
    names = {"dynhair": __version__, "avatar": Path(avatar_path).resolve().name}
    write_json(out / METRICS, {**names, **evaluation.to_json()})
    console.print(evaluation_table(evaluation))
    for path in (out / METRICS, *recorder.written):
        console.print(f"wrote {path}", highlight=False, soft_wrap=True)
    return evaluation


@torch.no_grad()
def render_motion(
    avatar_path: Path | str,
    capture_path: Path | str,
    out: Path | str,
    *,
    motion: str,
    camera: str,
    rigid_hair: bool = False,
    device: torch.device | str = "cpu",
    console: Console | None = None,
) -> None:
    """Drive an avatar by a segment of a capture and film it with one of the capture's cameras.

    Args:
        avatar_path: the avatar's folder.
        capture_path: the folder of the capture whose head motion and cameras are used.
        out: the ``.mp4`` to write.
        motion: name of the segment.
        camera: name of the camera.
        rigid_hair: hold the hair in its canonical shape.
        device: where the avatar is posed and rendered.
        console: where progress goes; standard output when left out.

    Raises:
        DynhairError: the avatar or the capture cannot be read, or has no such segment or camera.
    """
    console = console or Console()
    avatar, capture = Avatar.load(avatar_path, device), Capture.open(capture_path)
    segment = capture.segment(motion)
    head = capture.track(segment)
    cameras = [capture.camera(frame, camera).to(device) for frame in segment.frames]
    with video_writer(out, capture.fps) as append:
        frames = enumerate(cameras)
        for index, view in track(frames, f"rendering {motion}", total=len(cameras), console=console, transient=True):
            images = avatar.render(avatar.pose(head, index, rigid_hair=rigid_hair), [view])
            append(picture(images.rgb[0]))
    console.print(f"wrote {out}", highlight=False, soft_wrap=True)
