"""Hair: canonical strands, the network that moves them, and their colours."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.deformer import HairDeformer, PaperDeformer
from dynhair.avatar.modal import ModalDeformer
from dynhair.avatar.spherical_harmonics import COEFFICIENTS, constant_coefficient
from dynhair.avatar.strand_deformer import StrandDeformer
from dynhair.avatar.strand_dynamics import FPS
from dynhair.config import DeformerConfig
from dynhair.editing import HairLook
from dynhair.strands import smooth_strands, with_lengths


class RigidDeformer(nn.Module):
    """In the place of the network where the hair only follows the head; it has no parameters."""

    def __init__(self, config: DeformerConfig) -> None:
        super().__init__()
        self.config = config

    def parameters_by_rate(self) -> dict[str, list[nn.Parameter]]:
        """None."""
        return {}


def hair_deformer(canonical: Float[Tensor, "n l 3"], config: DeformerConfig, fps: float = FPS) -> HairDeformer:
    """A fresh deformer of the configured kind, for motions of so many frames a second."""
    if config.kind == "strands":
        return StrandDeformer(canonical, config, fps)
    return {"paper": PaperDeformer, "modal": ModalDeformer}[config.kind](canonical, config)


class Hair(nn.Module):
    """Strands that move with the head and against it (paper, "Modeling Dynamic Hair").

    Args:
        canonical: strands at rest in the head frame, metres, root first.
        width: width of a strand, metres.
        colour: initial colour, in [0, 1].
        deformer: kind and sizes of the deformation network.
        dynamic: whether there is such a network; without it the hair is rigid (paper, "Rigid Hair").
        fps: frames a second of the motions that it follows.
    """

    def __init__(
        self,
        canonical: Float[Tensor, "n l 3"],
        width: float,
        colour: Float[Tensor, "3"],
        deformer: DeformerConfig,
        dynamic: bool = True,
        fps: float = FPS,
    ) -> None:
        super().__init__()
        self.width = width
        self.strands = nn.Parameter(canonical.clone())
        self.deformer = hair_deformer(canonical, deformer, fps) if dynamic else RigidDeformer(deformer)
        count = canonical.shape[0] * (canonical.shape[1] - 1)
        self.base_harmonic = nn.Parameter(constant_coefficient(colour)[None, :, None].repeat(1, 1, count))
        self.higher_harmonics = nn.Parameter(torch.zeros(COEFFICIENTS - 1, 3, count))

    @property
    def look(self) -> HairLook:
        """All strands, as they were trained."""
        widths = torch.full_like(self.strands[:, 0, 0], self.width)
        ids = torch.arange(len(widths), device=widths.device)
        return HairLook(ids, ids, widths, self.base_harmonic, self.higher_harmonics)

    def parameters_by_rate(self) -> dict[str, list[nn.Parameter]]:
        """Its parameters under the names of their :class:`~dynhair.config.LearningRates`."""
        return {
            "strands": [self.strands],
            "hair_colour": [self.base_harmonic],
            "hair_gloss": [self.higher_harmonics],
            **self.deformer.parameters_by_rate(),
        }

    def forward(self, window: Float[Tensor, "t c"] | None) -> Float[Tensor, "n l 3"]:
        """Strands in the head frame, metres.

        Args:
            window: normalised motion conditions; None holds the hair rigid.
        """
        # The low-pass of supplement B, "Dynamic training stage"; the rigid hair gets it too, so that the two compare.
        if window is None or isinstance(self.deformer, RigidDeformer):
            return smooth_strands(self.strands)
        moved = smooth_strands(self.strands + self.deformer(window))
        return with_lengths(moved, smooth_strands(self.strands)) if self.deformer.config.inextensible else moved
