"""Skin under the hair, in the colour of the hair that grows there: where strands part, none of it shines through."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from dynhair.editing import HairLook

NEAREST = 4
ROOT_SEGMENTS = 4
BARE = 0.01  # metres from the nearest root at which skin is as likely bare as hairy
FALLOFF = 0.002  # metres
LEAST_DISTANCE = 1e-4


class CoveredScalp(NamedTuple):
    """What the layer lays over the head's Gaussians.

    Attributes:
        rows: the Gaussians that it covers.
        cover: how far it covers each, in [0, 1].
        colours: of the hair there, as each camera sees it.
    """

    rows: Int[Tensor, " s"]
    cover: Float[Tensor, " s"]
    colours: Float[Tensor, "v s 3"]


class ScalpLayer(nn.Module):
    """Head Gaussians on the scalp that count as hair, each by a learned share.

    They take the colour of the strands that grow nearest, a mean over the strands' first segments, so that they need
    not be seen to be coloured. The share starts near one amid roots and near nought on bare skin; the labels of the
    images teach it.

    Args:
        rows: indices of the covered Gaussians among the head's.
        strands: indices of the strands that grow nearest to each.
        shares: their shares in the colour; they sum to 1.
        cover: how far each Gaussian counts as hair at first, in (0, 1).
    """

    rows: Tensor
    strands: Tensor
    shares: Tensor

    def __init__(
        self,
        rows: Int[Tensor, " s"],
        strands: Int[Tensor, "s q"],
        shares: Float[Tensor, "s q"],
        cover: Float[Tensor, " s"],
    ) -> None:
        super().__init__()
        self.register_buffer("rows", rows.clone())
        self.register_buffer("strands", strands.clone())
        self.register_buffer("shares", shares.clone())
        self.cover_logits = nn.Parameter(cover.logit())

    @classmethod
    def blank(cls, count: int, nearest: int = NEAREST) -> ScalpLayer:
        """A layer over ``count`` Gaussians, to be loaded; over none of them it is no layer."""
        rows = torch.zeros(count, dtype=torch.long)
        return cls(rows, rows[:, None].repeat(1, nearest), torch.ones(count, nearest) / nearest, torch.ones(count) / 2)

    @classmethod
    def under(cls, roots: Float[Tensor, "n 3"], means: Float[Tensor, "k 3"], rows: Int[Tensor, " s"]) -> ScalpLayer:
        """The layer under strands.

        Args:
            roots: of the strands, head frame, metres.
            means: the head's Gaussians, head frame, metres.
            rows: those of them that lie on the scalp.
        """
        distances, strands = torch.cdist(means[rows], roots).topk(min(NEAREST, len(roots)), largest=False)
        shares = 1 / distances.clamp_min(LEAST_DISTANCE)
        cover = ((BARE - distances[:, 0]) / FALLOFF).sigmoid().clamp(0.02, 0.98)
        return cls(rows, strands, shares / shares.sum(1, keepdim=True), cover)

    def forward(self, hair_colours: Float[Tensor, "v g 3"], look: HairLook) -> CoveredScalp:
        """The layer in the hair's colours, which it does not change.

        It covers the skin also where strands have been removed, in the colour of those that are left nearby: nothing
        has taught skin that is under hair a colour of its own.

        Args:
            hair_colours: of the strands' Gaussians, strand by strand from the root.
            look: which strands these are.
        """
        near_root = hair_colours.detach().unflatten(1, (len(look.ids), -1))[:, :, :ROOT_SEGMENTS].mean(2)
        colours = (near_root[:, look.nearest[self.strands]] * self.shares[..., None]).sum(2)
        return CoveredScalp(self.rows, self.cover_logits.sigmoid(), colours)
