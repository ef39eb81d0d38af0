"""Anchors of other models: the open head's, carried over by its landmarks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import minimize

from dynhair.face import face_anchors, open_head
from dynhair.face.anchor_transfer import _closest_on_triangles
from dynhair.face.anchors import open_head_anchors


def test_the_open_head_has_its_own() -> None:
    assert face_anchors(open_head()) is open_head_anchors()


def test_anchors_of_the_same_head_stay_where_they_are() -> None:
    head, table = open_head(), open_head_anchors()
    shuffled = torch.randperm(len(head.faces), generator=torch.Generator().manual_seed(0))
    other = replace(head, faces=head.faces[shuffled])
    found = face_anchors(other)
    moved = found.positions(head.mean.numpy(), other.faces.numpy()) - table.positions(
        head.mean.numpy(), head.faces.numpy()
    )
    assert np.linalg.norm(moved, axis=1).max() < 1e-3
    assert np.linalg.norm(moved, axis=1).mean() < 1e-4
    np.testing.assert_array_equal(found.points, table.points)
    np.testing.assert_allclose(found.barycentric.sum(1), 1)
    assert found.barycentric.min() >= 0
    assert (found.deviation > table.deviation).all()


@pytest.mark.parametrize("seed", range(2))
def test_anchors_of_another_head_keep_their_meaning(seed: int) -> None:
    head, table = open_head(), open_head_anchors()
    mean = head.vertices(0.7 * torch.randn(64, generator=torch.Generator().manual_seed(seed)))
    other = replace(head, mean=mean)
    truth = table.positions(mean.numpy(), head.faces.numpy())
    error = np.linalg.norm(face_anchors(other).positions(mean.numpy(), head.faces.numpy()) - truth, axis=1)
    assert np.median(error) < 3e-3
    assert error.max() < 0.02


finite = st.floats(-1, 1, width=32)


@given(arrays(np.float64, 3, elements=finite), arrays(np.float64, (2, 3, 3), elements=finite))
def test_the_closest_place_on_a_triangle_is_the_closest(point: np.ndarray, corners: np.ndarray) -> None:
    found = _closest_on_triangles(point, corners)
    assert found.min() >= 0
    np.testing.assert_allclose(found.sum(1), 1)
    for weights, triangle in zip(found, corners, strict=True):
        best = minimize(
            lambda two, triangle=triangle: np.square(np.array([1 - two.sum(), *two]) @ triangle - point).sum(),
            np.array([1 / 3, 1 / 3]),
            bounds=[(0, 1), (0, 1)],
            constraints={"type": "ineq", "fun": lambda two: 1 - two.sum()},
            method="SLSQP",
        )
        assert np.linalg.norm(weights @ triangle - point) <= np.sqrt(best.fun) + 1e-6
