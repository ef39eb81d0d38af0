"""Finding faces in images: BlazeFace (Bazarevsky et al., 2019) on a pyramid of windows.

The network looks at 128 x 128 pixels and finds faces that fill a fair part of them, so it is shown ever smaller windows
of the image until there is a face in one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from scipy.special import expit

from dynhair.preprocess.landmarks.square import FaceSquare

INPUT_SIZE = 128
BOXES = 896

_GRIDS = ((16, 2), (8, 6))  # cells a side, boxes a cell
_KEYPOINTS = 6
_MARGIN = 1.5
_MIN_SCORE = 0.5
_MAX_OVERLAP = 0.3
_SHRINK = np.sqrt(0.5)  # from one level of windows to the next
_LEVELS = 5

Detector = Callable[[Float[np.ndarray, "128 128 3"]], tuple[Float[np.ndarray, "896 16"], Float[np.ndarray, " 896"]]]
"""The network: an image in [-1, 1] to boxes with keypoints, in its pixels relative to their cells, and logits."""


@dataclass(frozen=True)
class FaceBox:
    """A face that was found.

    Attributes:
        score: confidence in [0, 1].
        centre: of the box, in pixels.
        size: width and height of the box in pixels.
        keypoints: the person's right eye, left eye, tip of the nose, mouth, right ear and left ear, in pixels.
    """

    score: float
    centre: Float[np.ndarray, "2"]
    size: Float[np.ndarray, "2"]
    keypoints: Float[np.ndarray, "6 2"]

    @property
    def square(self) -> FaceSquare:
        """The square that landmarks are looked for in: the box with a margin, turned by the eyes."""
        across = self.keypoints[1] - self.keypoints[0]
        x, y = self.centre
        angle = float(np.arctan2(across[1], across[0]))
        return FaceSquare((float(x), float(y)), _MARGIN * float(self.size.max()), angle)


def search_faces(detector: Detector, image: UInt8[np.ndarray, "h w 3"]) -> Iterator[FaceBox]:
    """Faces of an image: those that show in large windows first, and in windows of one size the surest first."""
    height, width = image.shape[:2]
    for windows in search_windows(width, height):
        boxes = [box for window in windows for box in _detect(detector, image, window)]
        yield from suppress_overlaps(boxes)


def search_windows(width: int, height: int) -> Iterator[list[FaceSquare]]:
    """Squares that cover an image and overlap by half or more: for each size, from the whole image to a quarter."""
    side = float(max(width, height))
    for _ in range(_LEVELS):
        yield [FaceSquare((x, y), side) for y in _centres(height, side) for x in _centres(width, side)]
        side *= _SHRINK


def decode_boxes(
    regressors: Float[np.ndarray, "896 16"], logits: Float[np.ndarray, " 896"], window: FaceSquare
) -> list[FaceBox]:
    """The faces in the network's answer, in the image's pixels; overlapping ones are all there.

    Args:
        regressors: centre, size and six keypoints of each box in the network's pixels, all but the size relative to the
            centre of the box's cell.
        logits: of the boxes' scores.
        window: what the network was shown.
    """
    scores = expit(logits)
    sure = np.flatnonzero(scores >= _MIN_SCORE)
    numbers = regressors[sure].reshape(-1, 2 + _KEYPOINTS, 2) / INPUT_SIZE
    cells = _CELLS[sure, None]
    centres = window.to_image(numbers[:, :1] + cells)[:, 0]
    keypoints = window.to_image(numbers[:, 2:] + cells)
    sizes = numbers[:, 1] * window.side
    return [FaceBox(float(scores[i]), *row) for i, *row in zip(sure, centres, sizes, keypoints, strict=True)]


def suppress_overlaps(boxes: Iterable[FaceBox]) -> list[FaceBox]:
    """One box for each face, surest first: those that overlap it are averaged into it, weighted by their scores."""
    left = sorted(boxes, key=lambda box: -box.score)
    kept = []
    while left:
        best = left[0]
        same = [box for box in left if box is best or overlap(box, best) > _MAX_OVERLAP]
        left = [box for box in left if not any(box is other for other in same)]
        kept.append(_average(best.score, same))
    return kept


def overlap(one: FaceBox, other: FaceBox) -> float:
    """Area of the boxes' intersection over that of their union."""
    low = np.maximum(one.centre - one.size / 2, other.centre - other.size / 2)
    high = np.minimum(one.centre + one.size / 2, other.centre + other.size / 2)
    shared = float(np.prod(np.maximum(high - low, 0)))
    return shared / (float(np.prod(one.size) + np.prod(other.size)) - shared)


def _detect(detector: Detector, image: UInt8[np.ndarray, "h w 3"], window: FaceSquare) -> list[FaceBox]:
    shown = window.crop(image, INPUT_SIZE).astype(np.float32) / 127.5 - 1
    return decode_boxes(*detector(shown), window)


def _average(score: float, boxes: Sequence[FaceBox]) -> FaceBox:
    weights = np.array([box.score for box in boxes])
    weights /= weights.sum()
    return FaceBox(
        score,
        weights @ np.array([box.centre for box in boxes]),
        weights @ np.array([box.size for box in boxes]),
        np.tensordot(weights, np.array([box.keypoints for box in boxes]), axes=1),
    )


def _centres(length: int, side: float) -> list[float]:
    gaps = int(np.ceil(max(length - side, 0) / (side / 2)))
    return np.linspace(side / 2, length - side / 2, gaps + 1).tolist() if gaps else [length / 2]


def _cells() -> Float[np.ndarray, "896 2"]:
    """Centres of the boxes' cells in the unit square, row by row, several boxes in each."""
    centres = []
    for count, repeats in _GRIDS:
        steps = (np.arange(count) + 0.5) / count
        grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
        centres.append(np.repeat(grid, repeats, axis=0))
    return np.concatenate(centres)


_CELLS = _cells()
