"""Strand precision and recall against a brute-force oracle and closed forms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.evaluation.strand_scores import THRESHOLDS, strand_scores


def hairstyle(seed: int, count: int = 12, points: int = 7) -> torch.Tensor:
    """Short crooked strands in a cube of 3 cm."""
    generator = torch.Generator().manual_seed(seed)
    steps = torch.randn(count, points, 3, generator=generator, dtype=torch.float64) * 0.003
    return torch.rand(count, 1, 3, generator=generator, dtype=torch.float64) * 0.03 + steps.cumsum(dim=1)


def straight(places: list[tuple[float, float]], length: float = 0.1, points: int = 5) -> torch.Tensor:
    """Strands along z at places in the plane of x and y."""
    z = torch.linspace(0, length, points, dtype=torch.float64)
    return torch.stack([torch.stack([torch.full_like(z, x), torch.full_like(z, y), z], 1) for x, y in places])


def walk(strand: np.ndarray, step: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points and directions in the middles of equal pieces, by walking along the strand."""
    edges = [(strand[i], strand[i + 1] - strand[i]) for i in range(len(strand) - 1)]
    edges = [(start, edge, np.linalg.norm(edge)) for start, edge in edges if np.linalg.norm(edge)]
    total = sum(length for *_, length in edges)
    count = int(np.ceil(total / step))
    result = []
    for piece in range(count):
        left = (piece + 0.5) * total / count
        for start, edge, length in edges:
            if left <= length:
                result.append((start + left * edge / length, edge / length))
                break
            left -= length
    return result


def share_matched(ours: torch.Tensor, theirs: torch.Tensor, distance: float, angle: float, step: float) -> float:
    targets = [point for strand in theirs.numpy() for point in walk(strand, step)]
    queries = [point for strand in ours.numpy() for point in walk(strand, step)]
    matches = [
        any(
            np.linalg.norm(place - other) <= distance
            and np.degrees(np.arccos(min(abs(direction @ along), 1.0))) <= angle
            for other, along in targets
        )
        for place, direction in queries
    ]
    return float(np.mean(matches))


@pytest.mark.parametrize("seed", [0, 1])
def test_scores_agree_with_brute_force(seed: int) -> None:
    ours, theirs = hairstyle(2 * seed), hairstyle(2 * seed + 1, count=9, points=11)
    for score in strand_scores(ours, theirs, step=0.002):
        precision = share_matched(ours, theirs, score.distance, score.angle, 0.002)
        recall = share_matched(theirs, ours, score.distance, score.angle, 0.002)
        assert 0 < precision < 1
        assert score.precision == pytest.approx(precision)
        assert score.recall == pytest.approx(recall)
        assert score.f == pytest.approx(2 / (1 / precision + 1 / recall))


@given(st.integers(0, 10_000))
def test_a_hairstyle_matches_itself_turned_end_for_end(seed: int) -> None:
    strands = hairstyle(seed)
    assert all(score.f == 1 for score in strand_scores(strands, strands.flip(1)))


@given(st.integers(0, 10_000))
def test_swapping_the_sides_swaps_precision_and_recall(seed: int) -> None:
    first, second = hairstyle(seed, count=5), hairstyle(seed + 1, count=3)
    for there, back in zip(strand_scores(first, second), strand_scores(second, first), strict=True):
        assert (there.precision, there.recall) == (back.recall, back.precision)
        assert there.f == back.f


def test_half_the_strands_are_found_with_full_precision() -> None:
    truth = straight([(0.0, 0.0), (0.05, 0.0)])
    for score in strand_scores(truth[:1], truth):
        assert (score.precision, score.recall) == (1.0, 0.5)
        assert score.f == pytest.approx(2 / 3)


def test_every_point_within_the_distance_counts_however_many_nearer_ones_run_astray() -> None:
    """A strand at 1.5 mm matches, though 600 points of strands across it are nearer."""
    across = straight([(x * 1e-5, 0.0) for x in range(-300, 300)], length=1e-3, points=2)[..., [2, 1, 0]]
    across = across - torch.tensor([5e-4, 0.0, 0.0], dtype=torch.float64)
    truth = torch.cat([across, straight([(0.0, 0.0015)], length=1e-3, points=2)])
    (score,) = strand_scores(straight([(0.0, 0.0)], length=1e-3, points=2), truth, [(0.002, 20.0)])
    assert score.precision == 1
    (score,) = strand_scores(straight([(0.0, 0.0)], length=1e-3, points=2), truth, [(0.001, 20.0)])
    assert score.precision == 0


@pytest.mark.parametrize(("apart", "found"), [(0.0019, 1.0), (0.0021, 0.0)])
def test_the_distance_is_that_of_the_strands_not_of_their_vertices(apart: float, found: float) -> None:
    ours, theirs = straight([(0.0, 0.0)], points=2), straight([(apart, 0.0)], points=40)
    (score,) = strand_scores(ours, theirs, [(0.002, 20.0)])
    assert (score.precision, score.recall, score.f) == (found, found, found)


@pytest.mark.parametrize(("angle", "found"), [(19.0, 1.0), (21.0, 0.0), (159.0, 0.0), (161.0, 1.0)])
def test_directions_are_undirected(angle: float, found: float) -> None:
    turn = np.radians(angle)
    ours = torch.tensor([[[0.0, 0.0, 0.0], [0.0, 0.0, 1e-4]]])
    theirs = torch.tensor([[[0.0, 0.0, 0.0], [0.0, 1e-4 * np.sin(turn), 1e-4 * np.cos(turn)]]])
    (score,) = strand_scores(ours, theirs, [(0.002, 20.0)])
    assert (score.precision, score.recall) == (found, found)


def test_the_points_lie_evenly_whatever_the_vertices() -> None:
    """A strand with nearly all of its vertices in its first half counts no more there."""
    z = torch.cat([torch.linspace(0, 0.05, 60), torch.tensor([0.05, 0.05, 0.1])])
    uneven = torch.stack([torch.zeros_like(z), torch.zeros_like(z), z], 1)[None].double()
    half = straight([(0.0, 0.0)], length=0.048)
    (score,) = strand_scores(uneven, half, [(0.002, 20.0)])
    assert score.precision == pytest.approx(0.5, abs=0.01)
    assert score.recall == 1


def test_few_queries_estimate_the_share_and_follow_their_seed() -> None:
    ours, theirs = hairstyle(0, count=60), hairstyle(1, count=60)
    everything = strand_scores(ours, theirs)
    for seed in range(3):
        estimate = strand_scores(ours, theirs, queries=400, seed=seed)
        assert estimate == strand_scores(ours, theirs, queries=400, seed=seed)
        assert estimate != everything
        for score, exact in zip(estimate, everything, strict=True):
            assert score.precision == pytest.approx(exact.precision, abs=0.1)
            assert score.recall == pytest.approx(exact.recall, abs=0.1)


def test_more_tolerant_thresholds_find_no_less() -> None:
    scores = strand_scores(hairstyle(4), hairstyle(5))
    assert [(score.distance, score.angle) for score in scores] == list(THRESHOLDS)
    for strict, tolerant in pairwise(scores):
        assert strict.precision <= tolerant.precision
        assert strict.recall <= tolerant.recall
    assert scores[0].to_json()["precision"] == scores[0].precision


def test_hair_elsewhere_scores_zero() -> None:
    assert all(
        (score.precision, score.recall, score.f) == (0, 0, 0) for score in strand_scores(hairstyle(0), hairstyle(0) + 1)
    )


def test_strands_without_length_are_left_out() -> None:
    truth = straight([(0.0, 0.0)])
    stump = torch.ones(1, 5, 3, dtype=torch.float64)
    assert strand_scores(torch.cat([truth, stump]), truth)[0].precision == 1


@pytest.mark.parametrize("bad", [torch.full((2, 3, 3), torch.nan), torch.ones(2, 3, 3), torch.zeros(0, 3, 3)])
def test_strands_that_cannot_be_scored_are_refused(bad: torch.Tensor) -> None:
    good = hairstyle(0)
    with pytest.raises(DynhairError, match="reconstructed"):
        strand_scores(bad, good)
    with pytest.raises(DynhairError, match="true"):
        strand_scores(good, bad)
