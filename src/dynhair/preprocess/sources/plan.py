"""What an import will write, settled before the first picture is decoded."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from dynhair.capture.manifest import Manifest, manifest_problems
from dynhair.capture.records import Segment, Split
from dynhair.errors import DynhairError
from dynhair.preprocess.options import ImportOptions
from dynhair.preprocess.sources.geometry import Rectifier
from dynhair.preprocess.sources.recording import Channel, Recording, StaticRing, Take, World

_COUNT_SLACK = 3
"""Frames by which videos of one take may differ in length: cameras are rarely stopped in the same instant."""

_RATE_SLACK = 0.002
"""Share by which frame rates may differ: less than two frames in half a minute at 30 a second."""

_FREE = "FREE"
"""NeRSemble's take of free performance, held out as in the field's evaluations."""


@dataclass(frozen=True)
class Shot:
    """One take's part of a capture.

    Attributes:
        take: where it comes from.
        segment: what it becomes.
        indices: the take's frames, one for each frame of the segment.
    """

    take: Take
    segment: Segment
    indices: range


@dataclass(frozen=True)
class ImportPlan:
    """What an import will write.

    Attributes:
        shots: in order.
        static: the ring around the motionless head; None for none.
        manifest: of the coming capture.
        world: units and axes of the recording.
        stored_size: camera to the size of its pictures, in pixels.
        notes: what the user should know.
    """

    shots: tuple[Shot, ...]
    static: StaticRing | None
    manifest: Manifest
    world: World
    stored_size: Mapping[str, tuple[int, int]]
    notes: tuple[str, ...]

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The cameras that are used."""
        return self.manifest.camera_names


def plan_import(recording: Recording, options: ImportOptions) -> ImportPlan:
    """Choose takes, cameras and frames, and check that they fit together. Opens every video, but decodes one frame.

    Raises:
        DynhairError: a camera is not calibrated or has no video, videos differ in length, rate or size, or an option
            names what is not there.
    """
    notes = list(recording.notes)
    takes = _chosen_takes(recording, options)
    cameras = _chosen_cameras(takes, options)
    channels = {(take.name, name): take.channels[name] for take in takes for name in cameras}
    _probe(list(channels.values()))
    counts = {take.name: _count(take, cameras, notes) for take in takes}
    splits = _splits(takes, options, notes)
    shots = _shots(recording, takes, counts, splits, options)
    stored = {name: _stored_size(takes, name) for name in cameras}
    static, static_frame = _static(recording.static, shots, notes)
    world = _world(recording.world, options)
    manifest = Manifest(
        fps=_rate(recording, channels) / options.stride,
        image_size=_image_size(takes[0], cameras, stored, static, options),
        camera_names=cameras,
        segments=tuple(shot.segment for shot in shots),
        gravity=_gravity(recording, world),
        background=recording.background,
        static_frame=static_frame,
        notes={"cameras": {n: recording.camera_notes[n] for n in cameras if n in recording.camera_notes}},
    )
    if problems := manifest_problems(manifest.to_json(), recording.path):
        raise problems[0]
    return ImportPlan(tuple(shots), static, manifest, world, stored, tuple(notes))


def _shots(
    recording: Recording,
    takes: Sequence[Take],
    counts: Mapping[str, int],
    splits: Mapping[str, Split],
    options: ImportOptions,
) -> list[Shot]:
    """The frames of each take that are used; ids of frames run on over takes."""
    shots: list[Shot] = []
    for take in takes:
        indices = range(options.start, min(options.stop or counts[take.name], counts[take.name]), options.stride)
        if not indices:
            raise DynhairError(
                f"take `{take.name}` has {counts[take.name]} frames",
                path=recording.path,
                expected=f"more than {options.start}, the first to use",
                mend="leave the take out, or start earlier",
            )
        first = shots[-1].segment.start + shots[-1].segment.count if shots else 0
        segment = Segment(_segment_name(take.name), first, len(indices), splits[take.name])
        shots.append(Shot(take, segment, indices))
    return shots


def _world(recorded: World, options: ImportOptions) -> World:
    """The world of a recording, with what the options say in the place of what it says."""
    return World(options.metres_per_unit or recorded.metres_per_unit, options.up or recorded.up)


def _gravity(recording: Recording, world: World) -> tuple[float, float, float]:
    if recording.gravity is None:
        return (0.0, -9.81, 0.0)
    x, y, z = (world.to_y_up @ recording.gravity).tolist()
    return (x, y, z)


def _chosen_takes(recording: Recording, options: ImportOptions) -> list[Take]:
    names = [take.name for take in recording.takes]
    for name in options.takes or ():
        if name not in names:
            raise DynhairError(f"there is no take `{name}`", path=recording.path, expected=" or ".join(names))
    return [take for take in recording.takes if options.takes is None or take.name in options.takes]


def _chosen_cameras(takes: Sequence[Take], options: ImportOptions) -> tuple[str, ...]:
    everywhere = dict.fromkeys(name for take in takes for name in take.channels)
    for name in options.cameras or ():
        if name not in everywhere:
            raise DynhairError(f"there is no camera `{name}`", expected=" or ".join(everywhere))
    cameras = tuple(name for name in everywhere if options.cameras is None or name in options.cameras)
    for take in takes:
        for name in cameras:
            if name not in take.channels:
                raise DynhairError(
                    f"take `{take.name}` has nothing from camera `{name}`",
                    path=next(iter(take.channels.values())).frames.path.parent,
                    expected=f"all of {', '.join(cameras)}",
                    mend="add it, or leave the camera or the take out",
                )
            take.channels[name].camera(0)  # is calibrated
    return cameras


def _probe(channels: Sequence[Channel]) -> None:
    with ThreadPoolExecutor() as pool:
        list(pool.map(lambda channel: channel.frames.size, channels))


def _count(take: Take, cameras: Sequence[str], notes: list[str]) -> int:
    counts = {name: take.channels[name].frames.count for name in cameras}
    fewest, most = min(counts, key=lambda n: counts[n]), max(counts, key=lambda n: counts[n])
    if counts[most] - counts[fewest] > _COUNT_SLACK:
        raise DynhairError(
            f"has {counts[fewest]} frames, and that of camera `{most}` has {counts[most]} (take `{take.name}`)",
            path=take.channels[fewest].frames.path,
            expected=f"numbers of frames within {_COUNT_SLACK} of each other: cameras that start and stop together",
            mend="cut the videos to the same moments, or leave the camera out",
        )
    if counts[most] != counts[fewest]:
        notes.append(
            f"take `{take.name}`: cameras have {counts[fewest]} to {counts[most]} frames; the first {counts[fewest]} "
            "of each are used"
        )
    return counts[fewest]


def _rate(recording: Recording, channels: Mapping[tuple[str, str], Channel]) -> float:
    if recording.fps is not None:
        return recording.fps
    rates = [(channel.frames.fps, channel.frames.path) for channel in channels.values()]
    first, first_path = rates[0]
    if first is None:
        raise DynhairError(
            "the frame rate is not known",
            path=recording.path,
            expected="frames per second: the hair's speed depends on it",
            mend="give fps",
        )
    for rate, path in rates:
        if rate is None or abs(rate / first - 1) > _RATE_SLACK:
            raise DynhairError(
                f"has {rate:.6g} frames per second, and {first_path.name} has {first:.6g}",
                path=path,
                expected="one frame rate in all videos",
                mend="give fps if the files do not tell the truth, or leave the take out",
            )
    return first


def _splits(takes: Sequence[Take], options: ImportOptions, notes: list[str]) -> dict[str, Split]:
    names = [take.name for take in takes]
    if options.test_takes is not None:
        for name in options.test_takes:
            if name not in names:
                raise DynhairError(f"there is no take `{name}` to hold out", expected=" or ".join(names))
        held_out = set(options.test_takes)
        if held_out == set(names):
            raise DynhairError("all takes are held out", expected="at least one to train on")
    elif any(take.split for take in takes):
        held_out = {take.name for take in takes if take.split == "test"}
        if held_out == set(names):
            raise DynhairError("all takes are held out by the recording", mend="give other takes, or test_takes")
    elif len(names) > 1:
        held_out = {_FREE if _FREE in names else names[-1]}
        notes.append(f"take `{min(held_out)}` is held out for evaluation")
    else:
        held_out = set()
        notes.append(f"there is one take, `{names[0]}`: all of it trains, and nothing is held out for evaluation")
    return {name: "test" if name in held_out else "train" for name in names}


def _stored_size(takes: Sequence[Take], camera: str) -> tuple[int, int]:
    first = takes[0].channels[camera].frames
    for take in takes:
        frames = take.channels[camera].frames
        if frames.size != first.size:
            raise DynhairError(
                f"is {frames.size[0]} x {frames.size[1]} pixels in take `{take.name}`",
                path=frames.path,
                expected=f"{first.size[0]} x {first.size[1]}, as in take `{takes[0].name}`",
                mend="leave one of the takes out",
            )
    return first.size


def _image_size(
    take: Take,
    cameras: Sequence[str],
    stored: Mapping[str, tuple[int, int]],
    static: StaticRing | None,
    options: ImportOptions,
) -> tuple[int, int]:
    sized = [(take.channels[name], stored[name]) for name in cameras]
    if static is not None:
        sized += [(channel, channel.frames.size) for channel in static.channels.values()]
    results: dict[tuple[int, int], Channel] = {}
    for channel, size in sized:
        try:
            results.setdefault(Rectifier(channel.camera(0), size, options.crop, options.size).size, channel)
        except DynhairError as error:
            path = channel.frames.path
            raise DynhairError(error.message, path=path, expected=error.expected, mend=error.mend) from None
    if len(results) > 1:
        (size, one), (other_size, other), *_ = results.items()
        raise DynhairError(
            f"gives pictures of {other_size[0]} x {other_size[1]}, and {one.frames.path.name} of {size[0]} x {size[1]}",
            path=other.frames.path,
            expected="one size for all pictures of a capture",
            mend="give a crop (square, for instance) and a size",
        )
    return next(iter(results))


def _static(ring: StaticRing | None, shots: Sequence[Shot], notes: list[str]) -> tuple[StaticRing | None, int | None]:
    if ring is None:
        return None, None
    for shot in shots:
        if shot.take.name == ring.take and ring.index in shot.indices:
            return ring, shot.segment.start + shot.indices.index(ring.index)
    notes.append(
        f"the static views are left out: they show the head as in frame {ring.index} of take `{ring.take}`, which is "
        "not among the frames to use"
    )
    return None, None


def _segment_name(take: str) -> str:
    """A name that a manifest accepts: NeRSemble has takes such as ``EMO-1-shout+laugh``."""
    return re.sub(r"[^A-Za-z0-9_.-]", "_", take).lstrip("_.-") or "take"
