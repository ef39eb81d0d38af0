"""Heads to grow hair on."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from dynhair.face.open_head import open_head

_DEVIATION = 0.7
_MOST = 1.5


def random_head(seed: int) -> tuple[Float[Tensor, "v 3"], Int[Tensor, "f 3"], Int[Tensor, " s"]]:
    """An open head of a random person.

    Args:
        seed: the same person on every platform.

    Returns:
        Vertices in the head frame, metres; faces; and the indices of the faces that grow hair.
    """
    model = open_head()
    random = np.random.Generator(np.random.PCG64(seed))
    identity = (_DEVIATION * random.standard_normal(len(model.identity_modes))).clip(-_MOST, _MOST)
    return model.vertices(torch.from_numpy(identity).float()), model.faces, model.scalp
