"""A capture while it is being made: where each step finds its inputs and leaves its outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image

from dynhair.camera import Camera
from dynhair.capture.arrays import read_npz
from dynhair.capture.encoding import encode_orientation, read_mask, read_rgb
from dynhair.capture.layout import Layout
from dynhair.capture.manifest import Manifest, parse_manifest
from dynhair.capture.records import Segment
from dynhair.errors import DynhairError
from dynhair.storage import atomic_file, read_json, write_json


@dataclass(frozen=True, order=True)
class ViewId:
    """One camera's picture of one moment.

    Attributes:
        frame: the frame's id; -1 for a view of the ring around the motionless head.
        name: the camera's name, or the static view's.
    """

    frame: int
    name: str

    @property
    def is_static(self) -> bool:
        """Whether it belongs to the ring around the motionless head."""
        return self.frame < 0

    @property
    def folder(self) -> str:
        """The name of its frame's folder."""
        return "static360" if self.is_static else f"{self.frame:04d}"


STATIC = -1
"""The frame of static views."""


class Workspace:
    """The folder of a capture, and beside its images, in ``preprocess/``, what the steps need for themselves.

    ``capture.json`` is written last: a folder without it is not yet a capture.

    Args:
        root: the capture's folder; made when something is first written.
    """

    def __init__(self, root: Path | str) -> None:
        self.root = Path(root)
        self.layout = Layout(self.root)

    @property
    def folder(self) -> Path:
        """What the steps need for themselves; the capture is whole without it."""
        return self.root / "preprocess"

    def write_manifest(self, manifest: Manifest, static_names: Sequence[str] = ()) -> None:
        """Say what has been imported: the coming capture's manifest, and the names of its static views."""
        write_json(self._plan, {"manifest": manifest.to_json(), "static_names": list(static_names)})
        for known in ("_imported", "views"):
            self.__dict__.pop(known, None)

    @property
    def manifest(self) -> Manifest:
        """What the capture will be.

        Raises:
            DynhairError: nothing has been imported yet.
        """
        return self._imported[0]

    @property
    def static_names(self) -> tuple[str, ...]:
        """Names of the views of the ring around the motionless head; empty for none."""
        return self._imported[1]

    @cached_property
    def views(self) -> tuple[ViewId, ...]:
        """All views: segment by segment, frame by frame, camera by camera; static views last."""
        moving = (view for segment in self.manifest.segments for view in self.segment_views(segment))
        return (*moving, *(ViewId(STATIC, name) for name in self.static_names))

    def segment_views(self, segment: Segment) -> tuple[ViewId, ...]:
        """The views of one segment, frame by frame, camera by camera."""
        return tuple(ViewId(frame, name) for frame in segment.frames for name in self.manifest.camera_names)

    def image_path(self, view: ViewId, kind: str = "image") -> Path:
        """Where the picture (``image``) or a map (``mask``, ``hair``, ``orient``) of a view is stored."""
        folder = self.layout.static_images if view.is_static else self.layout.frame_images(view.frame)
        return folder / f"{kind}_{view.name}.{'jpg' if kind == 'image' else 'png'}"

    def camera_path(self, view: ViewId) -> Path:
        """Where a view's camera is stored."""
        return self.layout.static_camera(view.name) if view.is_static else self.layout.camera(view.frame, view.name)

    def given_path(self, view: ViewId, kind: str) -> Path:
        """Where a mask that came with the recording is kept, brought to the image's geometry."""
        return self.folder / "given" / kind / view.folder / f"{view.name}.png"

    def landmarks_path(self, view: ViewId) -> Path:
        """Where a view's landmarks are kept."""
        return self.folder / "landmarks" / view.folder / f"{view.name}.npz"

    def plate_path(self, name: str) -> Path:
        """Where the picture of a camera's empty scene is kept, brought to the images' geometry."""
        return self.folder / "plates" / f"{name}.png"

    def image(self, view: ViewId) -> UInt8[np.ndarray, "h w 3"]:
        """Read a picture."""
        return read_rgb(self.image_path(view))

    def mask(self, view: ViewId, kind: str = "mask") -> UInt8[np.ndarray, "h w"]:
        """Read a coverage map: ``mask`` or ``hair``."""
        return read_mask(self.image_path(view, kind))

    def camera(self, view: ViewId) -> Camera:
        """Read a view's camera."""
        arrays = read_npz(self.camera_path(view), {"extrinsic": (3, 4), "intrinsic": (3, 3)})
        w2c, K = (torch.from_numpy(arrays[key].astype(np.float32)) for key in ("extrinsic", "intrinsic"))
        return Camera(w2c, K, *self.manifest.image_size)

    def write_image(self, view: ViewId, pixels: UInt8[np.ndarray, "h w 3"]) -> None:
        """Write a picture, as JPEG with next to no loss."""
        with atomic_file(self.image_path(view)) as path:
            Image.fromarray(pixels).save(path, quality=95, subsampling="4:4:4")

    def mask_path(self, view: ViewId, kind: str, *, raw: bool = False) -> Path:
        """Where a coverage map is stored; a raw one has its flicker still, and is no part of the capture."""
        return self.folder / "raw" / kind / view.folder / f"{view.name}.png" if raw else self.image_path(view, kind)

    def write_mask(self, view: ViewId, kind: str, coverage: UInt8[np.ndarray, "h w"], *, raw: bool = False) -> None:
        """Write a coverage map: ``mask`` or ``hair``."""
        with atomic_file(self.mask_path(view, kind, raw=raw)) as path:
            Image.fromarray(coverage).save(path)

    def write_orientation(
        self, view: ViewId, angle: Float[np.ndarray, "h w"], coherence: Float[np.ndarray, "h w"]
    ) -> None:
        """Write an orientation map; angles in units of pi, coherence in [0, 1]."""
        with atomic_file(self.image_path(view, "orient")) as path:
            Image.fromarray(encode_orientation(angle, coherence)).save(path)

    def write_camera(self, view: ViewId, w2c: Float[np.ndarray, "3 4"], K: Float[np.ndarray, "3 3"]) -> None:
        """Write a view's camera, in double precision."""
        with atomic_file(self.camera_path(view)) as path, path.open("wb") as file:
            np.savez(file, extrinsic=w2c.astype(np.float64), intrinsic=K.astype(np.float64))

    @property
    def _plan(self) -> Path:
        return self.folder / "imported.json"

    @cached_property
    def _imported(self) -> tuple[Manifest, tuple[str, ...]]:
        if not self._plan.exists():
            raise DynhairError("no recording has been imported yet", path=self.root)
        raw = read_json(self._plan)
        return parse_manifest(raw["manifest"], self._plan), tuple(raw["static_names"])
