"""The verbs that use an avatar: animate, edit, export, view. Heavy imports wait until a verb runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from dynhair.edit_options import EditOptions

FormatName = Literal["ply", "compressed", "usd", "abc", "blend", "hair", "data", "npz", "polylines", "head", "motion"]


def animate(
    avatar: Positional[Path],
    motion: str,
    camera: str = "front",
    capture: Path | None = None,
    out: Path = Path("animation.mp4"),
    png: bool = False,
    size: int | None = None,
    seconds: float | None = None,
    amplitude: float | None = None,
    speed: float = 1.0,
    smoothing: float = 0.0,
    rigid_hair: bool = False,
) -> None:
    """Animate an avatar by a motion of any kind, filmed from anywhere, as a video or as pictures with transparency.

    A picture beside the result shows the newest frame meanwhile. An interrupted folder of pictures goes on where it
    was.

    Args:
        avatar: The avatar's folder, or the run's.
        motion: A named motion (nod, turn, shake, tilt, figure-eight, stop, impulse), a motion file (.npz, .json, .csv),
            a video of a head, or a segment of a capture: CAPTURE:SEGMENT, or its name alone.
        camera: front, orbit (once round the head), orbit:30 (degrees a second), a path of key frames (.json), or a
            capture's camera: CAPTURE:CAMERA, or its name alone.
        capture: Whose segments and cameras may be named alone; the run's own by default.
        out: A video (.mp4), or a folder for PNG pictures.
        png: Write PNG pictures too, in a folder beside the video.
        size: Pixels of the longer side; the camera's own by default.
        seconds: Length of a named motion; another is cut off there.
        amplitude: Of a named motion, degrees.
        speed: Of a named motion, as a factor.
        smoothing: Hz above which motion counts as jitter and is removed, such as 5; 0 for none.
        rigid_hair: Keep the hair in its canonical shape.
    """
    from dynhair.animation.run import run_animation

    run_animation(
        avatar,
        motion,
        camera=camera,
        capture=capture,
        out=out,
        png=png,
        size=size,
        seconds=seconds,
        amplitude=amplitude,
        speed=speed,
        smoothing=smoothing,
        rigid_hair=rigid_hair,
    )


def edit(avatar: Positional[Path], options: Annotated[EditOptions, arg(name="")], out: Path | None = None) -> None:
    """Edit the hair: colour, length, density, width, of all of it or of a region. Edits are kept and can be taken back.

    They are applied in the order of the options below. Asked for none, it lists those that there are.

    Args:
        avatar: The avatar's folder, or the run's.
        options: Edits to take back, and new ones.
        out: A new folder for the edited avatar; in place by default.
    """
    from dynhair.editing.run import run_edit

    run_edit(avatar, options, out=out)


def export(
    avatar: Positional[Path],
    out: Path,
    formats: tuple[FormatName, ...] = ("ply",),
    motion: str | None = None,
    frames: str | None = None,
    rigid_hair: bool = False,
) -> None:
    """Write an avatar, at rest or in motion, for other programs.

    Args:
        avatar: The avatar's folder, or the run's.
        out: Folder for the files. Of another export there, files are replaced.
        formats: ply and compressed are splats, a file a frame; usd, abc and blend hold strands, head mesh and head pose
            over time; hair, data, npz and polylines strands, a file a frame; head is the head mesh, a file a frame;
            motion the head's poses and expressions.
        motion: What drives the avatar, as for animate; at rest by default.
        frames: Which frames of the motion, START:STOP; all by default.
        rigid_hair: Keep the hair in its canonical shape.
    """
    from dynhair.export.run import run_export

    run_export(avatar, out, formats, motion=motion, frames=frames, rigid_hair=rigid_hair)


def view(avatar: Positional[Path], capture: Path | None = None, port: int = 8080, browser: bool = True) -> None:
    """Look at an avatar on a page in the browser: move and edit it live. Ctrl-C ends it.

    Args:
        avatar: The avatar's folder, or the run's.
        capture: Whose motions can be played; the run's own by default.
        port: Of the page; the next free one where it is in use.
        browser: Open the page.
    """
    from dynhair.viewer.run import run_viewer

    run_viewer(avatar, capture=capture, port=port, browser=browser)
