"""A capture on disk, opened for reading."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32, Float64
from scipy.spatial.transform import Rotation

from dynhair.camera import Camera
from dynhair.capture.arrays import read_npy, read_npz
from dynhair.capture.encoding import read_size
from dynhair.capture.expression_basis import ExpressionBasis
from dynhair.capture.layout import Layout, guess_manifest, view_names
from dynhair.capture.manifest import Manifest, parse_manifest
from dynhair.capture.records import GroundTruth, HeadTrack, Segment, TrackedMesh, View
from dynhair.capture.views import ViewFiles, ViewReader
from dynhair.errors import DynhairError
from dynhair.storage import read_json

DEFAULT_CACHE_BYTES = 1 << 30
_CACHED_CAMERAS = 64
"""Every frame has its own, read in 0.3 ms. All of them would take little memory by themselves; but small things that
stay, made between images that go, leave holes in the heap that no image fits into: 0.25 MB for each camera."""


class Capture:
    """Multi-view images of a head in motion, with masks, cameras and the tracked head.

    Everything is read when it is first asked for. Images are kept in 8 bits, within a budget of memory, so that a
    capture may be larger than memory. All methods may be called from several threads.

    Args:
        layout: where the files are.
        manifest: what the capture is.
        cache_bytes: memory for decoded images.
    """

    def __init__(self, layout: Layout, manifest: Manifest, *, cache_bytes: int = DEFAULT_CACHE_BYTES) -> None:
        self.layout = layout
        self.manifest = manifest
        self.image_size = self._stored_size() if layout.lowres else manifest.image_size
        self._views = ViewReader(layout, self.image_size, on_black=manifest.background is None, cache_bytes=cache_bytes)
        self._camera = lru_cache(_CACHED_CAMERAS)(self._read_camera)
        self._tracks: dict[Segment, HeadTrack] = {}

    @classmethod
    def open(cls, path: Path | str, *, cache_bytes: int = DEFAULT_CACHE_BYTES, lowres: bool = False) -> Capture:
        """Open a capture, or a folder prepared for Gaussian Head Avatar, which has no ``capture.json``.

        Args:
            path: the folder.
            cache_bytes: memory for decoded images; 256 x 256 views take 0.4 MB each.
            lowres: read ``image_lowres_*`` and ``mask_lowres_*`` in place of the full images.

        Raises:
            DynhairError: there is no capture, or its ``capture.json`` is not sound.
        """
        layout = Layout(Path(path), lowres=lowres)
        if not layout.root.is_dir():
            raise DynhairError("there is no such folder", path=layout.root, expected="the folder of a capture")
        if layout.manifest.exists():
            manifest = parse_manifest(read_json(layout.manifest), layout.manifest)
        else:
            manifest = guess_manifest(layout)
        return cls(layout, manifest, cache_bytes=cache_bytes)

    @property
    def path(self) -> Path:
        """The capture's folder."""
        return self.layout.root

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.path.resolve().name

    @property
    def cache_bytes(self) -> int:
        """Bytes that decoded images may take."""
        return self._views.cache.budget

    @property
    def cached_bytes(self) -> int:
        """Bytes that decoded images take now."""
        return self._views.cache.nbytes

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.manifest.fps

    @property
    def gravity(self) -> Float64[np.ndarray, " 3"]:
        """Gravity in the world, m/s^2."""
        return np.array(self.manifest.gravity, np.float64)

    @property
    def background(self) -> Float64[np.ndarray, " 3"]:
        """The colour that every view's ``rgb`` stands on, sRGB in [0, 1].

        Images that show their own background are put on black, by their mask, when they are read.
        """
        return np.array(self.manifest.background or (0.0, 0.0, 0.0), np.float64)

    @property
    def expression_basis(self) -> ExpressionBasis | None:
        """Whose expression coefficients the frames hold; None if that is not known."""
        return self.manifest.expression_basis

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The cameras that see every frame."""
        return self.manifest.camera_names

    @property
    def segments(self) -> tuple[Segment, ...]:
        """All segments, sorted by their first frame."""
        return self.manifest.segments

    def segment(self, name: str) -> Segment:
        """Find the segment called ``name``.

        Raises:
            DynhairError: there is none.
        """
        for segment in self.segments:
            if segment.name == name:
                return segment
        raise DynhairError(
            f"no segment is called `{name}`", path=self.path, expected=" or ".join(s.name for s in self.segments)
        )

    def camera(self, frame: int, name: str) -> Camera:
        """Read the camera ``name`` as it stood at ``frame``, for images of `image_size`."""
        self._require(name, self.camera_names)
        return self._camera(self.layout.camera(frame, name))

    def view(self, frame: int, name: str) -> View:
        """Read one view of one frame.

        Raises:
            DynhairError: a file is missing, damaged or of another size than `image_size`.
        """
        return self.views([(frame, name)])[0]

    def views(self, requests: Sequence[tuple[int, str]]) -> list[View]:
        """Read several views, given as frame and camera name; their images are decoded in parallel.

        Raises:
            DynhairError: as for `view`.
        """
        return self._views.read([self._files(frame, name) for frame, name in requests])

    def attempt_views(self, frame: int | None, names: Sequence[str]) -> list[View | DynhairError]:
        """Read views of one frame, or static views if it is None; for one that cannot be read, why."""
        if frame is not None:
            return self._views.attempt([self._files(frame, name) for name in names])
        return self._views.attempt([self._static_files(name) for name in names])

    @cached_property
    def static_names(self) -> tuple[str, ...]:
        """The views around the motionless head; empty if there are none."""
        return tuple(sorted(view_names(self.layout.static_images, lowres=self.layout.lowres)))

    @property
    def static_frame(self) -> int:
        """The frame whose head pose the static views show."""
        frame = self.manifest.static_frame
        return self.segments[0].start if frame is None else frame

    def static_camera(self, name: str) -> Camera:
        """Read the camera of a static view."""
        self._require(name, self.static_names)
        return self._camera(self.layout.static_camera(name))

    def static_view(self, name: str) -> View:
        """Read one static view.

        Raises:
            DynhairError: as for `view`.
        """
        return self._views.read([self._static_files(name)])[0]

    def track(self, segment: Segment) -> HeadTrack:
        """Read the head's motion over a segment.

        Raises:
            DynhairError: the parameters of a frame are missing, damaged or not finite, or their expression coefficients
                are not as many as in the other frames and as `expression_basis` names.
        """
        if segment not in self._tracks:
            frames = [
                read_npz(self.layout.params(frame), {"pose": (1, 6), "exp_coeff": (1, None)})
                for frame in segment.frames
            ]
            widths = {len(frame["exp_coeff"][0]) for frame in frames}
            if len(widths) > 1:
                raise DynhairError(
                    f"frames of `{segment.name}` have {min(widths)} to {max(widths)} expression coefficients",
                    path=self.layout.params(segment.start),
                    expected="the same number in all",
                )
            if self.expression_basis is not None:
                self.expression_basis.require_size(max(widths), self.layout.manifest)
            poses = np.array([frame["pose"][0] for frame in frames], np.float64)
            self._tracks[segment] = HeadTrack(
                rotations=Rotation.from_rotvec(poses[:, :3]).as_matrix(),
                translations=poses[:, 3:].copy(),
                expressions=np.array([frame["exp_coeff"][0] for frame in frames], np.float32),
                fps=self.fps,
                gravity=self.gravity,
                expression_basis=self.expression_basis,
            )
        return self._tracks[segment]

    @cached_property
    def mesh(self) -> TrackedMesh | None:
        """Topology of the tracked mesh; None if the capture has none."""
        path = self.layout.mesh
        if not path.exists():
            return None
        arrays = read_npz(path, {"faces": (None, 3), "scalp": (None,), "follow": (None,), "landmarks68": (68,)})
        mesh = TrackedMesh(
            faces=arrays["faces"].astype(np.int64),
            scalp=arrays["scalp"].astype(np.int64),
            follow=arrays["follow"].astype(np.float32),
            landmarks=arrays["landmarks68"].astype(np.int64),
        )
        for name, indices, limit in (
            ("faces", mesh.faces, len(mesh.follow)),
            ("scalp", mesh.scalp, len(mesh.faces)),
            ("landmarks68", mesh.landmarks, len(mesh.follow)),
        ):
            if indices.size and not (indices.min() >= 0 and indices.max() < limit):
                raise DynhairError(
                    f"`{name}` holds indices from {indices.min()} to {indices.max()}",
                    path=path,
                    expected=f"indices from 0 to {limit - 1}",
                )
        return mesh

    def vertices(self, frame: int) -> Float32[np.ndarray, "v 3"]:
        """Read the positions of the tracked mesh, world, metres.

        Raises:
            DynhairError: there are none for this frame, or not as many as the mesh has.
        """
        count = None if self.mesh is None else len(self.mesh.follow)
        return read_npy(self.layout.vertices(frame), (count, 3)).astype(np.float32)

    def landmarks_3d(self, frame: int) -> Float32[np.ndarray, "66 3"]:
        """Read the landmarks in the world, metres: iBUG-68 without 48 and 54, the inner corners of the mouth."""
        return read_npy(self.layout.landmarks_3d(frame), (66, 3)).astype(np.float32)

    def landmarks_2d(self, frame: int, name: str) -> Float32[np.ndarray, "68 3"] | None:
        """Read the iBUG-68 landmarks in pixels with a score; None if this view has none."""
        self._require(name, self.camera_names)
        path = self.layout.landmarks_2d(frame, name)
        if not path.exists():
            return None
        landmarks = read_npy(path, (68, 3)).astype(np.float32)
        landmarks[:, :2] *= np.array(self.image_size, np.float32) / np.array(self.manifest.image_size, np.float32)
        return landmarks

    def ground_truth(self, segment: Segment) -> GroundTruth | None:
        """Read the true strands of a segment, where a simulation knows them. For evaluation only.

        Raises:
            DynhairError: the file is damaged or has too few frames.
        """
        path = self.layout.ground_truth(segment.name)
        if not path.exists():
            return None
        strands = read_npz(path, {"strands": (None, None, None, 3)})["strands"]
        first = segment.start - self.segment(segment.name).start
        if first < 0 or first + segment.count > len(strands):
            raise DynhairError(
                f"`strands` has {len(strands)} frames", path=path, expected=f"{first + segment.count} or more"
            )
        return GroundTruth(strands[first : first + segment.count].astype(np.float32))

    def _files(self, frame: int, name: str) -> ViewFiles:
        self._require(name, self.camera_names)
        return ViewFiles(self.layout.frame_images(frame), name)

    def _static_files(self, name: str) -> ViewFiles:
        self._require(name, self.static_names)
        return ViewFiles(self.layout.static_images, name)

    def _require(self, name: str, names: tuple[str, ...]) -> None:
        if name not in names:
            raise DynhairError(f"no view is called `{name}`", path=self.path, expected=" or ".join(names) or "none")

    def _stored_size(self) -> tuple[int, int]:
        folder = self.layout.frame_images(self.segments[0].start)
        path = self.layout.find_image(folder, "image", self.camera_names[0])
        if path is None:
            raise DynhairError("has no image_lowres_* files", path=folder, mend="open the capture at full size")
        return read_size(path)

    def _read_camera(self, path: Path) -> Camera:
        arrays = read_npz(path, {"extrinsic": (3, 4), "intrinsic": (3, 3)})
        w2c, K = (torch.from_numpy(arrays[key].astype(np.float32)) for key in ("extrinsic", "intrinsic"))
        return Camera(w2c, K, *self.manifest.image_size).resized(*self.image_size)
