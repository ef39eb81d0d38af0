"""The Gaussian head and upper body: canonical Gaussians moved and coloured by small MLPs.

Paper, appendix A, "Dynamic Head Avatar". Lengths are metres; the networks see them in units of about the paper's
canonical ones (0.1 m).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.branches import Branches, expression_weight
from dynhair.avatar.encoding import CANONICAL_UNIT, ENCODING_FREQUENCIES, encoded_size, positional_encoding
from dynhair.avatar.expression_modes import ExpressionModes
from dynhair.avatar.head_pose import HeadPose
from dynhair.avatar.posed_gaussians import Canonical, Posed, posed_gaussians
from dynhair.avatar.skinning import Skinning
from dynhair.config import HeadConfig
from dynhair.native import for_kernels

# Initial standard deviations over spacing: wide enough to close the surface, and thin, for hair that lies on the skin
# would vanish in anything thick.
DISC = (0.8, 0.8, 0.15)
ATTRIBUTES = 8  # offsets of 3 log-scales, 4 quaternion components, 1 opacity logit
LEAST_FOLLOW = 0.002  # what lies between it and its complement can be learned


@dataclass(frozen=True)
class HeadStart:
    """What a head begins as: points on a surface in the head frame of the rest frame, metres.

    Attributes:
        means: positions.
        normals: unit surface normals; the Gaussians start as discs in the surface.
        spacing: distance of each to its neighbours.
        colours: in [0, 1].
        opacities: in (0, 1).
        follow: 1 for what moves with the head, 0 for what moves with the body.
        modes: how the expression moves it; None if that is not known.
    """

    means: Float[Tensor, "k 3"]
    normals: Float[Tensor, "k 3"]
    spacing: Float[Tensor, " k"]
    colours: Float[Tensor, "k 3"]
    opacities: Float[Tensor, " k"]
    follow: Float[Tensor, " k"]
    modes: ExpressionModes | None = None

    @classmethod
    def blank(cls, count: int, modes: ExpressionModes) -> HeadStart:
        """A start of the right sizes, for a head whose parameters are to be loaded."""
        ones = torch.ones(count)
        return cls(torch.zeros(count, 3), torch.ones(count, 3), ones, torch.zeros(count, 3), ones / 2, ones / 2, modes)


@dataclass(frozen=True)
class HeadGaussians:
    """The posed head in the world: metres, standard deviations, wxyz, [0, 1], unclamped colours."""

    means: Float[Tensor, "k 3"]
    scales: Float[Tensor, "k 3"]
    quats: Float[Tensor, "k 4"]
    opacities: Float[Tensor, " k"]
    colours: Float[Tensor, "k c"]


class Head(nn.Module):
    """Canonical Gaussians and three pairs of MLPs: deformation, colour, attributes.

    Near the landmarks the expression branch rules, far from them the pose branch; between, they blend linearly with
    the distance. Beyond the paper, every Gaussian has

    - a colour of its own to which the colour MLPs add: a face is recognisable after hundreds of steps instead of
      thousands;
    - displacements of its own for the expression, and turns and growth with them
      (:class:`~dynhair.avatar.expression_modes.ExpressionModes`), to which the MLPs add: lids close over eyes;
    - a follow weight of its own between the head's motion and the body's (:class:`~dynhair.avatar.skinning.Skinning`),
      so that the torso stays while the head turns and the neck bends between.

    Args:
        start: the canonical Gaussians.
        landmarks: facial landmarks in the head frame, metres.
        rest: the rest frame's pose; its expression says how many coefficients there are.
        config: sizes and bounds.
    """

    expression_weight: Tensor

    def __init__(self, start: HeadStart, landmarks: Float[Tensor, "m 3"], rest: HeadPose, config: HeadConfig) -> None:
        super().__init__()
        self.config = config
        self.expression_size = expression = len(rest.expression)
        count, channels = len(start.means), config.colour_channels
        self.means = nn.Parameter(start.means.clone())
        self.features = nn.Parameter(torch.randn(count, config.features) * 0.1)
        self.log_scales = nn.Parameter((start.spacing[:, None] * start.spacing.new_tensor(DISC)).log())
        self.quats = nn.Parameter(facing(start.normals))
        self.opacity_logits = nn.Parameter(start.opacities.logit())
        self.base_colours = nn.Parameter(nn.functional.pad(start.colours, (0, channels - 3)))
        weight = expression_weight(start.means, landmarks, config.near, config.far)
        self.register_buffer("expression_weight", weight)
        self.modes = ExpressionModes.blank(expression) if start.modes is None else start.modes
        self.skinning = Skinning(rest)
        self.follow_logits = None
        if config.follow_weights:
            self.follow_logits = nn.Parameter(start.follow.clamp(LEAST_FOLLOW, 1 - LEAST_FOLLOW).logit())

        position = encoded_size(3, ENCODING_FREQUENCIES)
        pose = encoded_size(6, ENCODING_FREQUENCIES)
        wide, deep, thin = config.deformation_width, config.deformation_layers, config.appearance_width
        self.deformation = Branches(position, expression, pose, (wide,) * deep, (wide,) * 2, 3, bounded=True)
        self.colour = Branches(config.features, expression, pose, (thin,) * 2, (thin,), channels)
        self.attributes = Branches(config.features, expression, pose, (thin,) * 2, (thin,), ATTRIBUTES)

    def parameters_by_rate(self) -> dict[str, list[nn.Parameter]]:
        """Its parameters under the names of their :class:`~dynhair.config.LearningRates`."""
        networks = (self.deformation, self.colour, self.attributes)
        return {
            "head_means": [self.means],
            "head_modes": list(self.modes.parameters()),
            "head_features": [self.features],
            "head_scales": [self.log_scales],
            "head_rotations": [self.quats],
            "head_opacity": [self.opacity_logits],
            "head_colour": [self.base_colours],
            "head_follow": [] if self.follow_logits is None else [self.follow_logits],
            "body_response": list(self.skinning.parameters()),
            "head_networks": [parameter for network in networks for parameter in network.parameters()],
        }

    @property
    def follow(self) -> Float[Tensor, " k"]:
        """How far each Gaussian follows the head: 0 to 1; 1 for all where follow weights are off."""
        return torch.ones_like(self.expression_weight) if self.follow_logits is None else self.follow_logits.sigmoid()

    def world_means(self, pose: HeadPose) -> Float[Tensor, "k 3"]:
        """Positions in the world, metres (appendix A, "Deformation module")."""
        means = self._head_means(pose, self.skinning.pose_code(pose))
        return self.skinning.world(means, self.follow, pose)

    def forward(self, pose: HeadPose) -> HeadGaussians:
        """The posed Gaussians in the world (appendix A, "Appearance and attributes")."""
        code = self.skinning.pose_code(pose)
        offsets = self._offsets(pose, code)
        # there is no gradient of the expression's turns and growth there
        compiled = for_kernels(self.means) and not pose.expression.requires_grad
        posed = self._posed_at_once(pose, code, offsets) if compiled else self._posed_by_passes(pose, code, offsets)
        return HeadGaussians(
            means=posed.means,
            scales=posed.log_scales.exp(),
            quats=posed.quats,
            opacities=posed.logits.sigmoid(),
            colours=self.base_colours + self._tinted(pose, code),
        )

    def _posed_by_passes(self, pose: HeadPose, code: Float[Tensor, " q"], offsets: Float[Tensor, "k 8"]) -> Posed:
        """The Gaussians in the world, on any device, from what the attribute networks say."""
        log_scales, quats, logits = (self.config.attribute_scale * offsets).split([3, 4, 1], dim=-1)
        quats = self.modes.turned(nn.functional.normalize(self.quats + quats, dim=-1), pose.expression)
        placement = self.skinning.placement(pose)
        return Posed(
            means=placement.moved(self._head_means(pose, code), self.follow),
            quats=placement.turned(quats, self.follow),
            log_scales=self.modes.grown(self.log_scales + log_scales, pose.expression),
            logits=self.opacity_logits + logits[:, 0],
        )

    def _posed_at_once(self, pose: HeadPose, code: Float[Tensor, " q"], offsets: Float[Tensor, "k 8"]) -> Posed:
        """The same in compiled code, 0.87 of the head's time."""
        moved = self._moved(pose, code)
        canonical = Canonical(self.means, self.quats, self.log_scales, self.opacity_logits, self.follow, moved, offsets)
        change = self.modes.change(pose.expression, len(self.means))
        reaches = self.config.deformation_scale, self.config.attribute_scale
        return posed_gaussians(canonical, change, self.skinning.placement(pose).numbers, reaches)

    def _head_means(self, pose: HeadPose, code: Float[Tensor, " q"]) -> Float[Tensor, "k 3"]:
        """Positions in the head frame, metres, given the encoded pose."""
        moved = self.config.deformation_scale * self._moved(pose, code)
        return self.modes.displaced(self.means, pose.expression) + moved

    def _moved(self, pose: HeadPose, code: Float[Tensor, " q"]) -> Float[Tensor, "k 3"]:
        """What the deformation networks say, each component in [-1, 1]."""
        places = positional_encoding(self.means / CANONICAL_UNIT, ENCODING_FREQUENCIES)
        return self.deformation(places, self.expression_weight, pose.expression, code)

    def _tinted(self, pose: HeadPose, code: Float[Tensor, " q"]) -> Float[Tensor, "k c"]:
        """What the colour networks say."""
        return self.colour(self.features, self.expression_weight, pose.expression, code)

    def _offsets(self, pose: HeadPose, code: Float[Tensor, " q"]) -> Float[Tensor, "k 8"]:
        """What the attribute networks say: changes of log-scales, quaternions and opacity logits."""
        return self.attributes(self.features, self.expression_weight, pose.expression, code)


def facing(normals: Float[Tensor, "k 3"]) -> Float[Tensor, "k 4"]:
    """Quaternions (wxyz) that turn the z axis onto the normals or against them, which is the same for a disc."""
    x, y, z = torch.where(normals[:, 2:] < 0, -normals, normals).unbind(-1)
    return nn.functional.normalize(torch.stack([1 + z, -y, x, torch.zeros_like(x)], -1), dim=-1)
