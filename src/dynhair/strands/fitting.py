"""Bringing strands of any origin onto a head: unit, axes, place and which end is the root, found from the roots."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.strands.collision import MeshDistance
from dynhair.strands.scalp import sample_roots
from dynhair.strands.similarity import Similarities, closest_similarities

ON_THE_SCALP = 0.005
"""Metres. Strands whose roots lie as near as this, by the median, are in the head frame already."""

OFF_THE_SCALP = 0.01
"""Metres. Strands whose roots lie farther than this, by the median, after the best fit belong to no such head."""

STRAY = 0.02
"""Metres. A strand rooted farther off, such as of a beard or an eyebrow, is left out."""

_COARSE, _FINE = 200, 500  # points to a side
_SHIFTS, _TURNS, _MORE_TURNS = 15, 40, 150  # iterations with axes kept, turned, and turned for good
_FAR = 0.03  # metres between a root and the scalp at which a fit begins to take it for a stray
_COVERING = 0.3  # share of a fit that asks for roots all over the scalp, against roots on the scalp
_RIVALS, _APART = 5, 0.01  # placements that are told apart in earnest, and metres between them
_WIDE = 0.05  # spread of roots that are on the scalp, of the scalp's own
_BARE, _COVERED = 0.05, 0.7  # metres from a root to bare scalp, and how much of a scalp must be nearer to roots
_SAME_PLACE = 1e-3  # spread of ends, by the strands' size, below which they tell nothing
_TURNED = 0.95  # of the residual with axes kept, below which turned ones are believed

# What a placement's residual may be worse by, in metres, if all of its hair falls straight instead of spreading evenly,
# if none is inside the head instead of all, and if the axes are along the head's instead of a radian askew.
_FALLING, _OUTSIDE, _UPRIGHT = 0.002, 0.01, 0.003
_DEEP = 0.01  # metres below the skin where no hair can be, however different the head that it was made for

_REFUSED = {
    "expected": "the hair of one head, rooted all over its scalp",
    "mend": "leave out what is no hair of the head, and check that strands start or end at their roots",
}


@dataclass(frozen=True)
class FittedStrands:
    """Strands on a head: ``x_head = scale * rotation @ x + translation``, then each moved until rooted on the scalp.

    Attributes:
        strands: head frame, metres, root first.
        kept: which of the given strands they are, ascending; strays are left out.
        flipped: whether the given strands were tip first.
        scale: metres per unit of the given strands.
        rotation: from their axes to the head frame's.
        translation: where their origin is in the head frame, metres.
        residual: median distance of the roots to the scalp before the strands were moved onto it, metres.
    """

    strands: Float[Tensor, "k l 3"]
    kept: Int[Tensor, " k"]
    flipped: bool
    scale: float
    rotation: Float[Tensor, "3 3"]
    translation: Float[Tensor, "3"]
    residual: float


def fit_to_scalp(
    strands: Float[Tensor, "n l 3"],
    vertices: Float[Tensor, "v 3"],
    faces: Int[Tensor, "f 3"],
    scalp: Int[Tensor, " s"],
) -> FittedStrands:
    """Place strands of unknown unit and axes on a head.

    Strands that are on the scalp already stay in place. For others a similarity is sought that lays their roots over
    the scalp, by iterative closest points (Besl & McKay, PAMI 1992) both ways, so that the roots neither shrink into
    the scalp nor leave part of it bare, from each of the 24 right-handed ways of naming the axes and from each end of
    the strands. Hair is never mirrored.

    A scalp alone looks much the same from the brow and from the nape, and short hair at its tips as at its roots. Among
    the placements found the hair tells: it falls, it is not in the head, and files seldom have axes askew to the head.
    A turn of a few degrees cannot be told from another hairline, so axes are turned only where the roots ask for it
    clearly.

    Args:
        strands: in any unit, right-handed axes and place; root first or all tip first.
        vertices: the head, head frame (x to the subject's left, y up, z out of the face), metres.
        faces: its triangles.
        scalp: indices of the faces that grow hair.

    Raises:
        DynhairError: there are no strands, they are not finite, or their roots lie on no scalp of this shape.
    """
    if not strands.numel() or strands.shape[1] < 2 or not torch.isfinite(strands).all():
        raise DynhairError(
            f"strands of the shape {tuple(strands.shape)} cannot be placed on a head", expected="finite polylines"
        )
    skin = MeshDistance(vertices, faces[scalp])
    given = strands.detach().cpu().double()
    distances = [_distance(skin, given[:, end], vertices[faces[scalp]]) for end in (0, -1)]
    if min(distances) < ON_THE_SCALP:
        flipped, placement = distances[1] < distances[0], Similarities.identity()
    else:
        flipped, placement = _placed(given, vertices, faces, scalp)
    placed = placement.apply(given.flip(1) if flipped else given)
    gaps, closest = (found.cpu().double() for found in skin.query(placed[:, 0]))
    residual = float(gaps.abs().median())
    if not residual <= OFF_THE_SCALP:
        raise DynhairError(
            "the roots do not lie on a scalp of this shape: "
            f"the best fit, {float(placement.scale):.4g} m a unit, leaves them {1000 * residual:.0f} mm off",
            **_REFUSED,
        )
    kept = (gaps.abs() <= STRAY).nonzero()[:, 0]
    moved = placed + (closest - placed[:, 0])[:, None]
    return FittedStrands(
        strands=moved[kept].to(strands),
        kept=kept.to(strands.device),
        flipped=flipped,
        scale=float(placement.scale),
        rotation=placement.rotation[0].to(strands),
        translation=placement.translation[0].to(strands),
        residual=residual,
    )


def _distance(skin: MeshDistance, roots: Tensor, triangles: Tensor) -> float:
    """Median distance of roots to the scalp; that of a groom too small to be on it, but beside it, is infinite."""
    is_wide = roots.std(dim=0, correction=0).norm() > _WIDE * triangles.flatten(0, 1).std(dim=0, correction=0).norm()
    return float(skin.query(roots)[0].abs().median()) if is_wide else float("inf")


def _placed(strands: Tensor, vertices: Tensor, faces: Tensor, scalp: Tensor) -> tuple[bool, Similarities]:
    """The likeliest placement that lays either end of the strands over the scalp, and whether that end is the last."""
    order = torch.randperm(len(strands), generator=torch.Generator().manual_seed(0))
    strands = strands[order[:_FINE]]
    ends = torch.stack([strands[:, 0], strands[:, -1]])
    # Hair pulls from either end towards its middle; how strongly it does so all in one direction shows that it falls.
    pull = torch.nn.functional.normalize(strands.mean(dim=1) - ends, dim=-1).mean(dim=1)
    targets = sample_roots(vertices, faces, scalp, _FINE, seed=0).positions(vertices).detach().cpu().double()

    axes = _axis_rotations()
    spread = ends.std(dim=1, correction=0).norm(dim=-1)
    spreading = (spread > _SAME_PLACE * (ends - ends[0, 0]).abs().amax()).nonzero()[:, 0]
    if not len(spreading):
        raise DynhairError("the strands all start and all end at one place", expected="hair rooted all over a scalp")
    tips = spreading.repeat_interleave(len(axes))
    coarse = ends[tips, :_COARSE]
    placements = _over(coarse, targets[:_COARSE], axes.repeat(len(spreading), 1, 1))
    placements, residuals = _iterated(placements, coarse, targets[:_COARSE], _SHIFTS, turn=False)
    costs = residuals + _unlikeliness(placements, pull[tips], axes)
    rivals = _distinct(placements.apply(coarse), tips, costs)

    tips = tips[rivals]
    kept, residuals = _iterated(placements[rivals], ends[tips], targets, _SHIFTS, turn=False)
    turned, turned_residuals = _iterated(kept, ends[tips], targets, _TURNS, turn=True)
    is_turned = turned_residuals < _TURNED * residuals
    placements = turned.where(is_turned, kept)
    body = placements.apply(strands[:, :: 1 + strands.shape[1] // 8].reshape(1, -1, 3))
    depths = MeshDistance(vertices, faces).query(body.reshape(-1, 3))[0].cpu().view(len(rivals), -1)
    costs = torch.where(is_turned, turned_residuals, residuals) + _unlikeliness(placements, pull[tips], axes)
    best = int((costs + _OUTSIDE * (depths < -_DEEP).double().mean(dim=1)).argmin())
    placement = placements[[best]]
    if is_turned[best]:
        placement, _ = _iterated(placement, ends[tips[[best]]], targets, _MORE_TURNS, turn=True)
    covered = torch.cdist(targets, placement.apply(ends[tips[[best]]])[0]).amin(dim=1) < _BARE
    if covered.double().mean() < _COVERED:
        raise DynhairError(
            "the roots do not lie on a scalp of this shape: "
            f"the best fit leaves {100 * (1 - float(covered.double().mean())):.0f}% of it bare",
            **_REFUSED,
        )
    return bool(tips[best]), placement


def _axis_rotations() -> Float[Tensor, "24 3 3"]:
    """All right-handed ways of naming the axes."""
    signed = [
        torch.eye(3, dtype=torch.float64)[list(order)] * torch.tensor(signs, dtype=torch.float64)[:, None]
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1, -1), repeat=3)
    ]
    return torch.stack([axes for axes in signed if torch.linalg.det(axes) > 0])


def _over(points: Tensor, targets: Tensor, rotations: Tensor) -> Similarities:
    """Similarities with given rotations that bring the points' centre and spread to the targets'."""
    centres, centre = points.mean(dim=1, keepdim=True), targets.mean(dim=0)
    spread = (points - centres).square().sum(dim=-1).mean(dim=-1).sqrt()
    scales = (targets - centre).square().sum(dim=-1).mean().sqrt() / spread
    shifts = centre - scales[:, None] * torch.einsum("hij,hj->hi", rotations, centres[:, 0])
    return Similarities(scales, rotations, shifts)


def _iterated(
    placements: Similarities, points: Tensor, targets: Tensor, steps: int, *, turn: bool
) -> tuple[Similarities, Tensor]:
    """Iterate closest points both ways; also the root mean square of the distances left, far ones bounded."""
    targets = targets.expand(len(points), -1, -1)
    for _ in range(steps):
        distances, there, back = _pairs(placements.apply(points), targets)
        # Geman and McClure's weights: strays do little, and a hairline a centimetre off is still heard.
        weights = (1 + (distances / _FAR).square()).pow(-2)
        placements = closest_similarities(
            torch.cat([points, _rows(points, back)], dim=1),
            torch.cat([_rows(targets, there), targets], dim=1),
            weights * _shares(there, back),
            rotation=None if turn else placements.rotation,
        )
    distances, there, back = _pairs(placements.apply(points), targets)
    bounded = distances.square() / (1 + (distances / _FAR).square())
    return placements, (bounded * _shares(there, back)).sum(dim=1).sqrt()


def _pairs(points: Tensor, targets: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Distances of all points and then of all targets to their nearest, each point's target, each target's point."""
    distances = torch.cdist(points, targets)
    (to_target, there), (to_point, back) = distances.min(dim=2), distances.min(dim=1)
    return torch.cat([to_target, to_point], dim=1), there, back


def _shares(there: Tensor, back: Tensor) -> Tensor:
    """Weights of the pairs from roots to scalp and of those back, however many there are."""
    ways = ((there, 1 - _COVERING), (back, _COVERING))
    return torch.cat([torch.full(way.shape, share / way.shape[1], dtype=torch.float64) for way, share in ways], dim=1)


def _rows(table: Tensor, index: Tensor) -> Tensor:
    return table.gather(1, index[..., None].expand(-1, -1, 3))


def _unlikeliness(placements: Similarities, pull: Tensor, axes: Tensor) -> Tensor:
    """Metres that a placement's residual is worth more, for hair that does not fall and for axes askew."""
    falling = -(placements.rotation @ pull[..., None])[:, 1, 0]
    traces = torch.einsum("hij,aij->ha", placements.rotation, axes).amax(dim=1)
    askew = torch.arccos(((traces - 1) / 2).clamp(-1, 1))
    return _UPRIGHT * askew - _FALLING * falling


def _distinct(placed: Tensor, tips: Tensor, costs: Tensor) -> list[int]:
    """The best placements, of which no two put the same end at nearly the same places."""
    found: list[int] = []
    for index in costs.argsort().tolist():
        others = [other for other in found if tips[other] == tips[index]]
        if all((placed[index] - placed[other]).norm(dim=-1).mean() > _APART for other in others):
            found.append(index)
    return found[:_RIVALS]
