"""How long each strand is: hems, layers, fringes, short sides."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.hairstyles.combing import Combing
from dynhair.hairstyles.noise import smooth_noise, strand_random
from dynhair.hairstyles.style import Style
from dynhair.strands.geometry import segment_lengths
from dynhair.strands.scalp_map import ScalpFrame

_SHORTEST = 0.003
_FADE = 0.2
_FRINGE = 0.22


def grown_lengths(style: Style, combing: Combing, roots: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """Lengths before the hems are cut, metres.

    Args:
        style: the hairstyle.
        combing: tells the fringe's strands.
        roots: in scalp units.
    """
    own = 2 * strand_random(roots, style.seed, 20) - 1
    length = style.length * (1 + style.length_noise * (own + smooth_noise(roots, 0.5, style.seed, 21)))
    length = torch.where(combing.fringe > 0, length.clamp_max(_FRINGE), length)
    # The front stays long down to the forehead, as clippers go.
    height = roots[:, 1] + 0.35 * roots[:, 2] - style.side_height
    above = ((height + 0.03 * own) / _FADE).clamp(0, 1)
    return (above * length + (1 - above) * min(style.side_length, style.length)).clamp_min(_SHORTEST)


def trimmed_lengths(
    style: Style, combing: Combing, courses: Float[Tensor, "n m 3"], frame: ScalpFrame
) -> Float[Tensor, " n"]:
    """Lengths of the grown courses after the cut, metres.

    Args:
        style: the hairstyle.
        combing: tells the fringe's strands.
        courses: strands in the head frame, root first.
        frame: of the scalp.
    """
    arc = torch.nn.functional.pad(segment_lengths(courses).cumsum(1), (1, 0))
    local = courses - frame.centre
    own = 2 * strand_random(frame.to_scalp(courses[:, 0]), style.seed, 22) - 1
    hem = style.hem + style.hem_aslant * local[..., 0] + style.hem_forward * local[..., 2]
    hem = torch.where((combing.fringe > 0)[:, None], style.fringe_hem, hem)
    jagged = style.length_noise * own * torch.where(combing.fringe > 0, 0.1, 0.5 * style.length)
    return _first_crossing(-local[..., 1] - hem - jagged[:, None], arc).clamp_min(_SHORTEST)


def _first_crossing(below: Tensor, arc: Tensor) -> Tensor:
    crossed = below[:, 1:] >= 0
    first = torch.where(crossed.any(1), crossed.int().argmax(1), arc.shape[1] - 2)[:, None]
    before, after = below.gather(1, first)[:, 0], below.gather(1, first + 1)[:, 0]
    share = torch.where(crossed.any(1), (before / (before - after - 1e-9)).clamp(0.0, 1.0), 1.0)
    start, end = arc.gather(1, first)[:, 0], arc.gather(1, first + 1)[:, 0]
    return start + share * (end - start)
