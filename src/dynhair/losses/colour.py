"""Coherent colours of hair: along strands and across them (paper, "Hair color regularization").

A strand's colours are those of its Gaussians, root first. They come with channels leading, as the hair keeps them:
``hair.base_harmonic.view(3, n, l)`` needs no copy. Squares are summed over channels and averaged over Gaussians, as the
paper has it. The losses are squares, so coefficients of degree 0, which are colours times ``sqrt(4 pi)``, cost ``4 pi``
times as much as the colours themselves: divide the weight by that.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int64
from pykdtree.kdtree import KDTree
from torch import Tensor

from dynhair.errors import DynhairError


def colour_gradient_loss(colours: Float[Tensor, "c n l"]) -> Float[Tensor, ""]:
    """The paper's ``L_cg``: squared changes between consecutive Gaussians of a strand, summed and divided by N L.

    Args:
        colours: of ``n`` strands with ``l`` Gaussians each.
    """
    return _mean_square(colours[..., 1:] - colours[..., :-1], colours[0].numel())


def colour_consistency_loss(colours: Float[Tensor, "c n l"]) -> Float[Tensor, ""]:
    """The paper's ``L_cc``: squared deviation from the strand's mean colour, averaged over Gaussians.

    Args:
        colours: of ``n`` strands with ``l`` Gaussians each.
    """
    return _mean_square(colours - colours.mean(dim=-1, keepdim=True), colours[0].numel())


def colour_spatial_loss(
    colours: Float[Tensor, "c n l"], neighbours: Int64[Tensor, "n*l k"], *, part: int = 0, parts: int = 1
) -> Float[Tensor, ""]:
    """The paper's ``L_cs``: squared differences to the nearest Gaussians of other strands, averaged over pairs.

    The pairs can be shared out among steps: part ``i`` of ``p`` holds the pairs of Gaussians ``i, i + p, i + 2 p, ..``
    and is scaled such that the mean over all parts is the whole loss, and so are the gradients.

    Args:
        colours: of ``n`` strands with ``l`` Gaussians each.
        neighbours: of each Gaussian, strand by strand, as :func:`colour_neighbours` finds them.
        part: which part to compute, such as the number of the step modulo ``parts``.
        parts: into how many the pairs are shared out.
    """
    # One column of neighbours after the other, so that each lies as its Gaussians do.
    pairs, count, colours = neighbours.numel(), len(colours), colours.flatten(1)
    near = neighbours[part::parts].T
    others = colours.index_select(1, near.flatten()).view(count, *near.shape)
    return parts * _mean_square(colours[:, None, part::parts] - others, pairs)


def colour_neighbours(means: Float[Tensor, "n l 3"], k: int) -> Int64[Tensor, "n*l {k}"]:
    """Find the ``k`` Gaussians of other strands that are nearest to each Gaussian, nearest first.

    Args:
        means: of the Gaussians of each strand, metres.
        k: neighbours for each; the paper takes 8.

    Returns:
        Indices into the Gaussians, strand by strand.

    Raises:
        DynhairError: there are not that many Gaussians on other strands, or a mean is not finite.
    """
    strands, length, _ = means.shape
    others = (strands - 1) * length
    if not 0 < k <= others:
        raise DynhairError(
            f"cannot find {k} neighbours on other strands among {strands} strands of {length} Gaussians",
            expected=f"1 to {others} neighbours" if others > 0 else "two strands or more, of two points or more",
        )
    points = np.ascontiguousarray(means.detach().flatten(0, 1).cpu().numpy())
    if not np.isfinite(points).all():
        raise DynhairError("strands that are not finite have no neighbours", expected="finite strands")
    tree = KDTree(points)
    neighbours = np.empty((len(points), k), np.int64)
    left, reach = np.arange(len(points)), min(2 * k, k + length)
    while len(left):  # the nearest k + length Gaussians are enough for all, for a strand has no more than length
        _, found = tree.query(points[left], k=reach)
        found = found.astype(np.int64)
        other = found // length != left[:, None] // length
        enough = other.sum(axis=1) >= k
        first = np.argsort(~other[enough], axis=1, kind="stable")[:, :k]
        neighbours[left[enough]] = np.take_along_axis(found[enough], first, axis=1)
        left, reach = left[~enough], min(2 * reach, k + length)
    return torch.from_numpy(neighbours).to(means.device)


def _mean_square(differences: Float[Tensor, "..."], count: int) -> Float[Tensor, ""]:
    differences = differences.flatten()
    return differences.dot(differences) / max(count, 1)
