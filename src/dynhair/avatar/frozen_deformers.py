"""Deformers whose parameters do not change: the same displacements sooner, for drawing alone."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.avatar.deformer import DISPLACEMENT_UNIT, HairDeformer, PointwiseDeformer
from dynhair.avatar.frozen_layers import FrozenLayers
from dynhair.avatar.modal import ModalDeformer
from dynhair.avatar.strand_deformer import StrandDeformer
from dynhair.avatar.strand_memory import StrandMemory


class FrozenDeformer(ABC):
    """Displacements of a few knots of each strand, which move its other points.

    Args:
        spread: by how much each knot moves each point, metres for a unit of what is said of the knot.
    """

    def __init__(self, spread: Float[Tensor, "l k"]) -> None:
        self.spread = spread

    @abstractmethod
    def at_knots(self, window: Float[Tensor, "t c"]) -> Float[Tensor, "kn3"]:
        """What a window of conditions displaces: knot by knot, of these strand by strand."""


class FrozenNetwork(FrozenDeformer):
    """A network that is evaluated for each knot by itself.

    Args:
        deformer: whose parameters it shares.
    """

    def __init__(self, deformer: PointwiseDeformer) -> None:
        super().__init__((DISPLACEMENT_UNIT * deformer.root_attenuation)[:, None] * deformer.spline)
        self._deformer = deformer

    def at_knots(self, window: Float[Tensor, "t c"]) -> Float[Tensor, "kn3"]:
        """As :meth:`FrozenDeformer.at_knots`."""
        return self._evaluated(self._deformer.embedding(window))

    def _evaluated(self, embedding: Float[Tensor, " e"]) -> Float[Tensor, "kn3"]:
        layers = self._deformer.layers(embedding)
        network = FrozenLayers([layer.weight for layer in layers])
        return network([layer.bias for layer in layers], self._deformer.code).flatten()


class FrozenModes(FrozenNetwork):
    """Modes, whose shapes are worked out once.

    Args:
        deformer: whose parameters it shares.
    """

    def __init__(self, deformer: ModalDeformer) -> None:
        super().__init__(deformer)
        amplitudes = torch.eye(deformer.config.modes).to(deformer.code)
        self._shapes = torch.stack([self._evaluated(one) for one in amplitudes])

    def at_knots(self, window: Float[Tensor, "t c"]) -> Float[Tensor, "kn3"]:
        """As :meth:`FrozenDeformer.at_knots`."""
        return self._deformer.embedding(window) @ self._shapes


class FrozenStrands(FrozenDeformer):
    """Dynamics of strands, which go on from the frame before.

    Args:
        deformer: whose parameters it shares.
    """

    def __init__(self, deformer: StrandDeformer) -> None:
        super().__init__(deformer.along)
        self._deformer, self._memory = deformer, StrandMemory(deformer)

    def at_knots(self, window: Float[Tensor, "t c"]) -> Float[Tensor, "kn3"]:
        """As :meth:`FrozenDeformer.at_knots`."""
        return self._deformer.following(self._memory.states(window)).transpose(0, 1).flatten()


def frozen_deformer(deformer: HairDeformer) -> FrozenDeformer:
    """The frozen form of a deformer; called, and used, without gradients."""
    match deformer:
        case StrandDeformer():
            return FrozenStrands(deformer)
        case ModalDeformer():
            return FrozenModes(deformer)
        case PointwiseDeformer():
            return FrozenNetwork(deformer)
        case _:
            raise TypeError(f"{type(deformer).__name__} has no frozen form")
