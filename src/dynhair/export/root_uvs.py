"""Where strands grow on a texture of the scalp."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.strands import ScalpFrame


def root_uvs(roots: Float[Tensor, "n 3"]) -> Float[Tensor, "n 2"]:
    """Lay roots out flat, by the equal-area map of :meth:`ScalpFrame.uv` about the sphere that fits them best.

    The sphere is fitted to the roots and not to a head's scalp, since an avatar keeps no mesh of its own.

    Args:
        roots: head frame, metres.

    Returns:
        Texture coordinates in [0, 1]: u to the subject's left, v towards the face, the crown in the middle.
    """
    origin = roots.mean(0)
    centred = (roots - origin).detach().double()
    # |x|^2 = 2 centre.x + constant; of the solutions for roots on a plane or a line, the least
    system = torch.nn.functional.pad(2 * centred, (0, 1), value=1.0)
    solution = torch.linalg.lstsq(system.cpu(), centred.square().sum(1).cpu(), driver="gelsd").solution.to(roots)
    centre, constant = solution.split([3, 1])
    radius = float((constant + centre.square().sum()).clamp_min(1e-12).sqrt())
    return ScalpFrame(origin + centre, radius).uv(roots)
