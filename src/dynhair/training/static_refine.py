"""Refinement of groomed strands by gradient descent on what the views of the hair at rest show."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float, Int
from pykdtree.kdtree import KDTree
from scipy.interpolate import BSpline
from torch import Tensor

from dynhair.losses import (
    length_loss,
    penetration_loss,
    sample_strand_points,
    segmentation_loss,
    shape_loss,
    smoothness_loss,
)
from dynhair.render import Gaussians
from dynhair.strands import MeshDistance, resample_strands, root_neighbours, smooth_strands
from dynhair.strands.groom import push_out
from dynhair.training.static_groom import orientation_error
from dynhair.training.static_scene import render_hair
from dynhair.training.static_views import RestViews

# Supplement B. The paper's squared lengths are in canonical units of about 0.1 m, ours in metres: times 1 / 0.1^2.
_SEGMENTATION = 1.0
_ORIENTATION = 0.5
_PENETRATION = 20.0 * 100
_SHAPE = 0.001
_SMOOTHNESS = 0.001 * 100
_LENGTH = 0.001 * 100

_NEIGHBOURS = 4
_CONTROLS = 7
_VIEWS = 2
_CHECKED_POINTS = 2000
_RATE_SHARED, _RATE_OWN = 2e-3, 6e-4
_STRANDS_PER_GUIDE = 12
_GUIDES = (16, 160)
_COARSE, _MIDDLE = 0.25, 0.55
_CLEARANCE = 5e-4


def refine_strands(
    strands: Float[Tensor, "n l 3"],
    width: float,
    obstacle: MeshDistance,
    body: Gaussians,
    views: RestViews,
    *,
    iterations: int,
    seed: int,
    progress: Callable[[int, float], None],
) -> Float[Tensor, "n l 3"]:
    """Move strands so that they look like the hair in the views.

    A strand is displaced by a cubic B-spline over its arc length that leaves the root in place: it cannot zigzag. The
    displacement is the sum of the strand's own and one shared with the strands beside it, interpolated from guides, so
    that strands which no view sees go along with those above them. Images begin small: a silhouette pulls on strands
    that are within a pixel or two of it.

    Args:
        strands: where to begin, head frame, metres.
        width: of a strand, metres.
        obstacle: head and torso in the head frame.
        body: the same as opaque Gaussians, without hair.
        views: of the hair at rest.
        iterations: steps of Adam.
        seed: of the views' order.
        progress: called after each step with its number and loss.

    Returns:
        Strands outside of the obstacle, the segments of each nearly equal.
    """
    generator = torch.Generator().manual_seed(seed)
    basis = _basis(strands.shape[1])
    guides, shares = _guides(strands)
    shared = torch.zeros(int(guides.max()) + 1, _CONTROLS, 3, requires_grad=True)
    own = torch.zeros(len(strands), _CONTROLS, 3, requires_grad=True)
    optimizer = torch.optim.Adam([{"params": [shared], "lr": _RATE_SHARED}, {"params": [own], "lr": _RATE_OWN}])
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, max(iterations, 1))
    neighbours = root_neighbours(strands[:, 0], min(_NEIGHBOURS, len(strands) - 1))
    longer = max(views.hair.shape[1:])
    sizes = [views.resized(max(longer // 4, 64)), views.resized(max(longer // 2, 64)), views]

    def moved() -> Tensor:
        controls = own + (shares[..., None, None] * shared[guides]).sum(1)
        return strands + torch.einsum("lk,nkd->nld", basis, controls)

    order: list[int] = []
    for step in range(iterations):
        done = step / iterations
        size = sizes[(done >= _COARSE) + (done >= _MIDDLE)]
        if len(order) < _VIEWS:
            order += torch.randperm(len(views), generator=generator).tolist()
        chosen, order = size[order[:_VIEWS]], order[_VIEWS:]
        current = moved()
        images = render_hair(current, width, body, chosen.cameras)
        points = sample_strand_points(current, _CHECKED_POINTS, generator=generator)
        loss = (
            _SEGMENTATION * segmentation_loss(images.coverage, chosen.hair)
            + _ORIENTATION * orientation_error(images, chosen)
            + _PENETRATION * penetration_loss(points, obstacle)
            + _SHAPE * shape_loss(current, neighbours)
            + _SMOOTHNESS * smoothness_loss(current, neighbours)
            + _LENGTH * length_loss(current, neighbours)
        )
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        schedule.step()
        progress(step + 1, float(loss.detach()))
    with torch.no_grad():
        return _finished(moved(), obstacle)


def _basis(points: int) -> Float[Tensor, "l k"]:
    """Cubic B-splines on clamped, uniform knots at the strand's points, without the one that would move the root."""
    knots = np.concatenate([np.zeros(3), np.linspace(0, 1, _CONTROLS - 1), np.ones(3)])
    matrix = BSpline.design_matrix(np.linspace(0, 1, points), knots, 3).toarray()
    return torch.from_numpy(matrix[:, 1:]).float()


def _guides(strands: Float[Tensor, "n l 3"]) -> tuple[Int[Tensor, "n g"], Float[Tensor, "n g"]]:
    """For each strand the guides that it goes along with, and its shares in them.

    Roots come in random order, so that the first strands cover the scalp: they are the guides. Strands belong together
    that run side by side from root to tip; near roots alone would tie hair across the parting.
    """
    count = min(max(len(strands) // _STRANDS_PER_GUIDE, _GUIDES[0]), _GUIDES[1], len(strands))
    middle = strands.shape[1] // 2
    courses = np.ascontiguousarray(strands[:, [0, middle, -1]].flatten(1).numpy())
    distances, guides = KDTree(courses[:count]).query(courses, k=min(3, count))
    distances = torch.from_numpy(np.asarray(distances)).reshape(len(strands), -1)
    shares = torch.softmax(-distances.square() / 0.03**2, dim=1)
    return torch.from_numpy(np.asarray(guides).astype(np.int64)).reshape(len(strands), -1), shares


def _finished(strands: Tensor, obstacle: MeshDistance) -> Tensor:
    """Strands outside of the obstacle; their segments are equal but for the last push outwards."""
    for _ in range(3):
        smooth = smooth_strands(_outside(strands, obstacle))
        strands = resample_strands(smooth, strands.shape[1])
    return _outside(strands, obstacle)


def _outside(strands: Tensor, obstacle: MeshDistance) -> Tensor:
    free = push_out(strands[:, 1:].flatten(0, 1), obstacle, _CLEARANCE)
    return torch.cat([strands[:, :1], free.view_as(strands[:, 1:])], 1)
