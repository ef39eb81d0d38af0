"""``dynhair animate``: an avatar, driven by anything, filmed from anywhere."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import torch
from jaxtyping import Float
from rich.console import Console
from torch import Tensor

from dynhair.animation.cameras import camera_path, names_camera
from dynhair.animation.capture_names import own_capture
from dynhair.animation.outputs import Beside, Film, FrameOutput, PictureFolder, Preview
from dynhair.animation.sources import driving_track, names_segment
from dynhair.avatar import Avatar
from dynhair.baselines.loading import open_driven_head
from dynhair.camera import Camera
from dynhair.capture import HeadTrack
from dynhair.device import best_device
from dynhair.errors import DynhairError
from dynhair.evaluation.protocol import DrivenHead
from dynhair.progress import StageProgress
from dynhair.threads import large_pieces
from dynhair.training import avatar_folder, recording_of


@torch.no_grad()
def run_animation(
    avatar: Path | str,
    motion: str,
    *,
    camera: str = "front",
    capture: Path | str | None = None,
    size: int | None = None,
    out: Path | str = "animation.mp4",
    png: bool = False,
    seconds: float | None = None,
    amplitude: float | None = None,
    speed: float = 1.0,
    smoothing: float = 0.0,
    rigid_hair: bool = False,
    device: torch.device | str | None = None,
    console: Console | None = None,
) -> list[Path]:
    """Drive an avatar by a motion, film it, and write the frames as they come, in constant memory.

    While it runs, a picture beside the video, or in the folder, shows the newest frame. A folder of pictures that was
    interrupted goes on where it was; a video appears when it is whole.

    Args:
        avatar: the avatar's folder, or its run's; a baseline's will do as well.
        motion: what drives it: see `driving_track`.
        camera: what films it: see `camera_path`.
        capture: whose segments and cameras may be named; a run's own where it is not told and still there.
        size: pixels of the longer side; those of the camera itself by default.
        out: a video, ``.mp4``; or a folder for pictures with straight alpha.
        png: write the pictures beside a video, in a folder of its name.
        seconds: length of a motion by name; of another, where it is cut off.
        amplitude: of a motion by name, degrees.
        speed: factor of the natural pace of a motion by name.
        smoothing: Hz above which motion counts as jitter; 0 for none.
        rigid_hair: keep the hair in its canonical shape.
        device: where the avatar is posed and drawn; a GPU where there is one, when left out.
        console: where progress goes; standard output when left out.

    Returns:
        The video and the folder, of those that were written.

    Raises:
        DynhairError: the avatar, the motion or the camera cannot be read; or ``out`` is neither, or holds other things.
    """
    console, avatar, out = console or Console(), Path(avatar), Path(out)
    video = out if out.suffix.lower() == ".mp4" else None
    if video is None and out.suffix:
        raise DynhairError(f"`{out.suffix}` is no ending of a video", path=out, expected="FILE.mp4 or a folder")
    recording, head = recording_of(avatar), open_driven_head(avatar, device or best_device())
    if isinstance(head, Avatar):
        head = head.frozen()
    if capture is None and (names_segment(motion) or names_camera(camera)):
        capture = own_capture(avatar)
    bars = StageProgress(console)
    with bars.shown():
        track = driving_track(
            motion,
            recording,
            head,
            capture=capture,
            seconds=seconds,
            amplitude=amplitude,
            speed=speed,
            smoothing=smoothing,
            progress=bars,
            note=lambda text: console.print(text, style="dim", highlight=False, soft_wrap=True),
        )
        cameras = camera_path(camera, recording, len(track.rotations), size, capture=capture)
        folder = None if video is not None and not png else out.with_suffix("")
        with large_pieces(), ExitStack() as open_outputs:
            outputs: list[FrameOutput] = []
            if folder is not None:
                fingerprint = _fingerprint(avatar_folder(avatar), track, cameras, rigid_hair)
                outputs.append(PictureFolder(folder, _background(head), fingerprint))
            if video is not None:
                outputs.append(open_outputs.enter_context(Film.opened(video, track.fps)))
            beside = [open_outputs.enter_context(Beside.drawing(output)) for output in outputs]
            shown = out.with_suffix(".preview.png") if video is not None else out / "preview.png"
            preview = open_outputs.enter_context(Preview.shown(shown))
            wanted = [index for index in range(len(cameras)) if any(output.needs(index) for output in beside)]
            stage = bars.stage("animating", len(cameras), len(cameras) - len(wanted))
            for count, (index, rgb, alpha) in enumerate(_drawn(head, track, cameras, wanted, rigid_hair), 1):
                for output in (*beside, preview):
                    output.take(index, rgb, alpha)
                stage.update(len(cameras) - len(wanted) + count, str(shown))
    written = [path for path in (video, folder) if path is not None]
    for path in written:
        console.print(f"wrote {path}", highlight=False, soft_wrap=True)
    return written


def _drawn(
    head: DrivenHead, track: HeadTrack, cameras: Sequence[Camera], wanted: Sequence[int], rigid_hair: bool
) -> Iterator[tuple[int, Float[Tensor, "h w 3"], Float[Tensor, "h w"]]]:
    """Index, colours and coverage of the wanted frames, on the CPU."""
    for index in wanted:
        posed = head.pose(track, index, rigid_hair=rigid_hair)
        points = posed.means if posed.strands is None else posed.strands
        images = head.draw(posed, [cameras[index].to(points.device)])
        if not images.rgb.isfinite().all():
            raise DynhairError(
                f"frame {index} is not finite", mend="take an earlier checkpoint of the avatar's training"
            )
        yield index, images.rgb[0].cpu(), images.alpha[0].cpu()


def _background(head: DrivenHead) -> Float[Tensor, "3"]:
    background = getattr(head, "background", None)
    if background is None:
        raise DynhairError("this method does not tell its background", mend="write a video: --out NAME.mp4")
    return background


def _fingerprint(avatar: Path, track: HeadTrack, cameras: Sequence[Camera], rigid_hair: bool) -> str:
    """What tells one animation from another."""
    digest = hashlib.sha256(bytes([rigid_hair]))
    for path in sorted(path for path in avatar.iterdir() if path.is_file()):
        digest.update(path.read_bytes())
    for values in (track.rotations, track.translations, track.expressions, track.gravity):
        digest.update(values.tobytes())
    for camera in cameras:
        digest.update(camera.w2c.numpy().tobytes() + camera.K.numpy().tobytes())
        digest.update(f"{camera.width} {camera.height} {track.fps}".encode())
    return digest.hexdigest()
