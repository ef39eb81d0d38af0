"""Where the files of a capture are, and what a folder without ``capture.json`` can be taken for.

The layout is that of Gaussian Head Avatar, with hair masks, orientation maps, landmarks, a static ring of views and
ground truth beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from dynhair.capture.arrays import read_npz
from dynhair.capture.encoding import read_size
from dynhair.capture.expression_basis import ExpressionBasis
from dynhair.capture.manifest import Manifest
from dynhair.capture.records import Segment
from dynhair.errors import DynhairError

EXTENSIONS = (".jpg", ".png", ".jpeg")
DEFAULT_FPS = 25.0
"""A guess: a folder prepared for Gaussian Head Avatar does not say its frame rate."""
_GAUSSIAN_HEAD_AVATAR_EXPRESSIONS = 64
"""Of the Basel Face Model, as Gaussian Head Avatar's captures have them."""


@dataclass(frozen=True)
class Layout:
    """Paths below one capture's root.

    Attributes:
        root: the capture's folder.
        lowres: use the ``image_lowres_*`` and ``mask_lowres_*`` files.
    """

    root: Path
    lowres: bool = False

    @property
    def manifest(self) -> Path:
        return self.root / "capture.json"

    @property
    def mesh(self) -> Path:
        return self.root / "mesh.npz"

    @property
    def images(self) -> Path:
        return self.root / "images"

    @property
    def static_images(self) -> Path:
        return self.root / "static360" / "images"

    def frame_images(self, frame: int) -> Path:
        return self.images / f"{frame:04d}"

    def camera(self, frame: int, name: str) -> Path:
        return self.root / "cameras" / f"{frame:04d}" / f"camera_{name}.npz"

    def static_camera(self, name: str) -> Path:
        return self.root / "static360" / "cameras" / f"camera_{name}.npz"

    def params(self, frame: int) -> Path:
        return self.root / "params" / f"{frame:04d}" / "params.npz"

    def vertices(self, frame: int) -> Path:
        return self.root / "params" / f"{frame:04d}" / "vertices.npy"

    def landmarks_3d(self, frame: int) -> Path:
        return self.root / "params" / f"{frame:04d}" / "lmk_3d.npy"

    def landmarks_2d(self, frame: int, name: str) -> Path:
        return self.root / "landmarks" / f"{frame:04d}" / f"lmk_{name}.npy"

    def ground_truth(self, segment: str) -> Path:
        return self.root / "gt" / f"{segment}.npz"

    def find_image(self, folder: Path, kind: str, name: str) -> Path | None:
        """Find the file of one map (``image``, ``mask``, ``hair``, ``orient``) of one view, whichever its extension."""
        stem = f"{kind}_lowres_{name}" if self.lowres else f"{kind}_{name}"
        for extension in EXTENSIONS:
            path = folder / (stem + extension)
            if path.is_file():
                return path
        return None

    def has_any(self, kind: str) -> bool:
        """Whether any frame or static view of the capture has a map of this kind."""
        folders = [self.static_images, *(self.images / f"{frame:04d}" for frame in frame_ids(self.images))]
        return any(True for folder in folders for _ in view_names(folder, kind, lowres=self.lowres))


def frame_ids(folder: Path) -> list[int]:
    """List the frames that have a folder in ``folder``, sorted."""
    if not folder.is_dir():
        return []
    return sorted(int(entry.name) for entry in folder.iterdir() if entry.name.isdecimal() and entry.is_dir())


def consecutive_runs(frames: Sequence[int]) -> list[list[int]]:
    """Split sorted frame ids where they leave gaps."""
    return [[frame for _, frame in run] for _, run in groupby(enumerate(frames), key=lambda item: item[1] - item[0])]


def view_names(folder: Path, kind: str = "image", *, lowres: bool = False) -> Iterator[str]:
    """Yield the names of the views in ``folder`` that have a map of this kind, in no particular order."""
    if not folder.is_dir():
        return
    prefix = f"{kind}_lowres_" if lowres else f"{kind}_"
    for entry in folder.iterdir():
        if entry.suffix.lower() in EXTENSIONS and entry.stem.startswith(prefix):
            name = entry.stem.removeprefix(prefix)
            if lowres or not name.startswith("lowres_"):
                yield name


def guess_manifest(layout: Layout) -> Manifest:
    """Guess what a folder without ``capture.json`` holds.

    Every frame trains; frames whose ids leave gaps are several segments. The rate is 25 frames a second. The images are
    taken to show their own background, as those of Gaussian Head Avatar do; 64 expression coefficients are taken to be
    those of its face model.

    Raises:
        DynhairError: there are no frames or no images in it.
    """
    frames = frame_ids(layout.images)
    names = sorted(view_names(layout.frame_images(frames[0]))) if frames else []
    if not names:
        raise DynhairError(
            "neither capture.json nor images/0000/image_*.jpg is there",
            path=layout.root,
            expected="the folder of a capture, or of a subject prepared for Gaussian Head Avatar",
            mend="give the folder that holds images/, cameras/ and params/",
        )
    native = Layout(layout.root)
    first = native.find_image(layout.frame_images(frames[0]), "image", names[0])
    assert first is not None, "its name was listed"
    runs = consecutive_runs(frames)
    labels = ["all"] if len(runs) == 1 else [f"all-{i + 1}" for i in range(len(runs))]
    return Manifest(
        fps=DEFAULT_FPS,
        image_size=read_size(first),
        camera_names=tuple(names),
        segments=tuple(Segment(label, run[0], len(run), "train") for label, run in zip(labels, runs, strict=True)),
        background=None,
        expression_basis=_guess_expression_basis(layout.params(frames[0])),
    )


def _guess_expression_basis(params: Path) -> ExpressionBasis | None:
    try:
        count = read_npz(params, {"exp_coeff": (1, None)})["exp_coeff"].shape[1]
    except DynhairError:  # raised again by whoever needs the head's pose
        return None
    return ExpressionBasis("BFM 2009") if count == _GAUSSIAN_HEAD_AVATAR_EXPRESSIONS else None
