"""The prior's training set: procedural hairstyles on random heads, as cameras around them see them."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.hairstyles import FAMILIES, HELD_OUT, HeadField, grow_hairstyle, random_head, random_style
from dynhair.prior.evidence import body_depths
from dynhair.render import Gaussians
from dynhair.storage import atomic_file
from dynhair.strands import strand_lengths
from dynhair.strands.scalp import smooth_surface
from dynhair.strands.scalp_map import ScalpFrame, texture_roots
from dynhair.training.static_scene import render_hair, surface_gaussians

TEXTURE = 32
"""Texels along a side of the scalp texture."""

FRONT_VIEWS, RING_VIEWS = 4, 24

_SHARD_VERSION = 1
_STYLES_A_HEAD = 48
_VALIDATION_STYLES = 24
_IMAGE = 96
_STRAND_POINTS = 64
_COVERED_AREA = 0.25  # square metres of hair at the least, about five scalps
_NARROWEST, _WIDEST = 0.0024, 0.008


@dataclass(frozen=True)
class StyleViews:
    """A hairstyle and what cameras see of it: the front views first, then those all around.

    Attributes:
        family: of the hairstyle.
        head: seed of the head.
        frame: of its scalp.
        cameras: in the head frame.
        hair: coverage, 0 to 255.
        direction: doubled angle times coverage, -127 to 127.
        body_depth: metres, infinite where there is no body.
        texels: the scalp's, flat indices into the texture.
        strands: at the texels, relative to their roots, in scalp units, with equal segments.
    """

    family: str
    head: int
    frame: ScalpFrame
    cameras: list[Camera]
    hair: np.ndarray
    direction: np.ndarray
    body_depth: np.ndarray
    texels: Int[Tensor, " n"]
    strands: Float[Tensor, "n p 3"]


@dataclass(frozen=True)
class Shard:
    """The hairstyles of one head, in one file.

    Attributes:
        name: of the file.
        families: of the hairstyles, in order.
        seed: of head, styles and cameras.
    """

    name: str
    families: tuple[str, ...]
    seed: int


def planned_shards(styles: int, seed: int) -> list[Shard]:
    """The set's shards: the validation sets first, then the training set.

    Args:
        styles: hairstyles to train on, families in turn.
        seed: of everything.
    """
    learnt = [family for family in FAMILIES if family not in HELD_OUT]
    plans = [("held_out", HELD_OUT, _VALIDATION_STYLES), ("known", tuple(learnt), _VALIDATION_STYLES)]
    begun = 0
    for index in range(math.ceil(styles / _STYLES_A_HEAD)):
        turned = tuple(learnt[begun % len(learnt) :] + learnt[: begun % len(learnt)])
        count = min(_STYLES_A_HEAD, styles - begun)
        plans.append((f"train_{index:03d}", turned, count))
        begun += count
    return [
        Shard(name, tuple(families[i % len(families)] for i in range(count)), 1000 * seed + number)
        for number, (name, families, count) in enumerate(plans)
    ]


def make_set(
    folder: Path, styles: int, seed: int, progress: Callable[[int, int], None] = lambda done, total: None
) -> None:
    """Grow and render the set; a shard that is there already is kept, so that the work goes on after an interruption.

    Args:
        folder: for the shards.
        styles: hairstyles to train on.
        seed: of everything.
        progress: called with the number of styles done and their total.

    Raises:
        DynhairError: the folder holds shards of another set.
    """
    shards = planned_shards(styles, seed)
    total = sum(len(shard.families) for shard in shards)
    done = 0
    for shard in shards:
        path = folder / f"{shard.name}.npz"
        if path.exists():
            _check_shard(path, shard)
        else:
            _write_shard(path, shard, lambda grown, before=done: progress(before + grown, total))
        done += len(shard.families)
        progress(done, total)


def read_set(folder: Path, kind: str) -> list[StyleViews]:
    """Read all hairstyles of a kind, ``train``, ``known`` or ``held_out``.

    Raises:
        DynhairError: there are none, or a shard is damaged.
    """
    paths = sorted(folder.glob(f"{kind}*.npz"))
    if not paths:
        raise DynhairError(f"no hairstyles of the kind {kind!r}", path=folder, mend="make the set first")
    return list(chain.from_iterable(_read_shard(path) for path in paths))


def random_rig(random: np.random.Generator, frame: ScalpFrame) -> list[Camera]:
    """Cameras such as captures have: a few before the face, and a ring around the head."""
    middle = frame.centre.numpy() - [0, random.uniform(0, 0.2), 0]
    reach = random.uniform(0.24, 0.45)
    cameras = []
    arc = np.linspace(-50, 50, FRONT_VIEWS) * random.uniform(0.6, 1)
    ring = np.arange(RING_VIEWS) * 360 / RING_VIEWS + random.uniform(0, 15)
    lift = random.uniform(5, 25)
    for azimuths, distance in ((arc, random.uniform(0.7, 1.5)), (ring, random.uniform(0.7, 1.5))):
        for index, azimuth in enumerate(azimuths):
            turn = math.radians(azimuth + random.normal(0, 4))
            rise = math.radians((index % 3 - 1) * lift + random.normal(0, 4))
            away = np.array([math.sin(turn) * math.cos(rise), math.sin(rise), math.cos(turn) * math.cos(rise)])
            target = middle + random.normal(0, 0.015, 3)
            apart = distance * random.uniform(0.93, 1.07)
            cameras.append(_looking_at(target, target + apart * away, _IMAGE / 2 * apart / reach))
    return cameras


def _looking_at(target: np.ndarray, eye: np.ndarray, focal: float) -> Camera:
    forward = functional.normalize(torch.from_numpy(target - eye), dim=0)
    across = functional.normalize(torch.linalg.cross(forward, forward.new_tensor([0, 1, 0])), dim=0)
    rotation = torch.stack([across, torch.linalg.cross(forward, across), forward])
    w2c = torch.cat([rotation, -(rotation @ torch.from_numpy(eye))[:, None]], 1).float()
    K = torch.tensor([[focal, 0, _IMAGE / 2], [0, focal, _IMAGE / 2], [0, 0, 1]], dtype=torch.float32)
    return Camera(w2c, K, _IMAGE, _IMAGE)


@dataclass(frozen=True)
class _Head:
    frame: ScalpFrame
    field: HeadField
    body: Gaussians
    positions: Float[Tensor, "n 3"]
    normals: Float[Tensor, "n 3"]
    texels: Int[Tensor, " n"]

    @classmethod
    def of(cls, seed: int) -> _Head:
        vertices, faces, scalp = random_head(seed)
        frame = ScalpFrame.of(vertices, faces, scalp)
        roots, texels = texture_roots(vertices, faces, scalp, frame, TEXTURE)
        positions, normals = smooth_surface(roots, vertices, faces)
        field, body = HeadField.of(vertices, faces), surface_gaussians(vertices, faces)
        return cls(frame, field, body, positions, normals, texels)


def _write_shard(path: Path, shard: Shard, progress: Callable[[int], None]) -> None:
    head = _Head.of(shard.seed)
    columns: dict[str, list[np.ndarray]] = {
        name: [] for name in ("w2c", "K", "hair", "direction", "body_depth", "strands")
    }
    for index, family in enumerate(shard.families):
        for name, value in _style_views(head, family, shard.seed * _STYLES_A_HEAD + index).items():
            columns[name].append(value)
        progress(index + 1)
    arrays = {name: np.stack(values) for name, values in columns.items()}
    arrays |= {
        "version": np.array(_SHARD_VERSION),
        "seed": np.array(shard.seed),
        "families": np.array(shard.families),
        "centre": head.frame.centre.numpy(),
        "radius": np.array(head.frame.radius),
        "texels": head.texels.numpy().astype(np.int32),
    }
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def _style_views(head: _Head, family: str, seed: int) -> dict[str, np.ndarray]:
    random = np.random.Generator(np.random.PCG64(seed))
    style = random_style(family, seed)
    strands = grow_hairstyle(style, head.positions, head.normals, head.frame, head.field, _STRAND_POINTS)
    cameras = random_rig(random, head.frame)
    width = min(max(_COVERED_AREA / float(strand_lengths(strands).sum()), _NARROWEST), _WIDEST)
    with torch.no_grad():
        images = render_hair(strands, width, head.body, cameras)
    return {
        "w2c": np.stack([camera.w2c.numpy() for camera in cameras]),
        "K": np.stack([camera.K.numpy() for camera in cameras]),
        "hair": (255 * images.coverage).round().clamp(0, 255).byte().numpy(),
        "direction": (127 * images.direction).round().clamp(-127, 127).char().numpy(),
        "body_depth": body_depths(head.body, cameras).half().numpy(),
        "strands": ((strands - strands[:, :1]) / head.frame.radius).half().numpy(),
    }


def _check_shard(path: Path, shard: Shard) -> None:
    with _opened(path) as arrays:
        found = int(arrays["seed"]), tuple(arrays["families"].tolist())
    if found != (shard.seed, shard.families):
        mend = "give another folder, or remove this one"
        raise DynhairError("is of another set", path=path, expected=f"seed {shard.seed}", mend=mend)


def _read_shard(path: Path) -> list[StyleViews]:
    with _opened(path) as file:
        arrays = {name: file[name] for name in file.files}
    frame = ScalpFrame(torch.from_numpy(arrays["centre"]).float(), float(arrays["radius"]))
    texels = torch.from_numpy(arrays["texels"].astype(np.int64))
    return [
        StyleViews(
            family=str(family),
            head=int(arrays["seed"]),
            frame=frame,
            cameras=[
                Camera(torch.from_numpy(w2c), torch.from_numpy(K), _IMAGE, _IMAGE)
                for w2c, K in zip(arrays["w2c"][index], arrays["K"][index], strict=True)
            ],
            hair=arrays["hair"][index],
            direction=arrays["direction"][index],
            body_depth=arrays["body_depth"][index],
            texels=texels,
            strands=torch.from_numpy(arrays["strands"][index]),
        )
        for index, family in enumerate(arrays["families"].tolist())
    ]


@contextmanager
def _opened(path: Path) -> Iterator[np.lib.npyio.NpzFile]:
    mend = "remove it; it is made again"
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
            if int(arrays["version"]) != _SHARD_VERSION:
                raise DynhairError("of another version", path=path, mend=mend)
            yield arrays
    except (OSError, ValueError, EOFError, KeyError, TypeError, BadZipFile, zlib.error) as error:
        raise DynhairError(f"not readable as hairstyles ({error})", path=path, mend=mend) from None
