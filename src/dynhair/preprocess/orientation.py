"""Orientation of the hair in an image, from a bank of Gabor filters (paper, supplement, "Hair orientation maps").

The bank is the one of the paper's sources: 180 even filters over [0, pi), after a difference of Gaussians. As a
function of its angle, a filter is all but a trigonometric polynomial of low degree: so all responses of the bank follow
from the image's convolutions with 15 filters, |response| can be sampled coarsely, and its peak found between samples.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

LUMA = (0.2989, 0.587, 0.114)
BAND = (0.4, 10.0)
"""Standard deviations of the two Gaussians whose difference removes the shading, pixels."""
SIGMA_ACROSS, SIGMA_ALONG = 1.8, 2.4
"""Standard deviations of a filter's envelope across and along the hair, pixels."""
FREQUENCY = 0.23
"""Of a filter's wave across the hair, cycles per pixel."""
FILTERS = 180
RADIUS = 7
"""Of a filter's support, pixels; 0.2 % of the norm lie outside."""
HARMONICS = 7
"""Even angular harmonics of a filter that are kept; 0.12 % of the norm are lost."""
SAMPLES = 32
"""Angles at which |response| is sampled; its peaks are 30 degrees wide."""
STRIP = 1 << 14
"""Pixels filtered at once, so that the samples stay in the processor's cache."""


def gabor_orientation(
    image: UInt8[np.ndarray, "h w 3"], *, pooling: float = SIGMA_ALONG
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Estimate the direction along the hair at each pixel, and how far it can be trusted.

    A pixel votes for the angle ``a`` of its greatest |response|, the doubled angle ``(cos 2a, sin 2a)``, with that
    response as its weight. Its concentration is ``|sum F exp(2ia)| / sum F`` over the bank, with ``F = |response|``,
    divided by what a straight grating of the bank's frequency gives. For narrow peaks this is ``1 - 2 v``, with ``v``
    the variance ``sum d^2 F / sum F`` about the peak that the sources call confidence, but it grows with trust and is
    bounded. Votes times concentration are summed over a Gaussian window; the sum's direction is the angle, and its
    length over the sum of weights the coherence. Responses like those to the rounding to 8 bits count for little.

    Args:
        image: sRGB.
        pooling: standard deviation of the window, pixels. Single responses are noisy where strands are thinner than a
            pixel; a window as wide as the filters averages independent ones and costs little sharpness. 0 leaves each
            pixel with its own strongest filter, as in the sources.

    Returns:
        Angle, undirected, in [0, 1) of pi from +x towards +y (down); and coherence in [0, 1], 0 where all is flat.
    """
    votes, weights = _votes(_difference_of_gaussians(image))
    if pooling > 0:
        votes, weights = (cv2.GaussianBlur(array, (0, 0), pooling) for array in (votes, weights))
    angle = np.arctan2(votes[..., 1], votes[..., 0])
    angle *= 0.5 / np.pi
    angle %= 1
    angle[angle >= 1] = 0  # what float32 makes of a tiny negative angle, modulo 1
    coherence = np.hypot(votes[..., 0], votes[..., 1])
    coherence /= weights + _bank().noise
    return angle, np.minimum(coherence, 1, out=coherence)


def gabor_filters(angles: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n k k"]:
    """Build even Gabor filters along given directions.

    Args:
        angles: directions along the hair, radians from +x towards +y.
    """
    y, x = np.mgrid[-RADIUS : RADIUS + 1, -RADIUS : RADIUS + 1].astype(float)
    cos, sin = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    along, across = x * cos + y * sin, y * cos - x * sin
    envelope = np.exp(-0.5 * ((across / SIGMA_ACROSS) ** 2 + (along / SIGMA_ALONG) ** 2))
    return envelope * np.cos(2 * np.pi * FREQUENCY * across) / (2 * np.pi * SIGMA_ACROSS * SIGMA_ALONG)


class _Bank(NamedTuple):
    filters: Float[Tensor, "m 1 k k"]  # whose responses are the Fourier coefficients in the bank's angle
    synthesis: Float[Tensor, "n m"]  # from these to the responses at the sampled angles
    moments: Float[Tensor, "3 n"]  # from |responses| to the two components of their doubled-angle sum, and their sum
    concentration: float  # of a straight grating
    noise: float  # root mean square of a response to the rounding to 8 bits


@lru_cache(maxsize=1)
def _bank() -> _Bank:
    angles = np.pi * np.arange(FILTERS) / FILTERS
    filters = gabor_filters(angles)
    orders = np.arange(HARMONICS + 1)

    def harmonics(angles: np.ndarray) -> np.ndarray:
        phases = 2 * angles[:, None] * orders
        return np.concatenate([np.cos(phases), np.sin(phases[:, 1:])], 1)

    steerable = np.linalg.lstsq(harmonics(angles), filters.reshape(FILTERS, -1), rcond=None)[0]
    samples = np.pi * np.arange(SAMPLES) / SAMPLES
    moments = np.stack([np.cos(2 * samples), np.sin(2 * samples), np.ones(SAMPLES)])
    size = 2 * RADIUS + 1
    grating = np.cos(2 * np.pi * FREQUENCY * (np.arange(size) - RADIUS))
    cos, sin, total = moments @ np.abs(np.einsum("nyx,y->n", gabor_filters(samples), grating))
    return _Bank(
        filters=torch.from_numpy(steerable.reshape(-1, 1, size, size)).float(),
        synthesis=torch.from_numpy(harmonics(samples)).float(),
        moments=torch.from_numpy(moments).float(),
        concentration=float(np.hypot(cos, sin) / total),
        noise=float(np.linalg.norm(filters[0]) / (255 * np.sqrt(12))),
    )


def _difference_of_gaussians(image: np.ndarray) -> np.ndarray:
    luma = cv2.transform(image.astype(np.float32), np.array([LUMA], np.float32) / 255)
    fine, coarse = (cv2.GaussianBlur(luma, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE) for sigma in BAND)
    return fine - coarse


def _votes(band: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return doubled-angle votes times weight and concentration (h, w, 2), and weights (h, w)."""
    height, width = band.shape
    padded = cv2.copyMakeBorder(band, RADIUS, RADIUS, RADIUS, RADIUS, cv2.BORDER_REPLICATE)
    votes, weights = np.empty((height, width, 2), np.float32), np.empty((height, width), np.float32)
    step = max(1, STRIP // width)
    for top in range(0, height, step):
        rows = slice(top, min(top + step, height))
        strip = torch.from_numpy(padded[top : rows.stop + 2 * RADIUS])
        doubled, weight, concentration = _strongest(strip)
        scaled = weight * concentration
        votes[rows, :, 0] = (scaled * doubled.cos()).view(-1, width)
        votes[rows, :, 1] = (scaled * doubled.sin()).view(-1, width)
        weights[rows] = weight.view(-1, width)
    return votes, weights


@torch.inference_mode()
def _strongest(strip: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Find the doubled angle of the greatest |response|, its value and the concentration, at each pixel in a row."""
    bank = _bank()
    coefficients = torch.conv2d(strip[None, None], bank.filters)[0].flatten(1)
    responses = (bank.synthesis @ coefficients).abs_()
    cos, sin, total = bank.moments @ responses
    concentration = torch.hypot(cos, sin) / (bank.concentration * total.clamp_min_(torch.finfo(total.dtype).tiny))

    # An index in the lowest bits of values, which as integers are in the same order: several times as fast as argmax.
    tagged = responses.view(torch.int32)
    tagged.bitwise_and_(-SAMPLES).bitwise_or_(torch.arange(SAMPLES, dtype=torch.int32)[:, None])
    peak = tagged.amax(0).bitwise_and_(SAMPLES - 1).long()
    before, at, after = (responses.gather(0, ((peak + step) % SAMPLES)[None])[0] for step in (-1, 0, 1))
    # the vertex of the parabola through the three
    curvature = (2 * at - before - after).clamp_min_(torch.finfo(at.dtype).tiny)
    shift = (0.5 * (after - before) / curvature).clamp_(-0.5, 0.5)
    value = at + 0.25 * (after - before) * shift
    return (peak + shift) * (2 * torch.pi / SAMPLES), value, concentration.clamp_max_(1)
