"""The scalp laid out flat: any head's scalp as a round, equal-area texture about the crown."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Float64, Int
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.strands.scalp import Roots

# The projection's axis leans back by so much from +y: the hairline above the forehead is then as far from the axis as
# the hairline of the neck (108 degrees on the open head).
_TILT = math.radians(30)
# Polar angle of the disc's rim. Sideburns reach 117 degrees; a larger disc would leave more of the texture unused.
_RIM = math.radians(125)
_PAIRS_AT_ONCE = 1 << 20


@dataclass(frozen=True)
class ScalpFrame:
    """A sphere laid through a scalp: the origin and the unit of everything that is learnt about hairstyles.

    Points in *scalp units* are measured from the centre in radii, along the axes of the head frame (x to the
    subject's left, y up, z out of the face), so that heads of any size and origin look alike.

    Attributes:
        centre: of the sphere, head frame, metres.
        radius: of the sphere, metres.
    """

    centre: Float[Tensor, "3"]
    radius: float

    @classmethod
    def of(cls, vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"], scalp: Int[Tensor, " s"]) -> ScalpFrame:
        """Fit the sphere to the scalp's surface by least squares, weighted by area.

        The algebraic distance ``|x - centre|^2 - radius^2`` is what is made small: this is a linear problem, and a
        scalp covers so much of its sphere that the bias of this fit on short arcs does not arise.

        Args:
            vertices: the head's mesh, head frame, metres.
            faces: its triangles.
            scalp: indices of the faces that grow hair.

        Raises:
            DynhairError: the scalp has no area, or is flat.
        """
        corners = vertices.detach().double()[faces[scalp]]
        a, b, c = corners.unbind(dim=1)
        areas = torch.linalg.vector_norm(torch.linalg.cross(b - a, c - a, dim=-1), dim=-1)
        if not bool(areas.sum() > 0):
            raise DynhairError("no sphere fits a scalp without area", expected="scalp faces of a mesh")
        # The midpoints of a triangle's edges, equally weighted, integrate quadratic functions exactly.
        points = ((corners + corners.roll(1, dims=1)) / 2).flatten(0, 1)
        weights = areas.repeat_interleave(3)
        origin = torch.einsum("n,nc->c", weights, points) / weights.sum()
        points = points - origin
        spread = torch.einsum("n,nc,nd->cd", weights, points, points)
        cubic = torch.einsum("n,nc,n->c", weights, points, points.square().sum(dim=-1))
        least, *_, greatest = torch.linalg.eigvalsh(spread).tolist()
        if not least > 1e-9 * greatest:
            raise DynhairError("no sphere fits a flat scalp", expected="scalp faces of a head")
        # Normal equations of |x|^2 = 2 centre.x + constant; the constant drops out about the mean.
        centre = torch.linalg.solve(2 * spread, cubic)
        squared = (weights * (points - centre).square().sum(dim=-1)).sum() / weights.sum()
        return cls(centre=(origin + centre).to(vertices), radius=float(squared.sqrt()))

    def to_scalp(self, points: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
        """Turn positions in the head frame (metres) into scalp units."""
        return (points - self.centre.to(points)) / self.radius

    def to_head(self, points: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
        """Turn positions in scalp units into the head frame (metres)."""
        return points * self.radius + self.centre.to(points)

    def uv(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 2"]:
        """Project points onto the scalp texture: Lambert's azimuthal equal-area projection about the crown.

        u grows to the subject's left and v towards the face; the crown is at (0.5, 0.5). Directions beyond the rim of
        the disc, where no scalp is, are drawn in to the rim: whatever the mesh, a point has a place on the texture.

        Args:
            points: head frame, metres; only their directions from the centre matter.

        Returns:
            Texture coordinates within the disc of radius 0.5 about (0.5, 0.5).
        """
        across, forward, axis = _axes(points).unbind()
        direction = torch.nn.functional.normalize(self.to_scalp(points), dim=-1)
        flat = torch.stack([direction @ across, direction @ forward], dim=-1)
        # The plane's radius is sin(polar / 2) and |flat| is sin(polar): twice cos(polar / 2) lies between them.
        height = direction @ axis
        half_cosine = ((1 + height) / 2).clamp_min(1e-12).sqrt()
        disc = flat / (2 * half_cosine * math.sin(_RIM / 2))[:, None]
        # Straight opposite to the crown every place on the rim is as good as any other.
        opposite = (height < 0) & (flat == 0).all(dim=-1)
        disc = torch.where(opposite[:, None], disc.new_tensor([1.0, 0.0]), disc)
        disc = disc / torch.linalg.vector_norm(disc, dim=-1, keepdim=True).clamp_min(1)
        return (0.5 + 0.5 * disc).clamp(0, 1)


def directions(uv: Float[Tensor, "n 2"]) -> Float[Tensor, "n 3"]:
    """Find the unit directions, from a scalp frame's centre, of places on the scalp texture.

    The inverse of :meth:`ScalpFrame.uv`; places outside the disc get the direction of the rim beside them.
    """
    disc = 2 * uv - 1
    disc = disc / torch.linalg.vector_norm(disc, dim=-1, keepdim=True).clamp_min(1)
    flat = disc * math.sin(_RIM / 2)
    squared = flat.square().sum(dim=-1, keepdim=True)
    across, forward, axis = _axes(uv).unbind()
    sides = 2 * (1 - squared).sqrt() * flat
    return sides[:, :1] * across + sides[:, 1:] * forward + (1 - 2 * squared) * axis


def texel_uv(size: int, device: torch.device | str | None = None) -> Float64[Tensor, "t 2"]:
    """List the centres of ``size * size`` texels, row by row: (row i, column j) is at (j + 0.5, i + 0.5) / size."""
    along = (torch.arange(size, dtype=torch.float64, device=device) + 0.5) / size
    v, u = torch.meshgrid(along, along, indexing="ij")
    return torch.stack([u.flatten(), v.flatten()], dim=-1)


def texture_roots(
    vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"], scalp: Int[Tensor, " s"], frame: ScalpFrame, size: int
) -> tuple[Roots, Int[Tensor, " n"]]:
    """Find the place on the scalp of each texel of its texture.

    A ray from the frame's centre through the centre of each texel is met with the scalp's triangles, in float64; of
    several hits the outermost counts. Texels whose rays miss the scalp are invalid and have no root.

    Args:
        vertices: the head's mesh, head frame, metres.
        faces: its triangles.
        scalp: indices of the faces that grow hair.
        frame: of this scalp.
        size: texels along a side.

    Returns:
        One root for each valid texel, and these texels' flat indices (row * size + column), ascending.

    Raises:
        DynhairError: no texel meets the scalp.
    """
    uv = texel_uv(size, vertices.device)
    inside = (2 * uv - 1).square().sum(dim=-1) <= 1
    texels = inside.nonzero().squeeze(1)
    rays = directions(uv[texels])
    triangles = faces[scalp].long()
    corners = frame.to_scalp(vertices.detach().double()[triangles])
    step = max(1, _PAIRS_AT_ONCE // max(1, len(triangles)))
    found = [_outermost_hits(some, corners) for some in rays.split(step)]
    hit, which, barycentric = (torch.cat(parts) for parts in zip(*found, strict=True))
    if not bool(hit.any()):
        raise DynhairError("no texel of the scalp texture meets the scalp", expected="a scalp around its frame")
    which = which[hit]
    roots = Roots(face=scalp[which].long(), triangle=triangles[which], barycentric=barycentric[hit].to(vertices.dtype))
    return roots, texels[hit]


def _axes(like: Tensor) -> Float[Tensor, "3 3"]:
    """The projection's axes as rows: to the subject's left, forwards along the crown, and out of the crown."""
    sine, cosine = math.sin(_TILT), math.cos(_TILT)
    return torch.tensor([[1, 0, 0], [0, sine, cosine], [0, cosine, -sine]], dtype=like.dtype, device=like.device)


def _outermost_hits(
    rays: Float64[Tensor, "r 3"], corners: Float64[Tensor, "t 3 3"]
) -> tuple[Bool[Tensor, " r"], Int[Tensor, " r"], Float64[Tensor, "r 3"]]:
    """Meet rays from the origin with triangles: whether, which, and at which barycentric weights.

    A ray's weights of a triangle's corners are the volumes that it spans with the opposite edges. They are equal on
    both sides of a shared edge, and a rounding error is let pass, so that no ray slips through between two triangles.
    """
    opposite = torch.linalg.cross(corners.roll(-1, dims=1), corners.roll(-2, dims=1), dim=-1)
    volumes = torch.einsum("rc,tkc->rtk", rays, opposite)
    total = volumes.sum(dim=-1)
    weights = volumes / torch.where(total == 0, 1, total)[..., None]
    distance = torch.linalg.det(corners) / torch.where(total == 0, 1, total)
    met = (total != 0) & (distance > 0) & (weights >= -1e-9).all(dim=-1)
    distance, which = torch.where(met, distance, -1.0).max(dim=1)
    chosen = weights.gather(1, which[:, None, None].expand(-1, 1, 3)).squeeze(1).clamp_min(0)
    return distance > 0, which, chosen / chosen.sum(dim=-1, keepdim=True)
