"""Gaussian Head Avatar's idea: one set of Gaussians for everything, hair included, deformed by small networks."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.avatar import ExpressionModes, Head, HeadPose, HeadStart
from dynhair.avatar.model_folder import basis_of, load_model, save_model
from dynhair.baselines.strandless import PosedGaussians, StrandlessHead
from dynhair.capture import ExpressionBasis
from dynhair.config import HeadConfig, TrainingConfig
from dynhair.training.rates import parameter_groups

KIND = "dynhair gha baseline"


class GaussianHeadAvatar(StrandlessHead):
    """The avatar's own head model (:class:`~dynhair.avatar.Head`) with Gaussians for the hair as well.

    After Xu et al., "Gaussian Head Avatar" (2024): hair moves with the head, and beyond that by what the deformation
    networks make of the present pose and expression, within their bound. Nothing remembers how the head moved before.
    What the avatar's head has beyond that paper (a colour of each Gaussian, expression modes, follow weights) serves
    the face here too, so that a comparison is one of hair. There is no super-resolution.

    Args:
        head: Gaussians of head, upper body and hair.
        background: colour behind everything.
        expression_basis: whose expression coefficients the head was trained with; None if that is not known.
    """

    def __init__(
        self, head: Head, background: Float[Tensor, "3"], expression_basis: ExpressionBasis | None = None
    ) -> None:
        super().__init__(background, head.expression_size, expression_basis)
        self.head = head

    def posed(self, pose: HeadPose) -> PosedGaussians:
        """The Gaussians in a given pose."""
        head = self.head(pose)
        return PosedGaussians(head.means, head.quats, head.scales, head.opacities, head.colours)

    def parameter_groups(self, config: TrainingConfig) -> list[dict[str, Any]]:
        """Adam's groups, with the rates of the avatar's head."""
        return parameter_groups(self.head.parameters_by_rate(), config.rates)

    def save(self, path: Path | str) -> None:
        """Write the head as a folder, atomically: ``avatar.json`` and ``avatar.safetensors``."""
        basis = self.expression_basis
        description = {
            "expression_size": self.expression_size,
            "head": dataclasses.asdict(self.head.config),
            "expression_basis": None if basis is None else basis.to_json(),
        }
        save_model(self, path, KIND, description)

    @classmethod
    def load(cls, path: Path | str, device: torch.device | str = "cpu") -> GaussianHeadAvatar:
        """Open a head's folder. Nothing in it is executed.

        Raises:
            DynhairError: a file is missing, damaged, of another kind or version, or does not fit the other.
        """
        return load_model(path, KIND, cls._like, device)

    @classmethod
    def _like(cls, description: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> GaussianHeadAvatar:
        rest = HeadPose(torch.eye(3), torch.zeros(3), torch.zeros(3), torch.zeros(int(description["expression_size"])))
        coefficients, rows, _ = tensors["head.modes.offsets"].shape
        modes = ExpressionModes.blank(len(rest.expression), coefficients, rows)
        start = HeadStart.blank(len(tensors["head.means"]), modes)
        head = Head(start, torch.zeros(1, 3), rest, HeadConfig(**description["head"]))
        return cls(head, torch.zeros(3), basis_of(description))
