"""A posed avatar as cameras see it: hair, scalp and head in one pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import interpolate, pad

from dynhair.avatar.drawn_hair import COLOURS, drawn_hair
from dynhair.avatar.head import HeadGaussians
from dynhair.avatar.layers import layers
from dynhair.avatar.scalp_layer import CoveredScalp, ScalpLayer
from dynhair.avatar.super_resolution import SuperResolution
from dynhair.camera import Camera
from dynhair.editing import HairLook
from dynhair.errors import DynhairError
from dynhair.render import rasterize
from dynhair.strands import decode_orientation, strands_and_body


@dataclass(frozen=True)
class PosedAvatar:
    """An avatar in one frame.

    Attributes:
        strands: in the world, metres.
        head: the head's Gaussians, in the world.
        hair: which of the avatar's strands these are, how wide, and in which colours.
    """

    strands: Float[Tensor, "m l 3"]
    head: HeadGaussians
    hair: HairLook


class AvatarImages(NamedTuple):
    """What the cameras see.

    Attributes:
        rgb: colour over the avatar's background.
        hair: visible hair coverage in [0, 1].
        body: visible coverage of head and upper body in [0, 1].
        direction: hair's image direction as a doubled angle (cos 2a, sin 2a), weighted by its coverage.
        alpha: coverage of everything.
        coarse: the colours as they are drawn, before super-resolution; None without it.
        depth: of what is drawn along the viewing axis, metres, 0 where there is nothing; None where it is not known.
    """

    rgb: Float[Tensor, "v h w 3"]
    hair: Float[Tensor, "v h w"]
    body: Float[Tensor, "v h w"]
    direction: Float[Tensor, "v h w 2"]
    alpha: Float[Tensor, "v h w"]
    coarse: Float[Tensor, "v y x 3"] | None = None
    depth: Float[Tensor, "v h w"] | None = None

    @property
    def orientation(self) -> Float[Tensor, "v h w"]:
        """The hair's undirected image direction in [0, 1) of pi."""
        return decode_orientation(self.direction)


def draw_avatar(
    posed: PosedAvatar,
    cameras: Sequence[Camera],
    scalp: ScalpLayer,
    background: Float[Tensor, "3"],
    super_resolution: SuperResolution | None = None,
) -> AvatarImages:
    """Draw hair and head together in one pass: colour, labels, hair direction.

    With super-resolution, the pass is smaller than the cameras' images by its factor; a network makes the colours
    of the full size, and the rest is enlarged bilinearly.

    Args:
        posed: hair and head in the world.
        cameras: the views, all of one size.
        scalp: what makes the skin under the hair count as hair.
        background: colour behind everything.
        super_resolution: the network; none if left out.

    Raises:
        DynhairError: with super-resolution, the images' sides are not multiples of its factor.
    """
    cameras = [camera.to(background.device) for camera in cameras]
    drawn = cameras if super_resolution is None else _reduced(cameras, super_resolution.factor)
    head, look = posed.head, posed.hair
    hair = drawn_hair(posed.strands, look.widths, look.base_harmonic, look.higher_harmonics, drawn)
    further = head.colours.shape[1] - 3
    hair_features = pad(hair.features, (0, further)) if further else hair.features
    head_features = _head_features(head, scalp(hair.features[..., COLOURS], look))
    gaussians = strands_and_body(hair, head, torch.cat([hair_features, head_features], 1))
    images = rasterize(gaussians, drawn)
    seen, hair_seen, body, direction = layers(images.features, images.alpha, pad(background, (0, further)))
    if super_resolution is None:
        return AvatarImages(seen, hair_seen, body, direction, images.alpha, depth=images.depth)
    maps = torch.stack([hair_seen, body, *direction.unbind(-1), images.alpha, images.depth], 1)
    size = (cameras[0].height, cameras[0].width)
    hair_seen, body, x, y, alpha, depth = interpolate(maps, size, mode="bilinear").unbind(1)
    direction = torch.stack([x, y], -1)
    return AvatarImages(super_resolution(seen), hair_seen, body, direction, alpha, seen[..., :3], depth)


def _reduced(cameras: Sequence[Camera], factor: int) -> list[Camera]:
    """The cameras at the size that is drawn before super-resolution."""
    width, height = cameras[0].width, cameras[0].height
    if width % factor or height % factor:
        raise DynhairError(
            f"an image of {width} x {height} pixels",
            expected=f"sides that are multiples of {factor}, the factor of the avatar's super-resolution",
        )
    return [camera.resized(width // factor, height // factor) for camera in cameras]


def _head_features(head: HeadGaussians, scalp: CoveredScalp) -> Float[Tensor, "v k f"]:
    """Labels, direction and colours of the head's Gaussians; the scalp's are partly hair, of no direction."""
    count, channels = head.colours.shape
    own = torch.cat([head.colours.new_tensor([0.0, 1.0, 0.0, 0.0]).expand(count, 4), head.colours], 1)
    rows, cover, colours = scalp
    as_hair = colours.new_tensor([1.0, 0.0, 0.0, 0.0]).expand(*colours.shape[:2], 4)
    as_hair = pad(torch.cat([as_hair, colours], -1), (0, channels - 3))
    covered = torch.lerp(own[rows].expand_as(as_hair), as_hair, cover[:, None])
    return own.expand(len(colours), -1, -1).index_copy(1, rows, covered)
