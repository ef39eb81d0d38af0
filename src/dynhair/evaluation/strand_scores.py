"""How near reconstructed strands come to true ones: precision and recall of place and direction.

The figures of the literature on strand reconstruction (Nam et al., "Strand-accurate multi-view hair capture", 2019;
NeuralHaircut, 2023). Both hairstyles become points with directions, closely along the strands. A point matches the
other hairstyle if any point of that one lies within a distance and runs within an angle of it, either way round.
Precision is the share of reconstructed points that match, recall the share of true ones, and the F-score their harmonic
mean. All of it counts, hidden hair too: a layer of few strands may look right and still recalls little.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree
from torch import Tensor

from dynhair.errors import DynhairError

THRESHOLDS = ((0.002, 20.0), (0.003, 30.0), (0.004, 40.0))
"""Pairs of distance, metres, and angle, degrees, as in the literature."""

STEP = 0.001
"""Metres between points along a strand, at most."""

QUERIES = 100_000
"""Points of either hairstyle that look for a match, at most; they may find it among all points of the other."""

_FIRST_NEIGHBOURS = 8
_MORE_NEIGHBOURS = 8
_PAIRS_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class StrandScore:
    """Precision, recall and F-score at one threshold, each in [0, 1].

    Attributes:
        distance: of a match at most, metres.
        angle: between the directions of a match at most, degrees.
        precision: share of the reconstructed hair that is where true hair is.
        recall: share of the true hair that has been reconstructed.
        f: their harmonic mean; 0 where both are.
    """

    distance: float
    angle: float
    precision: float
    recall: float
    f: float

    def to_json(self) -> dict[str, float]:
        """Lay out the figures by name."""
        return asdict(self)


@dataclass(frozen=True)
class _Points:
    """Points along strands with the unit directions of the strands there."""

    positions: Float[np.ndarray, "p 3"]
    directions: Float[np.ndarray, "p 3"]

    def sample(self, count: int, generator: np.random.Generator) -> _Points:
        """Draw different points, all if there are no more."""
        if len(self.positions) <= count:
            return self
        chosen = generator.choice(len(self.positions), count, replace=False)
        return _Points(self.positions[chosen], self.directions[chosen])


def strand_scores(
    predicted: Float[Tensor, "n l 3"],
    truth: Float[Tensor, "m k 3"],
    thresholds: Sequence[tuple[float, float]] = THRESHOLDS,
    *,
    step: float = STEP,
    queries: int = QUERIES,
    seed: int = 0,
) -> list[StrandScore]:
    """Score reconstructed strands against true ones, both in the same frame, metres.

    Each strand is sampled at equal steps of its length. Of each hairstyle's points ``queries`` drawn at random look for
    a match among *all* points of the other; the standard error of a share is then 0.0016 at most.

    Args:
        predicted: the reconstruction.
        truth: the true strands.
        thresholds: pairs of distance, metres, and angle between undirected directions, degrees up to 90.
        step: metres between points along a strand, at most.
        queries: points of either side that look for a match, at most.
        seed: of their choice.

    Returns:
        A score for each threshold.

    Raises:
        DynhairError: strands are not finite, or none has any length.
    """
    ours, true = _along(predicted, step, "reconstructed"), _along(truth, step, "true")
    generator = np.random.default_rng(seed)
    precisions = _matched(ours.sample(queries, generator), true, thresholds).mean(axis=0)
    recalls = _matched(true.sample(queries, generator), ours, thresholds).mean(axis=0)
    return [
        StrandScore(distance, angle, float(precision), float(recall), _harmonic_mean(float(precision), float(recall)))
        for (distance, angle), precision, recall in zip(thresholds, precisions, recalls, strict=True)
    ]


def _along(strands: Float[Tensor, "n l 3"], step: float, kind: str) -> _Points:
    """Points in the middles of equal pieces of each strand, with the directions of the segments they lie on."""
    points = strands.detach().cpu().double().numpy()
    if not np.isfinite(points).all():
        raise DynhairError(f"the {kind} strands are not finite", expected="positions in metres")
    segments = np.diff(points, axis=1)
    lengths = np.linalg.norm(segments, axis=-1)
    totals = lengths.sum(axis=1)
    if not totals.any():
        raise DynhairError(f"none of the {kind} strands has any length", expected="strands of two or more points")

    pieces = np.ceil(totals / step).astype(np.int64)
    strand = np.repeat(np.arange(len(points)), pieces)
    place = np.arange(len(strand)) - np.repeat(np.cumsum(pieces) - pieces, pieces)  # among the strand's own pieces
    share = (place + 0.5) / pieces[strand]
    # Strands end to end, so that one search serves them all; each strand's own length counts as one.
    ends = lengths.cumsum(axis=1) / np.where(totals, totals, 1.0)[:, None]
    ends[:, -1] = 1.0
    ends += np.arange(len(points))[:, None]
    segment = np.searchsorted(ends.ravel(), strand + share, side="right") - strand * lengths.shape[1]

    chosen = (strand, segment)
    length = np.maximum(lengths[chosen], np.finfo(np.float64).tiny)
    before = (lengths.cumsum(axis=1) - lengths)[chosen]
    directions = segments[chosen] / length[:, None]
    along = np.clip(share * totals[strand] - before, 0.0, length)
    return _Points(points[chosen] + along[:, None] * directions, directions)


def _matched(queries: _Points, targets: _Points, thresholds: Sequence[tuple[float, float]]) -> Bool[np.ndarray, "q t"]:
    """Which queries have a target within each threshold.

    The nearest target often matches. Queries without a match look at more and more of their neighbours, until these lie
    beyond the distance: exact, and most queries look at few.
    """
    # Points along curves make a tree that needs no balance: built in a third of the time, it is searched as fast.
    tree = KDTree(targets.positions, balanced_tree=False, compact_nodes=False)
    distances, angles = np.array(thresholds, np.float64).T
    cosines = np.cos(np.radians(angles))
    reach = distances.max() * (1 + 1e-9)  # beyond which the tree finds nothing: it leaves out the bound itself
    matched = np.zeros((len(queries.positions), len(distances)), bool)
    pending = np.arange(len(queries.positions))
    count = _FIRST_NEIGHBOURS
    while len(pending):
        count = min(count, len(targets.positions))
        open_ = []
        parts = min(len(pending), math.ceil(len(pending) * count / _PAIRS_AT_ONCE))
        for some in np.array_split(pending, parts):
            far, nearest = tree.query(queries.positions[some], count, distance_upper_bound=reach)
            far, nearest = far.reshape(-1, count), nearest.reshape(-1, count)
            there = np.where(np.isfinite(far), nearest, 0)
            cosine = np.abs(np.einsum("qkc,qc->qk", targets.directions[there], queries.directions[some]))
            hits = (far[..., None] <= distances) & (cosine[..., None] >= cosines)
            matched[some] |= hits.any(axis=1)
            beyond = far[:, -1:] > distances
            open_.append(some[~(matched[some] | beyond).all(axis=1)])
        if count == len(targets.positions):
            break
        pending = np.concatenate(open_)
        count *= _MORE_NEIGHBOURS
    return matched


def _harmonic_mean(first: float, second: float) -> float:
    return 2 * first * second / (first + second) if first + second else 0.0
