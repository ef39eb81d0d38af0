"""Head and upper body: Gaussians moved by expression and pose (paper, appendix A)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.encoding import encoded_size, positional_encoding
from dynhair.avatar.mlp import PointMLP
from dynhair.config import HeadConfig

CANONICAL_UNIT = 0.1  # metres; positions and translations are encoded in this unit
ENCODING_FREQUENCIES = 4
# Initial standard deviations over spacing: wide enough to close the surface, and thin, for hair that lies on the skin
# would vanish in anything thick.
DISC = (0.8, 0.8, 0.15)
ATTRIBUTES = 8  # offsets of 3 log-scales, 4 quaternion components, 1 opacity logit


@dataclass(frozen=True)
class HeadPose:
    """What drives the head in one frame.

    Attributes:
        rotation: of the head frame in the world.
        translation: of the head frame's origin, metres.
        rotation_vector: the rotation as axis times angle, radians.
        expression: coefficients of the face model.
    """

    rotation: Float[Tensor, "3 3"]
    translation: Float[Tensor, "3"]
    rotation_vector: Float[Tensor, "3"]
    expression: Float[Tensor, " e"]


@dataclass(frozen=True)
class HeadGaussians:
    """The posed head in its own frame: metres, standard deviations, wxyz, [0, 1], unclamped colours."""

    means: Float[Tensor, "k 3"]
    scales: Float[Tensor, "k 3"]
    quats: Float[Tensor, "k 4"]
    opacities: Float[Tensor, " k"]
    colours: Float[Tensor, "k 3"]


class Head(nn.Module):
    """Canonical Gaussians and three pairs of MLPs: deformation, colour, attributes.

    Near the landmarks the expression branch rules, far from them the pose branch; between, they blend linearly with
    the distance. A branch is evaluated only where its weight is not zero. Beyond the paper, every Gaussian has a colour
    of its own to which the colour MLPs add: a face is recognisable after hundreds of steps instead of thousands.

    Args:
        means: canonical positions in the head frame, metres.
        normals: unit surface normals there; the Gaussians start as discs in the surface.
        spacing: distance of each Gaussian to its neighbours, metres.
        landmarks: facial landmarks in the head frame, metres.
        rest_translation: the head's translation at rest, metres.
        expression_size: number of expression coefficients.
        config: sizes and bounds.
    """

    expression_weight: Tensor
    rest_translation: Tensor

    def __init__(
        self,
        means: Float[Tensor, "k 3"],
        normals: Float[Tensor, "k 3"],
        spacing: Float[Tensor, " k"],
        landmarks: Float[Tensor, "m 3"],
        rest_translation: Float[Tensor, "3"],
        expression_size: int,
        config: HeadConfig,
    ) -> None:
        super().__init__()
        self.config = config
        self.expression_size = expression_size
        count = len(means)
        self.means = nn.Parameter(means.clone())
        self.features = nn.Parameter(torch.randn(count, config.features) * 0.1)
        self.log_scales = nn.Parameter((spacing[:, None] * spacing.new_tensor(DISC)).log())
        self.quats = nn.Parameter(facing(normals))
        self.opacity_logits = nn.Parameter(torch.full((count,), 3.0))
        self.base_colours = nn.Parameter(torch.full((count, 3), 0.5))
        distance = torch.cdist(means, landmarks).amin(1)
        weight = ((config.far - distance) / (config.far - config.near)).clamp(0, 1)
        self.register_buffer("expression_weight", weight)
        self.register_buffer("rest_translation", rest_translation.clone())

        position = encoded_size(3, ENCODING_FREQUENCIES)
        pose = encoded_size(6, ENCODING_FREQUENCIES)
        wide, deep, thin = config.deformation_width, config.deformation_layers, config.appearance_width
        self.expression_deformation = PointMLP(position, expression_size, (wide,) * deep, 3)
        self.pose_deformation = PointMLP(position, pose, (wide,) * 2, 3)
        self.expression_colour = PointMLP(config.features, expression_size, (thin,) * 2, 3)
        self.pose_colour = PointMLP(config.features, pose, (thin,), 3)
        self.expression_attributes = PointMLP(config.features, expression_size, (thin,) * 2, ATTRIBUTES)
        self.pose_attributes = PointMLP(config.features, pose, (thin,), ATTRIBUTES)
        for network in self.children():
            if isinstance(network, PointMLP):  # the head starts undeformed, in its base colours
                last = network.layers[-1]
                assert isinstance(last, nn.Linear)
                nn.init.normal_(last.weight, std=1e-3)
                nn.init.zeros_(last.bias)

    def pose_code(self, pose: HeadPose) -> Float[Tensor, " p"]:
        """The encoded pose: rotation vector, and translation from rest in canonical units."""
        moved = (pose.translation - self.rest_translation) / CANONICAL_UNIT
        return positional_encoding(torch.cat([pose.rotation_vector, moved]), ENCODING_FREQUENCIES)

    def deformed_means(self, pose: HeadPose, only: Tensor | None = None) -> Float[Tensor, "k 3"]:
        """Positions in the head frame, metres (appendix A, "Deformation module").

        Args:
            pose: the frame's pose and expression.
            only: indices of the Gaussians wanted; all by default.
        """
        means = self.means if only is None else self.means[only]
        weight = self.expression_weight if only is None else self.expression_weight[only]
        code = positional_encoding(means / CANONICAL_UNIT, ENCODING_FREQUENCIES)
        moved = self._blend(
            code,
            weight,
            self.expression_deformation,
            pose.expression,
            self.pose_deformation,
            self.pose_code(pose),
            True,
        )
        return means + self.config.deformation_scale * moved

    def forward(self, pose: HeadPose) -> HeadGaussians:
        """The posed Gaussians in the head frame (appendix A, "Appearance and attributes")."""
        code = self.pose_code(pose)
        weight = self.expression_weight
        colour = self._blend(
            self.features, weight, self.expression_colour, pose.expression, self.pose_colour, code, False
        )
        offsets = self._blend(
            self.features, weight, self.expression_attributes, pose.expression, self.pose_attributes, code, False
        )
        log_scales, quats, opacity = (self.config.attribute_scale * offsets).split([3, 4, 1], dim=-1)
        return HeadGaussians(
            means=self.deformed_means(pose),
            scales=(self.log_scales + log_scales).exp(),
            quats=nn.functional.normalize(self.quats + quats, dim=-1),
            opacities=(self.opacity_logits + opacity[:, 0]).sigmoid(),
            colours=self.base_colours + colour,
        )

    def _blend(
        self,
        points: Tensor,
        weight: Tensor,
        on_expression: PointMLP,
        expression: Tensor,
        on_pose: PointMLP,
        pose_code: Tensor,
        bounded: bool,
    ) -> Tensor:
        """Both branches where they count, bounded by tanh if asked, added up by weight."""
        total = None
        for network, condition, share in ((on_expression, expression, weight), (on_pose, pose_code, 1 - weight)):
            rows = torch.nonzero(share).squeeze(1)
            value = network(points.index_select(0, rows), condition)
            value = share[rows, None] * (value.tanh() if bounded else value)
            if total is None:
                total = points.new_zeros(len(points), value.shape[-1])
            total = total.index_add(0, rows, value)
        assert total is not None
        return total


def facing(normals: Float[Tensor, "k 3"]) -> Float[Tensor, "k 4"]:
    """Quaternions (wxyz) that turn the z axis onto the normals or against them, which is the same for a disc."""
    x, y, z = torch.where(normals[:, 2:] < 0, -normals, normals).unbind(-1)
    return nn.functional.normalize(torch.stack([1 + z, -y, x, torch.zeros_like(x)], -1), dim=-1)
