"""People drawn with three textures, and a parser that tells them apart by their known colours."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dynhair.preprocess.hair import FaceParse, FaceParser, TeachingView
from dynhair.preprocess.hair.parser import crop_to_image, sample_crop
from dynhair.preprocess.landmarks.square import FaceSquare

SIZE = 128
HAIR, SKIN, CLOTHES = (70, 50, 35), (205, 160, 140), (60, 90, 160)
_CLASS_OF_COLOUR = ((HAIR, 17), (SKIN, 1), (CLOTHES, 16), ((0, 0, 0), 0))


@dataclass(frozen=True)
class Person:
    image: np.ndarray
    mask: np.ndarray
    hair: np.ndarray
    square: FaceSquare

    @property
    def view(self) -> TeachingView:
        return TeachingView(self.image, self.mask, self.square, score=1.0)


def draw_person(seed: int, *, from_behind: bool = False) -> Person:
    """Hair around a face and down to the shoulders; nothing but hair and clothes if seen from behind."""
    rng = np.random.default_rng(seed)
    x, y = 64 + rng.integers(-8, 9), 48 + rng.integers(-4, 5)
    parts = np.zeros((SIZE, SIZE), np.uint8)
    cv2.ellipse(parts, (int(x), SIZE), (50, 40), 0, 0, 360, 3, -1)
    if not from_behind:
        cv2.rectangle(parts, (int(x) - 8, int(y)), (int(x) + 8, int(y) + 48), 2, -1)
    cv2.ellipse(parts, (int(x), int(y)), (28, 34), 0, 0, 360, 1, -1)
    for side in (-1, 1):
        lock = [(x + side * 27, y), (x + side * 12, y), (x + side * 14, y + 55), (x + side * 30, y + 60)]
        cv2.fillPoly(parts, [np.array(lock, np.int32)], 1)
    if not from_behind:
        cv2.ellipse(parts, (int(x), int(y) + 4), (17, 24), 0, 0, 360, 2, -1)
    strands = np.repeat(rng.normal(0, 14, (1, SIZE)), SIZE, axis=0) + rng.normal(0, 6, (SIZE, SIZE))
    stripes = 12 * np.sign(np.sin(np.arange(SIZE) * 0.8))[:, None] + rng.normal(0, 3, (SIZE, SIZE))
    smooth = rng.normal(0, 3, (SIZE, SIZE))
    image = np.zeros((SIZE, SIZE, 3))
    for part, (colour, texture) in enumerate(((HAIR, strands), (SKIN, smooth), (CLOTHES, stripes)), start=1):
        image = np.where((parts == part)[..., None], np.asarray(colour) + texture[..., None], image)
    pixels = np.clip(image, 0, 255).astype(np.uint8)
    mask = np.where(parts > 0, 255, 0).astype(np.uint8)
    return Person(pixels, mask, parts == 1, FaceSquare((float(x), float(y) + 4), 60.0, 0.0))


class ColourParser(FaceParser):
    """Names every pixel of the crop by the nearest of the colours drawn with; finds a face in every crop or in none."""

    def __init__(self, sees_faces: bool = True) -> None:
        self.sees_faces = sees_faces

    def parse(self, image: np.ndarray, square: FaceSquare, *, scale: float = 1.35, mirrored: bool = False) -> FaceParse:
        grid = 64
        to_image = crop_to_image(square, scale, grid, mirrored)
        crop = sample_crop(image, to_image, grid).astype(np.float64)
        colours = np.array([colour for colour, _ in _CLASS_OF_COLOUR], np.float64)
        nearest = np.linalg.norm(crop[..., None, :] - colours, axis=-1).argmin(axis=-1)
        labels = np.array([label for _, label in _CLASS_OF_COLOUR])[nearest]
        if self.sees_faces:
            labels[32, 30], labels[34, 32], labels[36, 32] = 4, 10, 12
        return FaceParse(np.moveaxis(np.eye(19, dtype=np.float32)[labels], -1, 0).copy(), to_image)
