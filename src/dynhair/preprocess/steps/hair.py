"""The hair's mask in every view."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from dynhair.assets import asset_path
from dynhair.errors import DynhairError
from dynhair.pictures import Picture
from dynhair.preprocess.hair import (
    FaceParser,
    HairClassifier,
    HairTeacher,
    PaintedView,
    TeachingView,
    network_hair,
    read_hair_mask,
)
from dynhair.preprocess.jobs import Job
from dynhair.preprocess.landmarks import load_landmarks
from dynhair.preprocess.options import PreprocessOptions
from dynhair.preprocess.sheets import tinted
from dynhair.preprocess.steps.step import Step
from dynhair.preprocess.workspace import ViewId, Workspace

_COLOUR = (255, 90, 200)
_CANDIDATES = 400
"""Views among which those that teach are looked for."""
_GOLDEN = (5**0.5 - 1) / 2


class TeachingStep(Step[None]):
    """Teaches the capture's own hair classifier. Only frames that train teach, and the static ring.

    Args:
        workspace: with masks and landmarks.
        options: where painted examples are.

    Raises:
        DynhairError: an example's name is not that of a view.
    """

    name, title = "hair-teaching", "Learning this hair"

    def __init__(self, workspace: Workspace, options: PreprocessOptions) -> None:
        super().__init__(workspace)
        self._examples = dict(_examples(workspace, options.hair_examples))

    def settings(self) -> Mapping[str, Any]:
        return {"network": asset_path("bisenet-celebamask").name, "examples": [str(p) for p in self._examples.values()]}

    def jobs(self) -> Sequence[Job[None]]:
        space = self.workspace
        inputs = [
            path
            for view in (*self._candidates(), *self._examples)
            for path in (space.image_path(view), space.image_path(view, "mask"), space.landmarks_path(view))
        ]
        return [Job(None, (*inputs, *self._examples.values()), (classifier_path(space),))]

    def worker(self) -> Callable[[None], None]:
        def work(_: None) -> None:
            space = self.workspace
            examples = [
                PaintedView(space.image(view), space.mask(view), _fitted(read_hair_mask(path), space, path))
                for view, path in self._examples.items()
            ]
            teacher = HairTeacher(FaceParser(asset_path("bisenet-celebamask")))
            classifier = teacher.teach(self._samples(), examples=examples, progress=self.advance)
            classifier.save(classifier_path(space))

        return work

    def _candidates(self) -> list[ViewId]:
        """Views that may teach, in an order of which every beginning is spread over time and cameras."""
        manifest = self.workspace.manifest
        test = {frame for segment in manifest.segments if segment.split == "test" for frame in segment.frames}
        views = [view for view in self.workspace.views if view.frame not in test]
        spread = sorted(range(len(views)), key=lambda i: (i + 0.5) * _GOLDEN % 1)[:_CANDIDATES]
        return [views[i] for i in spread]

    def _samples(self) -> Iterator[TeachingView]:
        for view in self._candidates():
            face = load_landmarks(self.workspace.landmarks_path(view))
            if face is not None:
                image, mask = self.workspace.image(view), self.workspace.mask(view)
                yield TeachingView(image, mask, face.square, face.score, face.points)


class HairStep(Step[ViewId]):
    """Writes ``hair_*.png``.

    Args:
        workspace: with masks and landmarks; a classifier, if hair is told by one.
        options: the method, and what it needs.

    Raises:
        DynhairError: masks were to be given, and one is missing.
    """

    name, title = "hair", "Hair masks"

    def __init__(self, workspace: Workspace, options: PreprocessOptions) -> None:
        super().__init__(workspace)
        self._options = options
        self.method = self._method()

    def settings(self) -> Mapping[str, Any]:
        network = asset_path("bisenet-celebamask").name if self.method == "network" else None
        folder = self._options.hair_masks
        return {
            "method": self.method,
            "network": network,
            "masks": None if folder is None else str(folder.resolve()),
            "label": self._options.hair_label,
        }

    def jobs(self) -> Sequence[Job[ViewId]]:
        space = self.workspace

        def inputs(view: ViewId) -> tuple[Path, ...]:
            if self.method == "given":
                return (self._given(view),)
            seen = (space.image_path(view), space.image_path(view, "mask"))
            return (*seen, classifier_path(space) if self.method == "taught" else space.landmarks_path(view))

        raw = self._options.steady
        return [Job(view, inputs(view), (space.mask_path(view, "hair", raw=raw),)) for view in space.views]

    def worker(self) -> Callable[[ViewId], None]:
        space = self.workspace
        tell = self._teller()

        def work(view: ViewId) -> None:
            space.write_mask(view, "hair", tell(view), raw=self._options.steady)

        return work

    def picture(self, view: ViewId) -> Picture:
        return tinted(self.workspace.image(view), self.workspace.mask(view, "hair"), _COLOUR)

    def _teller(self) -> Callable[[ViewId], UInt8[np.ndarray, "h w"]]:
        space = self.workspace
        if self.method == "given":
            label = self._options.hair_label
            return lambda view: _fitted(read_hair_mask(self._given(view), label), space, self._given(view))
        if self.method == "taught":
            classifier = HairClassifier.load(classifier_path(space))
            return lambda view: classifier(space.image(view), space.mask(view))
        parser = FaceParser(asset_path("bisenet-celebamask"))

        def by_network(view: ViewId) -> UInt8[np.ndarray, "h w"]:
            face, mask = load_landmarks(space.landmarks_path(view)), space.mask(view)
            if face is None:
                return np.zeros_like(mask)
            return np.minimum(network_hair(parser, space.image(view), face.square), mask)

        return by_network

    def _method(self) -> str:
        wanted, views = self._options.hair, self.workspace.views
        has_all = self._options.hair_masks is not None or all(self._given(view).exists() for view in views)
        if wanted == "auto":
            wanted = "given" if has_all else "taught"
        if wanted == "given":
            missing = next((self._given(view) for view in views if not self._given(view).exists()), None)
            if missing is not None:
                raise DynhairError(
                    "the hair mask is missing",
                    path=missing,
                    expected="a mask for every view: FRAME/CAMERA.png, and static360/VIEW.png for static views",
                    mend="add it, or let the hair be taught",
                )
        return wanted

    def _given(self, view: ViewId) -> Path:
        folder = self._options.hair_masks
        return self.workspace.given_path(view, "hair") if folder is None else folder / view.folder / f"{view.name}.png"


def classifier_path(workspace: Workspace) -> Path:
    """Where the capture's own hair classifier is kept."""
    return workspace.folder / "hair" / "classifier.safetensors"


def _examples(workspace: Workspace, folder: Path | None) -> Iterator[tuple[ViewId, Path]]:
    if folder is None:
        return
    known = {f"{view.folder}_{view.name}": view for view in workspace.views}
    for path in sorted(folder.glob("*.png")):
        if path.stem not in known:
            raise DynhairError(
                "is not named after a view",
                path=path,
                expected="FRAME_CAMERA.png, such as " + next(iter(known)) + ".png",
            )
        yield known[path.stem], path


def _fitted(mask: UInt8[np.ndarray, "h w"], workspace: Workspace, path: Path) -> UInt8[np.ndarray, "h w"]:
    """A mask in the images' size; one made at another resolution is resized."""
    width, height = workspace.manifest.image_size
    if mask.shape == (height, width):
        return mask
    rows, columns = mask.shape
    if abs(rows * width - columns * height) > max(rows, columns, width, height):
        raise DynhairError(
            f"is {columns} x {rows} pixels",
            path=path,
            expected=f"{width} x {height}, or the same shape at another resolution",
        )
    shrinks = rows > height
    return cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR).astype(
        np.uint8
    )
