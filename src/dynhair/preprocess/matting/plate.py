"""Matting by difference to the empty scene: a clean plate of the camera, or one background colour.

A pixel that differs from the plate by more than noise, misregistration and shadow explain belongs to the person. Specks
and holes are mended, and near the outline, alpha solves ``image = alpha * foreground + (1 - alpha) * plate`` with the
person's colour from nearby.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from dynhair.errors import DynhairError
from dynhair.preprocess.matting.networks import Matting

ROUNDING = 1 / 255
"""Least standard deviation of a camera's noise; JPEG alone makes as much."""
SURE, FAINT = 8.0, 3.0
"""Differences in standard deviations: of what is the person wherever it lies, and of what counts near the outline."""
SHIFT = 0.25
"""Misregistration that the plate's own gradients must outweigh, pixels."""
DARK = 0.1
"""Brightness of the plate below which neither exposure nor shadow can be told from it."""
GAIN_LIMIT = 1.5
"""Greatest change of exposure that is looked for, either way."""
MEASURED = 100_000
"""Pixels of which exposure and noise are measured."""
SMALLEST = 1e-3
"""Share of the image below which a speck is removed and a hole is filled."""
SEEN_THROUGH = 1.0
"""Median difference in standard deviations below which a larger hole shows the plate; others are filled as well."""
BAND = 0.015
"""Reach of soft alpha to either side of the outline, of the image's longer side; hair strays so far."""


def plate_matting(plate: UInt8[np.ndarray, "h w 3"] | Sequence[int], *, shadow: float = 0.75) -> Matting:
    """Make a matting by difference to the empty scene.

    The camera's exposure and white balance may differ from the plate's by a gain for each channel.

    Args:
        plate: image of the empty scene, or the background's colour, both sRGB 0 to 255.
        shadow: brightness that a shadow leaves at least; darker pixels of the background's hue are the person. 1 lets
            no shadow pass for background.

    Raises:
        DynhairError: neither an image nor a colour, or, from the matting, an image of another size than the plate.
    """
    scene = np.asarray(plate)
    if scene.shape[-1:] != (3,) or scene.ndim not in (1, 3):
        raise DynhairError(f"a plate of shape {scene.shape}", expected="(height, width, 3), or 3 for a colour")
    if scene.min() < 0 or scene.max() > 255:
        raise DynhairError(f"a background colour of {scene}", expected="red, green and blue from 0 to 255")
    scene = scene.astype(np.uint8)

    def matte(image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w"]:
        if scene.ndim == 3 and scene.shape != image.shape:
            (h, w), (rows, columns) = image.shape[:2], scene.shape[:2]
            raise DynhairError(
                f"the plate is {columns} x {rows}, the image {w} x {h}", mend="give a plate taken by the same camera"
            )
        background = np.broadcast_to(scene, image.shape) / np.float32(255)
        return np.rint(255 * plate_alpha(image / np.float32(255), background, shadow)).astype(np.uint8)

    return matte


def plate_alpha(
    image: Float[np.ndarray, "h w 3"], background: Float[np.ndarray, "h w 3"], shadow: float
) -> Float[np.ndarray, "h w"]:
    """Compute alpha of what stands before a background, both in [0, 1]."""
    step = max(1, round(np.sqrt(image.shape[0] * image.shape[1] / MEASURED)))
    background = background * exposure_gain(image[::step, ::step], background[::step, ::step])
    difference = image - background
    noise = noise_level(difference[::step])
    tolerance = np.sqrt(noise**2 + (SHIFT * _gradient(background)) ** 2)

    distance = _length(cv2.GaussianBlur(difference, (0, 0), 0.7)) / tolerance
    apart = (distance > SURE) & ~_is_shadow(image, background, SURE * tolerance, shadow)
    person = fill_holes(remove_specks(apart), distance)
    if not person.any():
        return np.zeros(image.shape[:2], np.float32)

    reach = max(4, round(BAND * max(image.shape[:2])))
    core = cv2.distanceTransform(person.astype(np.uint8), cv2.DIST_L2, 5) > reach
    near = cv2.distanceTransform((~person).astype(np.uint8), cv2.DIST_L2, 5) <= reach
    alpha = _solve(difference, background, tolerance, core, person, reach)
    alpha[(distance < FAINT) | ~near] = 0
    alpha[core] = 1
    return alpha


def _solve(
    difference: np.ndarray,
    background: np.ndarray,
    tolerance: np.ndarray,
    core: np.ndarray,
    person: np.ndarray,
    reach: int,
) -> np.ndarray:
    """Solve for alpha with the person's colour from nearby, and its own spread taken for full coverage."""
    weight = np.where(core, 1, np.where(person, 1e-2, 0)).astype(np.float32)  # the outline, where nothing else is near
    window = (4 * reach + 1, 4 * reach + 1)
    total = cv2.blur(weight, window) + np.float32(1e-6)

    def nearby(values: np.ndarray) -> np.ndarray:
        return cv2.blur(weight[..., None] * values, window).reshape(values.shape) / total[..., None]

    contrast = nearby(difference + background) - background
    squared = _dot(contrast, contrast)
    alpha = (_dot(difference, contrast) / np.maximum(squared, np.finfo(np.float32).tiny))[..., None]
    bounded = np.clip(alpha, 0, 2)
    spread = np.sqrt(np.maximum(nearby(bounded**2) - nearby(bounded) ** 2, 0))
    full = np.clip(1 - spread, 0.3, 1)
    same = np.sqrt(squared) < SURE * tolerance  # a person of the background's colour: nothing to solve
    return np.where(same, person, np.clip(alpha / full, 0, 1)[..., 0]).astype(np.float32)


def exposure_gain(image: Float[np.ndarray, "h w 3"], background: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "3"]:
    """Estimate each channel's gain from plate to image: the mode of their ratio, which a person does not shift."""
    gains = np.ones(3, np.float32)
    for channel in range(3):
        lit = background[..., channel] > DARK
        ratio = np.log(np.maximum(image[..., channel][lit], ROUNDING) / background[..., channel][lit])
        limit = np.log(GAIN_LIMIT)
        counts, edges = np.histogram(ratio, 121, (-limit, limit))
        smooth = np.convolve(counts, np.hanning(9), "same")
        if smooth.max() == 0:
            continue  # too dark a plate
        peak = edges[smooth.argmax()] + 0.5 * (edges[1] - edges[0])
        close = ratio[np.abs(ratio - peak) < 0.05]
        gains[channel] = np.exp(np.median(close))
    return gains


def noise_level(difference: Float[np.ndarray, "h w 3"]) -> float:
    """Estimate the noise's standard deviation, all channels together, from the difference between neighbouring pixels.

    Only those that change little count: a person's texture and outline do not.
    """
    steps = np.abs(np.diff(difference, axis=1))
    quarter = float(np.quantile(steps, 0.25)) if steps.size else 0.0
    return max(ROUNDING, quarter / 0.4506) * np.sqrt(3)  # the quartile of |a - b| is 0.4506 standard deviations


def remove_specks(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Remove connected pieces smaller than :data:`SMALLEST`."""
    labels, areas = _pieces(mask, connectivity=8)
    keep = areas >= SMALLEST * mask.size
    keep[0] = False
    return keep[labels]


def fill_holes(mask: Bool[np.ndarray, "h w"], distance: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Fill holes that are smaller than :data:`SMALLEST` or do not show the plate; what reaches the border is none.

    Args:
        mask: of the person.
        distance: of each pixel from the plate, standard deviations.
    """
    labels, areas = _pieces(~mask, connectivity=4)
    hole = np.ones(len(areas), bool)
    hole[np.concatenate([[0], labels[0], labels[-1], labels[:, 0], labels[:, -1]])] = False
    for label in np.flatnonzero(hole & (areas >= SMALLEST * mask.size)):
        hole[label] = np.median(distance[labels == label]) > SEEN_THROUGH
    return mask | hole[labels]


def _pieces(mask: np.ndarray, connectivity: int) -> tuple[np.ndarray, np.ndarray]:
    """Label connected pieces from 1 on, with the areas of all labels; 0 is the rest."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=connectivity)
    return np.asarray(labels, np.intp), np.asarray(stats)[:, cv2.CC_STAT_AREA]


def _is_shadow(image: np.ndarray, background: np.ndarray, tolerance: np.ndarray, least: float) -> np.ndarray:
    """Find pixels that are a darkened background, to within a tolerance."""
    squared = _dot(background, background)
    left = _dot(image, background) / np.maximum(squared, np.finfo(np.float32).tiny)
    off = _length(image - left[..., None] * background)
    return (left >= least) & (left < 1) & (off < 0.5 * tolerance) & (squared > 3 * DARK**2)


def _gradient(image: np.ndarray) -> np.ndarray:
    """Length of the gradient of all channels together, per pixel."""
    across, down = cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(image, cv2.CV_32F, 0, 1, scale=1 / 8)
    return np.sqrt(_dot(across, across) + _dot(down, down))


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(_dot(vectors, vectors))


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("hwc,hwc->hw", a, b)
