"""Writing captures in the layout that `Capture` reads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture.encoding import encode_orientation
from dynhair.capture.layout import Layout
from dynhair.capture.manifest import Manifest, manifest_problems
from dynhair.capture.records import Segment, TrackedMesh, View
from dynhair.errors import DynhairError
from dynhair.storage import atomic_folder, write_json

_IDENTITY_COEFFICIENTS = 80  # of Gaussian Head Avatar's parameter files


@dataclass(frozen=True)
class ImageCoding:
    """How images are stored; the defaults lose next to nothing.

    Attributes:
        image_format: of the colour images; maps are always PNG.
        jpeg_quality: 1 to 95; colour is subsampled below 90.
        mask_levels: grey levels of masks and hair masks, 2 to 256.
        angle_step: see `encode_orientation`.
        coherence_levels: see `encode_orientation`.
    """

    image_format: Literal["jpg", "png"] = "jpg"
    jpeg_quality: int = 92
    mask_levels: int = 256
    angle_step: int = 1
    coherence_levels: int = 16


class CaptureWriter:
    """Writes the files of one capture; made by `CaptureWriter.create`.

    Args:
        root: the capture's folder.
        manifest: what the capture is.
        coding: how images are stored.
    """

    def __init__(self, root: Path, manifest: Manifest, coding: ImageCoding) -> None:
        self.layout = Layout(root)
        self.manifest = manifest
        self.coding = coding

    @classmethod
    @contextmanager
    def create(
        cls, path: Path | str, manifest: Manifest, *, coding: ImageCoding | None = None
    ) -> Iterator[CaptureWriter]:
        """Make a capture, which appears under ``path`` as a whole when the block ends without an error.

        Args:
            path: a folder that does not exist yet.
            manifest: contents of ``capture.json``.
            coding: how images are stored.

        Raises:
            DynhairError: ``path`` exists, or the manifest is not sound.
        """
        path = Path(path)
        if path.exists():
            raise DynhairError("exists already", path=path, mend="choose another folder, or remove this one")
        if problems := manifest_problems(manifest.to_json(), path / "capture.json"):
            raise problems[0]
        with atomic_folder(path) as folder:
            yield cls(folder, manifest, coding or ImageCoding())
            write_json(folder / "capture.json", manifest.to_json())

    def write_view(self, frame: int, name: str, camera: Camera, view: View) -> None:
        """Write one camera's images of one frame, and the camera."""
        self._write_images(self.layout.frame_images(frame), name, view)
        _write_camera(self.layout.camera(frame, name), camera)

    def write_static_view(self, name: str, camera: Camera, view: View) -> None:
        """Write one view around the motionless head, and its camera."""
        self._write_images(self.layout.static_images, name, view)
        _write_camera(self.layout.static_camera(name), camera)

    def write_head(
        self,
        frame: int,
        rotation: Float[np.ndarray, "3 3"],
        translation: Float[np.ndarray, " 3"],
        expression: Float[np.ndarray, " e"],
        *,
        scale: float = 1.0,
    ) -> None:
        """Write the tracked head of one frame.

        Args:
            frame: its id.
            rotation: head-local to world.
            translation: position of the head frame's origin, metres.
            expression: coefficients.
            scale: metres per unit of the face model; kept for Gaussian Head Avatar.

        Raises:
            DynhairError: the manifest's ``expression_basis`` names another number of coefficients.
        """
        if self.manifest.expression_basis is not None:
            self.manifest.expression_basis.require_size(len(expression))
        path = _with_folder(self.layout.params(frame))
        pose = np.concatenate([Rotation.from_matrix(rotation).as_rotvec(), translation])
        np.savez(
            path,
            id_coeff=np.zeros((1, _IDENTITY_COEFFICIENTS), np.float32),
            exp_coeff=expression[None].astype(np.float32),
            scale=np.array([scale], np.float32),
            pose=pose[None].astype(np.float32),
        )

    def write_vertices(self, frame: int, vertices: Float[np.ndarray, "v 3"]) -> None:
        """Write the tracked mesh of one frame, world, metres; the array's precision is kept."""
        np.save(_with_folder(self.layout.vertices(frame)), vertices)

    def write_landmarks_3d(self, frame: int, landmarks: Float[np.ndarray, "66 3"]) -> None:
        """Write the landmarks of one frame, world, metres."""
        np.save(_with_folder(self.layout.landmarks_3d(frame)), landmarks)

    def write_landmarks_2d(self, frame: int, name: str, landmarks: Float[np.ndarray, "68 3"]) -> None:
        """Write the landmarks of one view: pixels and score."""
        np.save(_with_folder(self.layout.landmarks_2d(frame, name)), landmarks)

    def write_mesh(self, mesh: TrackedMesh) -> None:
        """Write the topology of the tracked mesh."""
        np.savez_compressed(
            self.layout.mesh,
            faces=mesh.faces.astype(np.int32),
            scalp=mesh.scalp.astype(np.int32),
            follow=mesh.follow,
            landmarks68=mesh.landmarks.astype(np.int32),
        )

    def write_ground_truth(self, segment: Segment, strands: Float[np.ndarray, "f n l 3"]) -> None:
        """Write the true strands of a segment; the array's precision is kept."""
        np.savez_compressed(_with_folder(self.layout.ground_truth(segment.name)), strands=strands)

    def _write_images(self, folder: Path, name: str, view: View) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        coding = self.coding
        rgb = Image.fromarray(_levels(view.rgb, 256))
        if coding.image_format == "jpg":
            subsampling = "4:4:4" if coding.jpeg_quality >= 90 else "4:2:0"
            path = folder / f"image_{name}.jpg"
            rgb.save(path, quality=coding.jpeg_quality, subsampling=subsampling, optimize=True)
        else:
            rgb.save(folder / f"image_{name}.png")
        _save_mask(folder / f"mask_{name}.png", view.mask, coding.mask_levels)
        if view.hair is not None:
            _save_mask(folder / f"hair_{name}.png", view.hair, coding.mask_levels)
        if view.orientation is not None and view.coherence is not None:
            pixels = encode_orientation(
                view.orientation.numpy(),
                view.coherence.numpy(),
                angle_step=coding.angle_step,
                coherence_levels=coding.coherence_levels,
            )
            _save_orientation(folder / f"orient_{name}.png", pixels)


def _save_orientation(path: Path, pixels: UInt8[np.ndarray, "h w 2"]) -> None:
    distinct, index = np.unique(pixels.reshape(-1, 2), axis=0, return_inverse=True)
    if len(distinct) > 256:
        Image.fromarray(pixels).save(path, optimize=True)
        return
    image = Image.fromarray(index.reshape(pixels.shape[:2]).astype(np.uint8))
    image.putpalette(np.repeat(distinct[:, :1], 3, 1).ravel().tolist())
    image.save(path, optimize=True, transparency=distinct[:, 1].tobytes())


def _save_mask(path: Path, mask: Float[Tensor, "h w"], levels: int) -> None:
    indices = _levels(mask, levels)
    image = Image.fromarray(indices)
    if levels <= 16:  # a palette of greys, at 4 bits a pixel or fewer
        image.putpalette([round(255 * i / (levels - 1)) for i in range(levels) for _ in "rgb"])
    elif levels < 256:
        image = image.point([min(255, round(255 * i / (levels - 1))) for i in range(256)])
    image.save(path, optimize=True)


def _levels(image: Tensor, count: int) -> np.ndarray:
    return image.clamp(0, 1).mul(count - 1).round().byte().numpy()


def _write_camera(path: Path, camera: Camera) -> None:
    np.savez(_with_folder(path), extrinsic=camera.w2c.double().numpy(), intrinsic=camera.K.double().numpy())


def _with_folder(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path
