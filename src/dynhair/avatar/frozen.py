"""An avatar that is trained and only drawn: the same images sooner."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.avatar import Avatar
from dynhair.avatar.deformer import HairDeformer
from dynhair.avatar.drawing import AvatarImages, PosedAvatar
from dynhair.avatar.encoding import CANONICAL_UNIT, ENCODING_FREQUENCIES, positional_encoding
from dynhair.avatar.frozen_deformers import frozen_deformer
from dynhair.avatar.frozen_layers import FrozenBranches
from dynhair.avatar.hair import Hair
from dynhair.avatar.head import Head
from dynhair.avatar.head_pose import HeadPose
from dynhair.camera import Camera
from dynhair.capture import HeadTrack
from dynhair.native import for_kernels
from dynhair.strands import smooth_strands, with_lengths
from dynhair.threads import beside, thread_count


class FrozenHair(Hair):
    """Hair whose parameters do not change (:meth:`Avatar.frozen`).

    What the deformer says of the knots goes through spline, attenuation and low-pass in one product.

    Args:
        hair: whose parameters it shares.
    """

    @torch.no_grad()
    def __init__(self, hair: Hair) -> None:
        nn.Module.__init__(self)
        vars(self).update(vars(hair))
        self._rest = smooth_strands(hair.strands)
        self._frozen = frozen_deformer(hair.deformer) if isinstance(hair.deformer, HairDeformer) else None
        if self._frozen is not None:
            points = hair.strands.shape[1]
            unit = torch.eye(points).to(self._rest)[..., None].expand(-1, -1, 3)
            self._from_knots = smooth_strands(unit)[..., 0].T @ self._frozen.spread

    @torch.no_grad()
    def forward(self, window: Float[Tensor, "t c"] | None) -> Float[Tensor, "n l 3"]:
        """As :meth:`Hair.forward`."""
        if window is None or self._frozen is None:
            return self._rest
        at_knots = self._frozen.at_knots(window)
        moved = (self._from_knots @ at_knots.view(self._from_knots.shape[1], -1)).view(len(self._from_knots), -1, 3)
        strands = self._rest + moved.transpose(0, 1)
        return with_lengths(strands, self._rest) if self.deformer.config.inextensible else strands


class FrozenHead(Head):
    """A head whose parameters do not change (:meth:`Avatar.frozen`).

    Args:
        head: whose parameters it shares.
    """

    @torch.no_grad()
    def __init__(self, head: Head) -> None:
        nn.Module.__init__(self)
        vars(self).update(vars(head))
        places = positional_encoding(head.means / CANONICAL_UNIT, ENCODING_FREQUENCIES)
        self._moves = FrozenBranches(head.deformation, places, head.expression_weight)
        self._tints = FrozenBranches(head.colour, head.features, head.expression_weight)
        self._changes = FrozenBranches(head.attributes, head.features, head.expression_weight)

    def _moved(self, pose: HeadPose, code: Float[Tensor, " q"]) -> Float[Tensor, "k 3"]:
        return self._moves(pose.expression, code)

    def _tinted(self, pose: HeadPose, code: Float[Tensor, " q"]) -> Float[Tensor, "k c"]:
        return self._tints(pose.expression, code)

    def _offsets(self, pose: HeadPose, code: Float[Tensor, " q"]) -> Float[Tensor, "k 8"]:
        return self._changes(pose.expression, code)


class FrozenAvatar(Avatar):
    """An avatar whose parameters do not change, without gradients (:meth:`Avatar.frozen`).

    What depends on parameters alone is worked out once, the conditions of a track once a track, and what hears the
    expression or the pose only when that changes. Hair and head are posed side by side where there are two threads.

    Args:
        avatar: whose tensors it shares. Neither they nor their device may change afterwards.
    """

    def __init__(self, avatar: Avatar) -> None:
        nn.Module.__init__(self)
        vars(self).update(vars(avatar))
        self._modules = {**avatar._modules}
        if for_kernels(self.background):
            self.hair, self.head = FrozenHair(avatar.hair), FrozenHead(avatar.head)
        self._known: tuple[HeadTrack, Tensor] | None = None

    def frozen(self) -> FrozenAvatar:
        """Itself."""
        return self

    @torch.no_grad()
    def conditions(self, track: HeadTrack) -> Float[Tensor, "f c"]:
        """As :meth:`Avatar.conditions`, from memory for the track of the call before."""
        if self._known is None or self._known[0] is not track:
            self._known = track, super().conditions(track)
        return self._known[1]

    @torch.no_grad()
    def posed(self, pose: HeadPose, window: Float[Tensor, "t c"] | None) -> PosedAvatar:
        """As :meth:`Avatar.posed`."""
        if thread_count() == 1 or self.background.is_cuda:
            return super().posed(pose, window)
        head = beside(torch.no_grad()(lambda: self.head(pose)))
        strands = self.hair(window) @ pose.rotation.T + pose.translation
        return self.with_strands(strands, head())

    @torch.no_grad()
    def draw(self, posed: PosedAvatar, cameras: Sequence[Camera]) -> AvatarImages:
        """As :meth:`Avatar.draw`."""
        return super().draw(posed, cameras)
