"""The matting by difference, on persons composed onto scenes with known alpha."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.preprocess.matting import plate_matting
from dynhair.preprocess.matting.plate import exposure_gain, fill_holes, noise_level, remove_specks

SIZE = 160


def person(softness: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """A mottled figure reaching the lower border: colour and alpha, soft at the edge."""
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    head = np.hypot(x - 80, y - 60) - 34
    body = np.hypot((x - 80) * 0.8, y - 190) - 90
    alpha = np.clip(0.5 - np.minimum(head, body) / softness, 0, 1)
    mottled = cv2.GaussianBlur(np.random.default_rng(3).normal(0, 40, (SIZE, SIZE)), (0, 0), 2)
    colour = np.where((y < 95)[..., None], (150, 100, 80), (60, 80, 140)) + mottled[..., None]
    return colour, alpha


def scene(kind: str) -> np.ndarray:
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    match kind:
        case "green":
            return np.stack([30 + 0 * x, 170 + x / 8, 60 + 0 * x], -1)
        case "white":
            return np.stack([225 - y / 8] * 3, -1)
        case "black":
            return np.zeros((SIZE, SIZE, 3))
    texture = cv2.GaussianBlur(np.random.default_rng(7).normal(0, 90, (SIZE, SIZE, 3)), (0, 0), 2)
    return np.stack([190 + 0 * x, 160 - x / 5, 190 - y / 5], -1) + texture


def shot(colours: np.ndarray, noise: float = 2.0, seed: int = 0) -> np.ndarray:
    noisy = colours + np.random.default_rng(seed).normal(0, noise, colours.shape)
    return np.rint(np.clip(noisy, 0, 255)).astype(np.uint8)


def composed(kind: str, alpha: np.ndarray, colour: np.ndarray) -> np.ndarray:
    return alpha[..., None] * colour + (1 - alpha[..., None]) * scene(kind)


def error(matte: np.ndarray, alpha: np.ndarray) -> float:
    return float(np.abs(matte / 255.0 - alpha).mean())


@pytest.mark.parametrize("kind", ["green", "white", "black", "texture"])
@pytest.mark.parametrize("gain", [(1.0, 1.0, 1.0), (1.15, 1.1, 1.12), (0.85, 0.9, 0.88)])
def test_the_person_is_found_under_noise_and_other_exposure(kind: str, gain: tuple[float, float, float]) -> None:
    colour, alpha = person()
    matting = plate_matting(shot(scene(kind), seed=1))
    matte = matting(shot(composed(kind, alpha, colour) * gain, seed=2))
    assert error(matte, alpha) < 0.01
    assert (matte[alpha == 0] == 0).mean() > 0.99
    assert (matte[alpha == 1] == 255).mean() > 0.97


def test_a_colour_is_a_plate() -> None:
    colour, alpha = person()
    image = alpha[..., None] * colour + (1 - alpha[..., None]) * np.array((20.0, 180.0, 60.0))
    assert error(plate_matting((20, 180, 60))(shot(image)), alpha) < 0.01


def test_edges_are_soft() -> None:
    _, alpha = person(softness=6)
    image = composed("green", alpha, np.full((SIZE, SIZE, 3), (150.0, 90.0, 90.0)))
    matte = plate_matting(shot(scene("green"), 1.0))(shot(image, 1.0)) / 255.0
    edge = (alpha > 0.15) & (alpha < 0.85)
    assert np.corrcoef(matte[edge], alpha[edge])[0, 1] > 0.95
    assert np.abs(matte - alpha)[edge].mean() < 0.12
    assert ((matte > 0.15) & (matte < 0.85)).sum() > 0.6 * edge.sum()


def test_what_looks_like_the_plate_inside_the_person_is_filled_and_specks_are_removed() -> None:
    colour, alpha = person()
    image = composed("green", alpha, colour)
    image[55:59, 70:74] = scene("green")[55:59, 70:74]  # a button of the wall's colour
    image[112:142, 60:90] = scene("green")[112:142, 60:90] + np.array((10, -10, 8))  # a badge of nearly that colour
    image[20:24, 8:12] = 255  # dust
    matte = plate_matting(shot(scene("green"), seed=1))(shot(image))
    assert (matte[54:60, 69:75] == 255).all()
    assert (matte[114:140, 62:88] == 255).all()
    assert (matte[15:30, 3:17] == 0).all()


def test_a_gap_through_which_the_plate_shows_stays() -> None:
    colour, alpha = person()
    alpha[105:135, 70:95] = 0
    matte = plate_matting(shot(scene("texture"), seed=1))(shot(composed("texture", alpha, colour)))
    assert (matte[110:130, 75:90] == 0).all()


def test_a_soft_shadow_is_background() -> None:
    colour, alpha = person()
    y, x = np.mgrid[:SIZE, :SIZE]
    lit = 1 - 0.2 * np.exp(-((np.hypot(x - 20, y - 110) / 22) ** 4))
    image = alpha[..., None] * colour + (1 - alpha[..., None]) * lit[..., None] * scene("white")
    plate = shot(scene("white"), seed=1)
    assert error(plate_matting(plate)(shot(image)), alpha) < 0.015
    assert error(plate_matting(plate, shadow=1.0)(shot(image)), alpha) > 0.03


@pytest.mark.parametrize("kind", ["green", "black", "texture"])
def test_an_empty_scene_has_nobody(kind: str) -> None:
    matting = plate_matting(shot(scene(kind), seed=1))
    assert not matting(shot(scene(kind) * 1.1, seed=2)).any()


@given(st.floats(0.75, 1.3), st.floats(0.75, 1.3), st.integers(0, 10**6))
def test_gains_are_found_behind_a_person(red: float, blue: float, seed: int) -> None:
    colour, alpha = person()
    gain = np.array([red, 1.0, blue])
    image = shot(composed("white", alpha, colour) / 1.4 * gain, seed=seed)
    plate = shot(scene("white") / 1.4, seed=seed + 1)
    np.testing.assert_allclose(exposure_gain(image / 255.0, plate / 255.0), gain, atol=0.01)


@pytest.mark.parametrize("noise", [3.0, 6.0])
def test_noise_is_measured_beside_a_person(noise: float) -> None:
    colour, alpha = person()
    flat = np.full((SIZE, SIZE, 3), 120.0)
    difference = shot(alpha[..., None] * colour + (1 - alpha[..., None]) * flat, noise) / 255.0 - flat / 255
    assert noise_level(difference) == pytest.approx(np.sqrt(3) * noise / 255, rel=0.3)


def test_specks_and_holes_by_size() -> None:
    mask = np.zeros((100, 100), bool)
    mask[10:60, 10:60] = True
    mask[80:82, 80:82] = True  # below a thousandth of the image
    mask[90:95, 90:95] = True
    mask[20:22, 20:22] = False
    mask[30:40, 30:40] = mask[45:55, 45:55] = False
    far = np.full(mask.shape, 0.2)
    far[30:40, 30:40] = 5.0  # not the plate
    cleaned = fill_holes(remove_specks(mask), far)
    assert not cleaned[80:82, 80:82].any()
    assert cleaned[90:95, 90:95].all()
    assert cleaned[20:22, 20:22].all()
    assert cleaned[30:40, 30:40].all()
    assert not cleaned[45:55, 45:55].any()


def test_plates_that_do_not_fit_are_refused() -> None:
    image = np.zeros((4, 5, 3), np.uint8)
    with pytest.raises(DynhairError, match="6 x 4, the image 5 x 4"):
        plate_matting(np.zeros((4, 6, 3), np.uint8))(image)
    with pytest.raises(DynhairError, match="plate of shape"):
        plate_matting((1, 2))
    with pytest.raises(DynhairError, match="0 to 255"):
        plate_matting((0, 0, 256))
