"""Training patches, half of them pasted together from two views so that their edges are known to the pixel.

A face parser's labels stop a few pixels before the hair does, and always show hair beside a face. Pasting hair over
skin or clothes (or those over hair) along streaks as thin as locks gives exact coverage at the edges, and hair in any
company.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from dynhair.preprocess.hair.classifier import blank_background
from dynhair.preprocess.hair.labels import HAIR, UNKNOWN

SIDE = 96
"""Of a patch, pixels."""
PASTED = 0.5
"""Share of the patches that are pasted together."""
PLACES = 4096
"""Pixels of a kind and a view that patches are drawn around, at most."""
_TILT, _ZOOM = 0.6, 0.35
_STREAK_ACROSS, _STREAK_ALONG = (1.5, 24.0), (20.0, 80.0)


@dataclass(frozen=True)
class LabelledView:
    """A view, its coverage by the body and its pixels' labels."""

    image: UInt8[np.ndarray, "h w 3"]
    mask: UInt8[np.ndarray, "h w"]
    labels: UInt8[np.ndarray, "h w"]


class PatchSource:
    """Draws patches around labelled pixels, hair as often as everything else together.

    Args:
        views: to draw from.
        rng: what draws.
    """

    def __init__(self, views: list[LabelledView], rng: np.random.Generator) -> None:
        self._views, self._rng = views, rng
        kinds = sorted({int(kind) for view in views for kind in np.unique(view.labels)} - {UNKNOWN})
        self._places = {
            kind: [(view, places) for view in views if len(places := self._some_places(view, kind))] for kind in kinds
        }
        self._others = [kind for kind in kinds if kind != HAIR]

    @property
    def teaches(self) -> bool:
        """Whether there are both hair and something else to draw."""
        return HAIR in self._places and bool(self._others)

    def batch(
        self, count: int
    ) -> tuple[Float32[np.ndarray, "n s s 3"], Float32[np.ndarray, "n s s"], Float32[np.ndarray, "n s s"]]:
        """Draw patches.

        Returns:
            Their colours, the hair's coverage, and 1 where the coverage is known, 0 elsewhere.
        """
        patches = [self._patch() for _ in range(count)]
        colours, coverage, known = (np.stack(part) for part in zip(*patches, strict=True))
        return colours, coverage, known

    def _some_places(self, view: LabelledView, kind: int) -> np.ndarray:
        """Flat indices of pixels of this kind: as many as there are, or enough."""
        found = np.flatnonzero(view.labels == kind)
        return self._rng.choice(found, PLACES, replace=False) if len(found) > PLACES else found

    def _patch(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        kinds = [HAIR, self._others[self._rng.integers(len(self._others))]]
        if self._rng.random() < 0.5:
            kinds.reverse()
        colours, labels = self._cut(kinds[0])
        coverage, known = (labels == HAIR).astype(np.float32), labels != UNKNOWN
        if self._rng.random() < PASTED:
            over, over_labels = self._cut(kinds[1])
            share = streaks(self._rng)
            known = (known | (share == 1)) & ((over_labels != UNKNOWN) | (share == 0))
            coverage = coverage + share * ((over_labels == HAIR) - coverage)
            colours = _mix(colours, over, share[..., None])
        return self._relight(colours), coverage, known.astype(np.float32)

    def _cut(self, kind: int) -> tuple[np.ndarray, np.ndarray]:
        """A patch with a pixel of this kind in its middle half: turned, zoomed, and every other time mirrored."""
        rng = self._rng
        places = self._places[kind]
        view, found = places[rng.integers(len(places))]
        y, x = divmod(int(found[rng.integers(len(found))]), view.labels.shape[1])
        angle, zoom = rng.uniform(-_TILT, _TILT), np.exp(rng.uniform(-_ZOOM, _ZOOM))
        axes = zoom * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        axes[:, 0] *= rng.choice((-1, 1))
        place = (SIDE - 1) / 2 + rng.uniform(-SIDE / 4, SIDE / 4, 2)
        to_view = np.column_stack([axes, (x, y) - axes @ place])
        size, inverse = (SIDE, SIDE), cv2.WARP_INVERSE_MAP
        image, mask = (
            cv2.warpAffine(pixels, to_view, size, flags=cv2.INTER_LINEAR | inverse)
            for pixels in (view.image, view.mask)
        )
        labels = cv2.warpAffine(view.labels, to_view, size, flags=cv2.INTER_NEAREST | inverse, borderValue=UNKNOWN)
        return blank_background(image, mask), labels

    def _relight(self, colours: np.ndarray) -> np.ndarray:
        """Another exposure, white balance and contrast; the blank background, at zero, moves along a little."""
        gain = self._rng.uniform(0.75, 1.3) * self._rng.uniform(0.92, 1.08, 3)
        lit = np.clip((colours + 1) / 2 * gain, 0, 1) ** self._rng.uniform(0.85, 1.18)
        blank = np.all(colours == 0, axis=-1, keepdims=True)
        return np.where(blank, 0, 2 * lit - 1).astype(np.float32)


def streaks(rng: np.random.Generator) -> Float32[np.ndarray, "s s"]:
    """A random pattern of streaks in one direction, like locks: coverage in [0, 1] with edges 1 to 3 pixels wide."""
    across, along = (np.exp(rng.uniform(*np.log(limits))) for limits in (_STREAK_ACROSS, _STREAK_ALONG))
    noise = rng.standard_normal((int(2 * SIDE / across) + 4, int(2 * SIDE / along) + 4)).astype(np.float32)
    angle = rng.uniform(0, np.pi)
    to_noise = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) / [[along], [across]]
    middle = np.array([noise.shape[1] / 2, noise.shape[0] / 2])
    to_noise = np.column_stack([to_noise, middle - to_noise @ np.full(2, SIDE / 2)])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    height = cv2.warpAffine(noise, to_noise, (SIDE, SIDE), flags=flags, borderMode=cv2.BORDER_REFLECT)
    slope = np.hypot(*np.gradient(height)) + 1e-3
    distance = (height - rng.normal(0, 0.5)) / slope
    return np.clip(distance / rng.uniform(1, 3) + 0.5, 0, 1).astype(np.float32)


def _mix(under: np.ndarray, over: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Light adds up in intensities, of which sRGB values are about the square roots."""
    under, over = (under + 1) / 2, (over + 1) / 2
    return 2 * np.sqrt((1 - share) * under**2 + share * over**2) - 1
