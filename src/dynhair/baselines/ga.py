"""GaussianAvatars' idea: Gaussians bound to the triangles of the tracked mesh."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from dynhair.avatar import ExpressionModes, HeadPose
from dynhair.avatar.model_folder import basis_of, load_model, save_model
from dynhair.avatar.rotations import multiply_quaternions, rotation_quaternion
from dynhair.avatar.spherical_harmonics import COEFFICIENTS, constant_coefficient, harmonics_colours
from dynhair.baselines.driven_mesh import DrivenMesh
from dynhair.baselines.strandless import PosedGaussians, StrandlessHead
from dynhair.baselines.triangle_frames import triangle_frames
from dynhair.camera import Camera
from dynhair.capture import ExpressionBasis
from dynhair.config import TrainingConfig
from dynhair.motion import so3_log
from dynhair.render import Gaussians

KIND = "dynhair ga baseline"

# The published settings. Lengths are in units of the triangles' sizes; weights are for a colour term of weight 0.8.
POSITION_THRESHOLD, POSITION_WEIGHT = 1.0, 0.01
SCALE_THRESHOLD, SCALE_WEIGHT = 0.6, 1.0
COLOUR_WEIGHT = 0.8
RATES = {
    "means": 5e-3,
    "log_scales": 1.7e-2,
    "quats": 1e-3,
    "opacity_logits": 5e-2,
    "base_harmonic": 2.5e-3,
    "higher_harmonics": 2.5e-3 / 20,
}


class BoundGaussians(StrandlessHead):
    """Gaussians that live in the frames of a mesh's triangles.

    After Qian et al., "GaussianAvatars" (2024): each Gaussian has a triangle, and a position, a rotation and scales in
    that triangle's frame; the mesh moves them all. Hair is Gaussians of the scalp's triangles far from these, and so it
    moves rigidly with the head. Their number is fixed: they begin where the paper's densification would have to bring
    them. The mesh is :class:`~dynhair.baselines.driven_mesh.DrivenMesh`, in place of a face model.

    Args:
        mesh: that carries them.
        triangle: the face that each is bound to.
        start: what they begin as, in the mesh's rest shape, head frame, metres; features are colours in [0, 1].
        background: colour behind everything.
        expression_basis: whose expression coefficients drive the mesh; None if that is not known.
    """

    triangle: Tensor

    def __init__(
        self,
        mesh: DrivenMesh,
        triangle: Int64[Tensor, " g"],
        start: Gaussians,
        background: Float[Tensor, "3"],
        expression_basis: ExpressionBasis | None = None,
    ) -> None:
        super().__init__(background, len(mesh.modes.rest), expression_basis)
        self.mesh = mesh
        self.register_buffer("triangle", triangle.clone())
        frames = triangle_frames(mesh.rest, mesh.faces)[triangle]
        back = rotation_quaternion(so3_log(frames.rotations.mT))
        self.means = nn.Parameter(frames.to_local(start.means))
        self.quats = nn.Parameter(multiply_quaternions(back, start.quats))
        self.log_scales = nn.Parameter((start.scales / frames.sizes[:, None]).log())
        self.opacity_logits = nn.Parameter(start.opacities.logit())
        base = constant_coefficient(start.features).T[None].contiguous()
        self.base_harmonic = nn.Parameter(base)
        self.higher_harmonics = nn.Parameter(base.new_zeros(COEFFICIENTS - 1, 3, len(triangle)))

    def posed(self, pose: HeadPose) -> PosedGaussians:
        """The Gaussians in a given pose."""
        return self.bound(self.mesh(pose))

    def bound(self, vertices: Float[Tensor, "v 3"]) -> PosedGaussians:
        """The Gaussians on the mesh with these vertices, world, metres (section 3.2)."""
        frames = triangle_frames(vertices, self.mesh.faces)[self.triangle]
        turned = rotation_quaternion(so3_log(frames.rotations))
        return PosedGaussians(
            means=frames.to_world(self.means),
            quats=multiply_quaternions(turned, nn.functional.normalize(self.quats, dim=-1)),
            scales=self.log_scales.exp() * frames.sizes[:, None],
            opacities=self.opacity_logits.sigmoid(),
        )

    def colours(self, posed: PosedGaussians, cameras: Sequence[Camera]) -> Float[Tensor, "v g 3"]:
        """The colours that each camera sees: spherical harmonics of degree 3, as our hair has."""
        eyes = torch.stack([camera.centre for camera in cameras])
        sights = nn.functional.normalize(posed.means.detach() - eyes[:, None], dim=-1)
        return harmonics_colours(self.base_harmonic, self.higher_harmonics, sights)

    def regularizers(self, config: TrainingConfig) -> dict[str, tuple[float, Tensor]]:
        """What keeps Gaussians near their triangles and no larger than these (section 3.3), for our colour weight."""
        factor = config.weights.rgb / COLOUR_WEIGHT
        return {
            "position": (factor * POSITION_WEIGHT, beyond(self.means, POSITION_THRESHOLD)),
            "scale": (factor * SCALE_WEIGHT, beyond(self.log_scales.exp(), SCALE_THRESHOLD)),
        }

    def parameter_groups(self, config: TrainingConfig) -> list[dict[str, Any]]:
        """Adam's groups, with the published rates; those of the body's answer to the head are our own."""
        groups = [{"params": [getattr(self, name)], "lr": rate, "name": name} for name, rate in RATES.items()]
        response = list(self.mesh.skinning.parameters())
        return [*groups, {"params": response, "lr": config.rates.body_response, "name": "body_response"}]

    def save(self, path: Path | str) -> None:
        """Write the head as a folder, atomically: ``avatar.json`` and ``avatar.safetensors``."""
        basis = self.expression_basis
        save_model(self, path, KIND, {"expression_basis": None if basis is None else basis.to_json()})

    @classmethod
    def load(cls, path: Path | str, device: torch.device | str = "cpu") -> BoundGaussians:
        """Open a head's folder. Nothing in it is executed.

        Raises:
            DynhairError: a file is missing, damaged, of another kind or version, or does not fit the other.
        """
        return load_model(path, KIND, cls._like, device)

    @classmethod
    def _like(cls, description: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> BoundGaussians:
        rest, faces = tensors["mesh.rest"], tensors["mesh.faces"]
        size = len(tensors["mesh.modes.rest"])
        coefficients, rows, _ = tensors["mesh.modes.offsets"].shape
        modes = ExpressionModes.blank(size, coefficients, rows)
        pose = HeadPose(torch.eye(3), torch.zeros(3), torch.zeros(3), torch.zeros(size))
        mesh = DrivenMesh(rest, faces, tensors["mesh.follow"], modes, pose)
        triangle = tensors["triangle"]
        for indices, limit in ((faces, len(rest)), (triangle, len(faces))):
            if not 0 <= int(indices.min()) <= int(indices.max()) < limit:
                raise ValueError("it holds indices of what is not there")
        ones = torch.ones(len(triangle), 3)
        start = Gaussians(ones, torch.ones(len(triangle), 4), ones, ones[:, 0] / 2, ones)
        return cls(mesh, triangle, start, torch.zeros(3), basis_of(description))


def beyond(values: Float[Tensor, "g 3"], threshold: float) -> Float[Tensor, ""]:
    """The mean length of ``max(|values|, threshold)`` (section 3.3), less its least: zero up to the threshold."""
    lengths = torch.linalg.vector_norm(values.abs().clamp_min(threshold), dim=1)
    return lengths.mean() - math.sqrt(3) * threshold
