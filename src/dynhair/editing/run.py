"""``dynhair edit``: the list of edits that is kept with an avatar on disk."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from PIL import Image
from rich.console import Console
from rich.text import Text

from dynhair.animation.procedural import SWEEP, WIND_UP, motion
from dynhair.avatar import Avatar, Recording
from dynhair.avatar.model_folder import DESCRIPTION
from dynhair.edit_options import EditOptions
from dynhair.editing.edits import Brightness, Edit, Thin, Tint, Trim, Width
from dynhair.errors import DynhairError
from dynhair.evaluation.pictures import picture
from dynhair.pictures import Picture, grid
from dynhair.storage import atomic_file, read_json, write_json
from dynhair.strands import strand_lengths
from dynhair.training import avatar_folder, recording_of

PICTURE = "edit.png"


@torch.no_grad()
def run_edit(
    avatar: Path | str,
    options: EditOptions,
    *,
    out: Path | str | None = None,
    device: torch.device | str = "cpu",
    console: Console | None = None,
) -> tuple[Edit, ...]:
    """Append edits to those of an avatar, or take some back; print what there are, and picture what they do.

    Edits are kept in the avatar's description and applied whenever it is posed; its tensors stay as they are. Asked for
    nothing, it prints the edits that there are. First of all edits are taken back, if that is asked for; then the new
    ones follow in the order of the options.

    Args:
        avatar: the avatar's folder, or its run's.
        options: what is asked for; regions as :func:`~dynhair.editing.regions.parse_region` reads them.
        out: a new folder for the edited avatar; in place by default.
        device: where the pictures are drawn.
        console: where the list goes; standard output when left out.

    Returns:
        The edits that the avatar now has.

    Raises:
        DynhairError: the avatar cannot be read or written, an edit is out of range or does not fit its hair, or there
            are not so many edits to take back.
    """
    console, folder = console or Console(), avatar_folder(Path(avatar))
    added = _new_edits(options)
    changing = bool(added or options.undo or options.clear)
    if options.list_only and (changing or out is not None):
        raise DynhairError("edits are to be listed, and changed as well", expected="one of the two")

    edited = Avatar.load(folder, device)
    if changing or out is not None:
        edited = edited.with_edits((*_kept(edited.edits, options.undo, options.clear), *added))
        folder = _write(edited, folder, out)
    _print(edited, folder, console)
    if changing or out is not None:
        _picture(edited, Path(avatar), folder.parent / PICTURE, console)
    return edited.edits


def _new_edits(options: EditOptions) -> list[Edit]:
    region = options.region
    trims = (options.trim, None, None), (None, options.longest, None), (None, None, options.length_of)
    edits: list[Edit] = []
    if options.brightness is not None:
        edits.append(Brightness(options.brightness, region=region))
    if options.tint is not None:
        edits.append(Tint(options.tint, options.tint_strength, region=region))
    edits += [Trim(*trim, region=region) for trim in trims if trim != (None, None, None)]
    if options.thin is not None:
        edits.append(Thin(options.thin, region=region))
    if options.width is not None:
        edits.append(Width(options.width, region=region))
    return edits


def _kept(edits: Sequence[Edit], undo: int, clear: bool) -> Sequence[Edit]:
    """The edits that are not taken back."""
    if not 0 <= undo <= len(edits):
        raise DynhairError(f"{undo} edits cannot be taken back", expected=f"0 to {len(edits)}, as many as there are")
    return () if clear else edits[: len(edits) - undo]


def _write(edited: Avatar, folder: Path, out: Path | str | None) -> Path:
    """Keep the edits, in the avatar's folder or with a copy of it; which of them is returned."""
    if out is None:
        path = folder / DESCRIPTION
        try:
            write_json(path, {**read_json(path), "edits": [edit.to_json() for edit in edited.edits]})
        except OSError as error:
            raise DynhairError(f"the edits cannot be written ({error})", path=path) from error
        return folder
    out = Path(out)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DynhairError("there is something already", path=out, expected="a new or empty folder")
    if edited.recording is None:  # outside of its run, an older avatar cannot ask for it
        edited.recording = _recording(folder)
    edited.save(out)
    return out


def _recording(folder: Path) -> Recording | None:
    try:
        return recording_of(folder)
    except DynhairError:
        return None


def _print(edited: Avatar, folder: Path, console: Console) -> None:
    if not edited.edits:
        console.print(f"{folder}: no edits", highlight=False, soft_wrap=True)
        return
    console.print(f"{folder}: edits, in the order in which they are applied", highlight=False, soft_wrap=True)
    for number, edit in enumerate(edited.edits, 1):
        console.print(Text(f"{number:3}  {edit}"), soft_wrap=True)
    left, trained = edited.resting_strands, edited.canonical_strands
    lengths = [f"{100 * float(strand_lengths(strands).median()):.1f}" for strands in (left, trained)]
    counts = f"{len(left)} of {len(trained)} strands"
    console.print(f"what remains: {counts}, by the median {lengths[0]} of {lengths[1]} cm", highlight=False)


def _picture(edited: Avatar, avatar: Path, path: Path, console: Console) -> None:
    """Show the avatar as it was trained and as it is edited, at rest and as a turn of the head stops."""
    try:
        recording = edited.recording or recording_of(avatar)
    except DynhairError as error:
        console.print(Text(f"n/a: a picture: {error.message}", style="dim"), soft_wrap=True)
        return
    track = motion("stop", recording)
    camera = recording.camera.to(edited.background.device)
    frames = {"at rest": 0, "moving": round((WIND_UP + SWEEP) * recording.fps)}

    def shown(avatar: Avatar) -> list[Picture]:
        images = (avatar.draw(avatar.pose(track, frame), [camera]).rgb[0] for frame in frames.values())
        return [picture(image.cpu().clamp(0, 1)) for image in images]

    sheet = grid([shown(edited.with_edits(())), shown(edited)], ["as trained", "edited"], list(frames))
    with atomic_file(path) as temporary:
        Image.fromarray(sheet).save(temporary)
    console.print(f"wrote {path}", highlight=False, soft_wrap=True)
