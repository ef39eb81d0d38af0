"""How much more than the truth's hair an avatar's changes from frame to frame: tLPIPS_ex (paper, "Experiments").

For the pair of frames t and t + 1 of one camera, with M = clamp(H_t + H_t+1, 0, 1) of the truth's hair masks,

    tLPIPS_ex = LPIPS(I_t M, I_t+1 M) - LPIPS(I*_t M, I*_t+1 M)

for the avatar's images I and the truth's I*. Zero is the truth's liveliness: flicker is above it, stiff hair below.
"""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from dynhair.evaluation.perception import Perception
from dynhair.evaluation.truth import TrueFrame


@dataclass(frozen=True)
class TrueChange:
    """How the truth's hair changed since the frame before.

    Attributes:
        region: where hair is in either frame, in [0, 1].
        distance: LPIPS of the truth's two images there.
        still: whether nothing has moved yet.
    """

    region: Float[Tensor, "v h w"]
    distance: Float[Tensor, " v"]
    still: bool


class TrueFlicker:
    """The truth's changes, taken frame by frame.

    Args:
        perception: for LPIPS.
        still: how many frames the motion begins with before anything moves.
    """

    def __init__(self, perception: Perception, still: int) -> None:
        self._perception, self._still = perception, still
        self._last: TrueFrame | None = None

    def change(self, truth: TrueFrame) -> TrueChange | None:
        """What changed from the last frame to this; None if they do not follow each other, or cannot be compared."""
        last, self._last = self._last, truth
        if last is None or last.index != truth.index - 1 or self._perception.distance is None:
            return None
        if last.hair_coverage is None or truth.hair_coverage is None:
            return None
        region = (last.hair_coverage + truth.hair_coverage).clamp(0, 1)
        distance = hair_change(self._perception, last.rgb, truth.rgb, region)
        return TrueChange(region, distance, still=truth.index < self._still)


def hair_change(
    perception: Perception,
    first: Float[Tensor, "v h w 3"],
    second: Float[Tensor, "v h w 3"],
    region: Float[Tensor, "v h w"],
) -> Float[Tensor, " v"]:
    """LPIPS of two frames' images, black outside a region.

    Args:
        perception: that has a network.
        first: in [0, 1].
        second: in [0, 1].
        region: in [0, 1].
    """
    within = region[..., None]
    return perception.compare(perception.see(first * within, None), perception.see(second * within, None))[0]
