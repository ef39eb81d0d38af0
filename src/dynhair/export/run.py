"""Avatars in motion, written for other programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import torch
from rich.console import Console
from rich.text import Text

from dynhair.animation import driving_track, write_motion
from dynhair.animation.capture_names import own_capture
from dynhair.animation.sources import names_segment
from dynhair.avatar import Avatar, HeadMesh, PosedAvatar, Recording
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.export.compressed import write_compressed_splats
from dynhair.export.mesh_sequences import write_mesh_sequence
from dynhair.export.splats import Splats, write_splats
from dynhair.export.strand_motion import MotionFrame, StrandMotion, strand_motion
from dynhair.export.strand_sequences import StrandEnding, numbered, write_strand_sequence
from dynhair.progress import Stage, StageProgress
from dynhair.storage import atomic_folder
from dynhair.training.head_mesh import head_mesh_of
from dynhair.training.recording import recording_of
from dynhair.training.run import avatar_folder

Format = Literal["ply", "compressed", "usd", "abc", "blend", "hair", "data", "npz", "polylines", "head", "motion"]

SPLATS = {"ply", "compressed"}
WITH_HEAD_MESH = {"usd", "abc", "blend", "head"}


@dataclass(frozen=True)
class Driven:
    """An avatar that follows some frames of a track.

    Attributes:
        avatar: with its edits.
        recording: how its person was recorded.
        track: what drives it.
        frames: of the track.
        motion: the strands and the head mesh in these frames.
        rigid_hair: the hair keeps its canonical shape.
    """

    avatar: Avatar
    recording: Recording
    track: HeadTrack
    frames: range
    motion: StrandMotion
    rigid_hair: bool

    def posed(self, index: int) -> PosedAvatar:
        """The avatar in one of the frames."""
        with torch.no_grad():
            return self.avatar.pose(self.track, self.frames[index], rigid_hair=self.rigid_hair)


def run_export(
    path: Path | str,
    out: Path | str,
    formats: Sequence[str] = ("ply",),
    *,
    motion: str | None = None,
    frames: str | None = None,
    rigid_hair: bool = False,
    device: torch.device | str = "cpu",
    console: Console | None = None,
) -> list[Path]:
    """Drive an avatar and write what it does in each of some formats.

    =========================  =====================================================================================
    ``ply``                    splats, ``OUT/ply/0000.ply`` and so on, see :mod:`dynhair.export.splats`
    ``compressed``             splats of a quarter of the size, ``OUT/compressed/0000.compressed.ply`` and so on
    ``usd``, ``abc``           strands, head mesh and head pose over time, ``OUT/avatar.usdc`` and ``OUT/avatar.abc``
    ``blend``                  the same as a Blender scene, ``OUT/avatar.blend``; needs Blender
    ``hair``, ``data``,        strands, ``OUT/hair/0000.hair`` and so on
    ``npz``
    ``polylines``              strands, ``OUT/polylines/0000.ply`` and so on
    ``head``                   the head mesh, ``OUT/head/0000.obj`` and so on
    ``motion``                 head poses and expressions, ``OUT/motion.npz``
    =========================  =====================================================================================

    Args:
        path: the avatar's folder, or the run's.
        out: folder for the files. Files of another export there are replaced, folders of sequences as a whole.
        formats: what to write, see :data:`Format`.
        motion: what drives the avatar, see :func:`dynhair.animation.driving_track`, or the name of a segment of the
            capture that it was trained on; without it, the avatar is at rest.
        frames: which frames of the motion, as ``START:STOP``, of which either may be left out; all by default. Numbered
            files have the numbers of the motion's frames.
        rigid_hair: keep the hair in its canonical shape.
        device: where the avatar is posed.
        console: where progress goes; standard output when left out.

    Returns:
        The files, and of sequences the folders.

    Raises:
        DynhairError: the avatar, the motion or the frames cannot be had; a program or library that a format needs is
            not installed; or the format ``head`` is asked for, and neither the avatar has the mesh nor the capture that
            it was trained on, or that is not there.
    """
    path, out, console = Path(path), Path(out), console or Console()
    _require_formats(formats)
    avatar, recording = Avatar.load(avatar_folder(path), device), recording_of(path)
    track = rest_track(recording, avatar) if motion is None else _track(motion, path, recording, avatar, console)
    chosen = chosen_frames(frames, len(track.rotations))
    mesh = _head_mesh(avatar, path, "head" in formats, console) if WITH_HEAD_MESH & set(formats) else None
    strands = strand_motion(avatar, track, chosen, mesh=mesh, rigid_hair=rigid_hair)
    driven = Driven(avatar, recording, track, chosen, strands, rigid_hair)
    if avatar.super_resolution is not None and SPLATS & set(formats):
        lost = "splats have the colours before super-resolution, for viewers have no network to make the others"
        console.print(Text(lost, style="dim"))
    written = []
    with StageProgress(console, lines=2).shown() as progress:
        for name in dict.fromkeys(formats):
            written.append(_WRITERS[name](out, driven, progress.stage(name, len(chosen))))
    for file in written:
        console.print(f"wrote {file}", highlight=False, soft_wrap=True)
    return written


def rest_track(recording: Recording, avatar: Avatar) -> HeadTrack:
    """One frame, in which the avatar rests as its person did."""
    rest = recording.rest
    return HeadTrack(
        rotations=rest.rotation.double().numpy()[None],
        translations=rest.translation.double().numpy()[None],
        expressions=rest.expression.float().numpy()[None],
        fps=recording.fps,
        gravity=recording.gravity,
        expression_basis=avatar.expression_basis,
    )


def _track(motion: str, path: Path, recording: Recording, avatar: Avatar, console: Console) -> HeadTrack:
    def note(text: str) -> None:
        console.print(Text(text, style="dim"), soft_wrap=True)

    capture = own_capture(path) if names_segment(motion) else None
    with StageProgress(console, lines=2).shown() as progress:
        return driving_track(motion, recording, avatar, capture=capture, progress=progress, note=note)


def chosen_frames(text: str | None, count: int) -> range:
    """Frames by ``START:STOP``.

    Args:
        text: either number may be left out; None for all frames.
        count: how many there are.

    Raises:
        DynhairError: it is written otherwise, or there are no such frames.
    """
    start, colon, stop = (text or ":").partition(":")
    if not colon or not all(part.isdecimal() for part in (start, stop) if part):
        raise DynhairError(f"the frames {text!r}", expected="START:STOP, such as 0:60, or 30: for all from the 30th on")
    chosen = range(int(start or 0), int(stop or count))
    if not chosen or chosen[-1] >= count:
        raise DynhairError(f"the frames {text!r} of a motion of {count}", expected=f"frames within 0:{count}")
    return chosen


def _require_formats(formats: Sequence[str]) -> None:
    unknown = [name for name in formats if name not in get_args(Format)]
    if unknown or not formats:
        raise DynhairError(
            f"there is no format {unknown[0]!r}" if unknown else "no format is named",
            expected=" or ".join(get_args(Format)),
        )
    if "blend" in formats:  # before anything is written that takes long
        from dynhair.export.blender import blender_program

        blender_program()


def _head_mesh(avatar: Avatar, path: Path, needed: bool, console: Console) -> HeadMesh | None:
    try:
        return head_mesh_of(avatar, path)
    except DynhairError as error:
        if needed:
            raise
        console.print(Text(f"without a head mesh: {error.message}", style="dim"))
        return None


def _watched(motion: StrandMotion, stage: Stage) -> StrandMotion:
    """The same motion, whose stage goes on with each frame that is asked for."""

    def at(index: int) -> MotionFrame:
        frame = motion.at(index)
        stage.update(index + 1)
        return frame

    return replace(motion, at=at)


def _splat_writer(
    name: str, write: Callable[[Path, Splats], None], ending: str
) -> Callable[[Path, Driven, Stage], Path]:
    def write_sequence(out: Path, driven: Driven, stage: Stage) -> Path:
        with atomic_folder(out / name) as folder:
            for index, frame in enumerate(driven.frames):
                write(numbered(folder, frame, ending), Splats.of(driven.avatar, driven.posed(index)))
                stage.update(index + 1)
        return out / name

    return write_sequence


def _strand_writer(name: str, ending: StrandEnding) -> Callable[[Path, Driven, Stage], Path]:
    def write_sequence(out: Path, driven: Driven, stage: Stage) -> Path:
        with atomic_folder(out / name) as folder:
            write_strand_sequence(folder, _watched(driven.motion, stage), ending, first=driven.frames[0])
        return out / name

    return write_sequence


def _write_head(out: Path, driven: Driven, stage: Stage) -> Path:
    with atomic_folder(out / "head") as folder:
        write_mesh_sequence(folder, _watched(driven.motion, stage), first=driven.frames[0])
    return out / "head"


def _write_usd(out: Path, driven: Driven, stage: Stage) -> Path:
    from dynhair.export.usd import write_usd

    write_usd(out / "avatar.usdc", _watched(driven.motion, stage), camera=driven.recording.camera)
    return out / "avatar.usdc"


def _write_abc(out: Path, driven: Driven, stage: Stage) -> Path:
    from dynhair.export.alembic import write_alembic

    write_alembic(out / "avatar.abc", _watched(driven.motion, stage))
    return out / "avatar.abc"


def _write_blend(out: Path, driven: Driven, stage: Stage) -> Path:
    from dynhair.export.blender import write_blend

    write_blend(out / "avatar.blend", _watched(driven.motion, stage), driven.recording.camera)
    return out / "avatar.blend"


def _write_motion(out: Path, driven: Driven, stage: Stage) -> Path:
    track, frames = driven.track, np.array(driven.frames)
    part = replace(
        track,
        rotations=track.rotations[frames],
        translations=track.translations[frames],
        expressions=track.expressions[frames],
    )
    write_motion(out / "motion.npz", part)
    stage.update(len(frames))
    return out / "motion.npz"


_WRITERS: Mapping[str, Callable[[Path, Driven, Stage], Path]] = {
    "ply": _splat_writer("ply", write_splats, "ply"),
    "compressed": _splat_writer("compressed", write_compressed_splats, "compressed.ply"),
    "usd": _write_usd,
    "abc": _write_abc,
    "blend": _write_blend,
    "hair": _strand_writer("hair", "hair"),
    "data": _strand_writer("data", "data"),
    "npz": _strand_writer("npz", "npz"),
    "polylines": _strand_writer("polylines", "ply"),
    "head": _write_head,
    "motion": _write_motion,
}
