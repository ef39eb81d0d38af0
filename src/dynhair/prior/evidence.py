"""What any number of views say about hair, summed up on a fixed grid around the scalp.

The grid is in scalp units, so that a network that reads it need not know cameras, image sizes, or the head's size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.camera import Camera
from dynhair.render import Gaussians, rasterize
from dynhair.strands.scalp_map import ScalpFrame

VOXEL = 0.2
"""Edge of a voxel in scalp units: about 2 cm."""

LOWEST, HIGHEST = (-2.4, -6.2, -2.4), (2.4, 1.8, 2.4)
"""Corners of the grid in scalp units, x, y, z: as far down as hair of waist length reaches."""

GRID = (24, 40, 24)
"""Voxels along z, y and x, the order of the volume's axes."""

SHARE, CARVED, SEEN, BODY, STRENGTH = range(5)
PLANES = slice(5, 11)
AXES = slice(11, 17)
CHANNELS = 17

_LARGEST_IMAGE = 96
_NEAREST = 0.1
_BODY_MARGIN = 0.2
_HULL_CARVED = 0.2
_HULL_DEPTH = 0.3
_CELL = 1.25 * VOXEL
_CELLS = 64
# xy and xz change their sign in a mirror, of xx, yy, zz, xy, xz, yz.
_MIRRORED_TENSOR = (1.0, 1.0, 1.0, -1.0, -1.0, 1.0)


@dataclass(frozen=True)
class Evidence:
    """Views of hair summed up on the grid, one head or a batch of them.

    Attributes:
        volume: axes of the grid are z, y, x, each rising with the coordinate. Channels:

            - ``SHARE``: of the views that see the voxel (it is inside the image and not behind the body), the share
              whose hair mask covers it;
            - ``CARVED``: ``exp(-n)`` for ``n`` such views whose mask does not: a soft visual hull, 1 if unseen;
            - ``SEEN``: ``n / (n + 4)`` for ``n`` views that see it;
            - ``BODY``: how far in front of the body the voxel is in the view where it is furthest so, in scalp
              units from -1 to 1; negative inside of the body;
            - ``STRENGTH``: ``n / (n + 2)`` for ``n`` views that see hair's direction at the voxel, weighted by
              coherence and by how near the voxel is to the visible surface of the hull;
            - ``PLANES``: the mean of ``m m^T`` over those views (xx, yy, zz, xy, xz, yz), where ``m`` is the unit
              normal of the plane that the image direction back-projects to. The hair's direction in space lies in each
              of these planes: it is the null vector of the tensor;
            - ``AXES``: the tensor's cofactors times 4, which is ``a a^T`` for that direction ``a``, scaled from 0
              (all planes the same: the direction is not known) to 1 (seen from directions at right angles).
    """

    volume: Float[Tensor, "*b c d h w"]

    def mirrored(self) -> Evidence:
        """The evidence of the mirrored head, left and right exchanged."""
        sign = self.volume.new_ones(CHANNELS)
        sign[PLANES] = sign[AXES] = sign.new_tensor(_MIRRORED_TENSOR)
        return Evidence(self.volume.flip(-1) * sign[:, None, None, None])

    @staticmethod
    def batch(parts: Sequence[Evidence]) -> Evidence:
        """Several heads as one batch."""
        return Evidence(torch.stack([part.volume for part in parts]))


def voxel_centres() -> Float[Tensor, "n 3"]:
    """Centres of the voxels in scalp units, in the order of a flattened volume."""
    axes = [low + VOXEL * (torch.arange(count) + 0.5) for low, count in zip(LOWEST[::-1], GRID, strict=True)]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).flip(-1).reshape(-1, 3)


def body_depths(body: Gaussians, cameras: Sequence[Camera]) -> Float[Tensor, "v h w"]:
    """Depths of an opaque body along the optical axes, metres; infinite where there is none."""
    with torch.no_grad():
        rendering = rasterize(body, cameras)
    return torch.where(rendering.alpha > 0.5, rendering.depth, torch.inf)


@torch.no_grad()
def gather_evidence(
    frame: ScalpFrame,
    cameras: Sequence[Camera],
    hair: Float[Tensor, "v h w"],
    direction: Float[Tensor, "v h w 2"],
    body_depth: Float[Tensor, "v h w"],
) -> Evidence:
    """Sum up views of the hair at rest.

    Does not depend on the order of the views, nor on the size or place of the head. Not differentiable.

    Args:
        frame: of the scalp.
        cameras: in the head frame, metres.
        hair: coverage of visible hair in [0, 1].
        direction: its image direction as a doubled angle ``(cos 2a, sin 2a)`` times coherence.
        body_depth: depth of head and body without hair, metres, infinite where there is none.
    """
    views = _Views.of(frame, cameras)
    maps = torch.cat([hair[:, None], direction.movedim(-1, 1)], 1).float()
    factor = max(maps.shape[-2:]) / _LARGEST_IMAGE
    if factor > 1:
        size = [max(1, round(side / factor)) for side in maps.shape[-2:]]
        maps = functional.interpolate(maps, size, mode="area")
    mask, cosine, sine = functional.grid_sample(maps, views.places, align_corners=False).squeeze(-1).unbind(1)
    # Infinite depths would make NaNs of the zeros beyond the images.
    nearest = body_depth.float()[:, None].clamp_max(1e6)
    body = functional.grid_sample(nearest, views.places, mode="nearest", align_corners=False)[:, 0, :, 0]
    ahead = body / frame.radius - views.depth

    weight = (1 + ahead / _BODY_MARGIN).clamp_(0, 1).mul_(views.inside)
    count = weight.sum(0)
    covering = (weight * mask).sum(0)
    volume = torch.zeros(CHANNELS, len(count))
    volume[SHARE] = covering / count.clamp_min(1e-6)
    volume[CARVED] = torch.exp(covering - count)
    volume[SEEN] = count / (count + 4)
    volume[BODY] = torch.where(views.inside > 0, ahead, -torch.inf).amax(0).nan_to_num(neginf=0.0).clamp(-1, 1)

    hull = torch.nonzero((volume[CARVED] > _HULL_CARVED) & (covering > 0.25)).squeeze(1)
    if len(hull):
        seen = views[hull]
        weight = weight[:, hull] * seen.nearness()
        strength, planes = _planes(seen, torch.stack([cosine[:, hull], sine[:, hull]]), weight)
        volume[STRENGTH, hull] = strength / (strength + 2)
        volume[PLANES, hull] = planes
        volume[AXES, hull] = 4 * _cofactors(planes)
    return Evidence(volume.view(CHANNELS, *GRID))


@dataclass(frozen=True)
class _Views:
    """Voxels as the cameras see them; lengths in scalp units.

    Attributes:
        x, y: of the voxels in the image planes at depth 1.
        depth: along the optical axes.
        places: in the images, from -1 to 1.
        inside: 1 for a voxel in the image, else 0.
        distance: depth of the scalp's centre.
        rotation: from the head's axes to the cameras'.
        aspect: of the pixels, focal lengths y / x.
    """

    x: Float[Tensor, "v n"]
    y: Float[Tensor, "v n"]
    depth: Float[Tensor, "v n"]
    places: Float[Tensor, "v n 1 2"]
    inside: Float[Tensor, "v n"]
    distance: Float[Tensor, " v"]
    rotation: Float[Tensor, "v 3 3"]
    aspect: Float[Tensor, " v"]

    @classmethod
    def of(cls, frame: ScalpFrame, cameras: Sequence[Camera]) -> _Views:
        rotation = torch.stack([camera.w2c[:, :3] for camera in cameras]).float()
        offset = torch.stack([camera.w2c[:, 3] for camera in cameras]).float()
        origin = (rotation @ frame.centre.to(rotation) + offset) / frame.radius
        local = rotation @ voxel_centres().T + origin[:, :, None]
        depth = local[:, 2]
        x, y = local[:, :2].div_(depth[:, None].clamp_min(_NEAREST)).unbind(1)
        K = torch.stack([camera.K for camera in cameras]).float()
        halves = torch.tensor([[camera.width / 2, camera.height / 2] for camera in cameras])
        focal, centre = K[:, [0, 1], [0, 1]] / halves, K[:, :2, 2] / halves - 1
        across = torch.addcmul(centre[:, :1], focal[:, :1], x)
        down = torch.addcmul(centre[:, 1:], focal[:, 1:], y)
        inside = (across.abs() < 1) & (down.abs() < 1) & (depth > _NEAREST)
        places = torch.stack([across, down], -1)[:, :, None]
        return cls(x, y, depth, places, inside.float(), origin[:, 2], rotation, K[:, 1, 1] / K[:, 0, 0])

    def __getitem__(self, voxels: Tensor) -> _Views:
        """Some of the voxels."""
        fields = ("x", "y", "depth", "places", "inside")
        return replace(self, **{name: getattr(self, name)[:, voxels] for name in fields})

    def nearness(self) -> Float[Tensor, "v n"]:
        """How near each voxel is to the first of these voxels along the ray: 1 at it, falling to 0 behind it.

        The first is looked up among cells of the image that are a little larger than a voxel at the head.
        """
        size = (_CELL / self.distance.clamp_min(2 * VOXEL))[:, None]
        column, row = ((at / size).floor().long().add_(_CELLS // 2).clamp_(0, _CELLS - 1) for at in (self.x, self.y))
        cell = row * _CELLS + column
        depth = torch.where(self.inside > 0, self.depth, torch.inf)
        first = depth.new_full((len(cell), _CELLS**2), torch.inf).scatter_reduce(1, cell, depth, "amin")
        behind = (self.depth - first.gather(1, cell) - VOXEL / 2).clamp_(min=0)
        return torch.exp(-behind / _HULL_DEPTH)


def _planes(views: _Views, doubled: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Weighted count of directions, and the mean of ``m m^T`` over them, (6, n).

    A point at ``p = (x, y, 1)`` that moves along ``u`` in the image moves in the plane with the normal ``p x u``, which
    is linear in ``u``; and ``u u^T`` is linear in the doubled angle. No angle is ever halved.
    """
    cosine, sine = doubled
    coherence = torch.hypot(cosine, sine)
    # u u^T of unit u, times its coherence; pixels that are not square stretch the directions.
    aspect = views.aspect[:, None]
    xx, yy = (coherence + cosine) / 2, (coherence - cosine) / 2 / aspect**2
    xy = sine / 2 / aspect
    # p x (1, 0, 0) = (0, 1, -y) and p x (0, 1, 0) = (-1, 0, x), so in camera axes the tensor is
    x, y = views.x, views.y
    cross = xy * x - xx * y
    turned = yy * x - xy * y
    local = torch.stack([yy, xx, y * (y * xx - x * xy) + x * turned, -xy, -turned, cross])
    trace = local[:3].sum(0)
    weight = weight * coherence
    local *= weight / trace.clamp_min(1e-9)
    strength = weight.sum(0)
    # Rotate the tensors into the head's axes and add up the views.
    r = views.rotation.mT
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    rows = []
    for i, j in pairs:
        row = [r[:, i, a] * r[:, j, b] + (r[:, i, b] * r[:, j, a] if a != b else 0) for a, b in pairs]
        rows.append(torch.stack(row))
    turn = torch.stack(rows).movedim(-1, 1).reshape(6, -1)  # (6, v * 6)
    total = turn @ local.movedim(1, 0).reshape(-1, local.shape[-1])
    return strength, total / strength.clamp_min(1e-6)


def _cofactors(tensor: Tensor) -> Tensor:
    """Cofactors of symmetric matrices (xx, yy, zz, xy, xz, yz)."""
    xx, yy, zz, xy, xz, yz = tensor
    return torch.stack(
        [
            yy * zz - yz * yz,
            xx * zz - xz * xz,
            xx * yy - xy * xy,
            xz * yz - xy * zz,
            xy * yz - xz * yy,
            xy * xz - xx * yz,
        ]
    )
