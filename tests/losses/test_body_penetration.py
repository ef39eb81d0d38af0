"""Penetration into an upper body that is open below, with arms pressed into it, against the solids it is made of."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import torch

from dynhair.losses import penetration_loss
from dynhair.strands import MeshDistance

OUTLINE = np.array([(0.15, 0.0), (0.15, 0.3), (0.05, 0.36), (0.05, 0.45), (0.1, 0.5), (0.1, 0.6), (0.0, 0.68)])
"""Radius and height: trunk, shoulders, neck and head."""

SIDES, RINGS = 96, 12
ARM, ARM_RADIUS = np.array([0.17, 0.2, 0.0]), 0.05
CHIN = 0.45

OPENING = 7e-3
"""Within so many metres of the plane of the opening the approximate winding number may not tell in from out."""


def finer(outline: np.ndarray) -> np.ndarray:
    places = np.linspace(0, len(outline) - 1, (len(outline) - 1) * RINGS + 1)
    return np.stack([np.interp(places, np.arange(len(outline)), values) for values in outline.T], 1)


def turned(outline: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The surface that an outline (radius, height), upwards, draws when it turns about the y axis."""
    angles = np.arange(SIDES) * (2 * np.pi / SIDES)
    around = np.stack([np.sin(angles), np.zeros(SIDES), np.cos(angles)], 1)
    vertices = (outline[:, None, :1] * around + outline[:, None, 1:] * [0, 1, 0]).reshape(-1, 3)
    faces = []
    for ring in range(len(outline) - 1):
        for side in range(SIDES):
            a, b = ring * SIDES + side, ring * SIDES + (side + 1) % SIDES
            faces += [[a, b, b + SIDES], [a, b + SIDES, a + SIDES]]
    return vertices, np.array(faces)


@functools.cache
def body() -> tuple[MeshDistance, torch.Tensor]:
    """Trunk, neck and head in one surface without a bottom, with a ball for an arm halfway in the trunk; the head."""
    trunk, trunk_faces = turned(finer(OUTLINE))
    polar = np.linspace(0, np.pi, 49)
    ball, ball_faces = turned(np.stack([np.sin(polar), -np.cos(polar)], 1) * ARM_RADIUS)
    vertices = np.concatenate([trunk, ball + ARM])
    faces = np.concatenate([trunk_faces, ball_faces + len(trunk)])
    head = vertices[faces].mean(1)[:, 1] > CHIN
    return MeshDistance(torch.from_numpy(vertices), torch.from_numpy(faces)), torch.from_numpy(head)


def trunk_radius(height: np.ndarray) -> np.ndarray:
    return np.interp(height, OUTLINE[:, 1], OUTLINE[:, 0], left=-1, right=-1)


def is_inside(points: np.ndarray) -> np.ndarray:
    trunk = np.hypot(points[:, 0], points[:, 2]) < trunk_radius(points[:, 1])
    return trunk | (np.linalg.norm(points - ARM, axis=1) < ARM_RADIUS)


def drawn(low: tuple[float, float, float], high: tuple[float, float, float], count: int = 2000) -> np.ndarray:
    """Points of a box, none within a millimetre of a surface or at the opening."""
    points = np.random.default_rng(0).uniform(low, high, (count, 3))
    aside = np.hypot(points[:, 0], points[:, 2]) - trunk_radius(points[:, 1])
    arm = np.linalg.norm(points - ARM, axis=1) - ARM_RADIUS
    return points[(abs(aside) > 1e-3) & (abs(arm) > 1e-3) & (abs(points[:, 1]) > OPENING)]


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ((-0.3, -0.02, -0.3), (0.3, 0.02, 0.3)),  # at the open bottom
        ((-0.3, -3.0, -0.3), (0.3, -0.02, 0.3)),  # far below it
        ((-0.15, 0.0, -0.15), (0.15, 0.3, 0.15)),  # in the trunk
        ((0.1, 0.14, -0.06), (0.23, 0.26, 0.06)),  # about the arm, whose surface goes on within the trunk
        ((-0.06, 0.34, -0.06), (0.06, 0.47, 0.06)),  # in the neck
        ((-0.3, 0.28, -0.3), (0.3, 0.8, 0.3)),  # about shoulders and head
    ],
)
def test_the_inside_is_that_of_the_solids(low: tuple[float, float, float], high: tuple[float, float, float]) -> None:
    points = drawn(low, high)
    distance = body()[0].nearest(torch.from_numpy(points)).distance.numpy()
    np.testing.assert_array_equal(distance < 0, is_inside(points))


def test_the_head_alone_counts_points_that_are_nearest_to_its_faces() -> None:
    mesh, head = body()
    points = torch.tensor(
        [
            [0.09, 0.55, 0.0],  # 1 cm deep in the head
            [0.0, 0.56, -0.06],  # 4 cm
            [0.13, 0.1, 0.0],  # 2 cm deep in the trunk
            [0.04, 0.4, 0.0],  # 1 cm in the neck
            [0.2, 0.55, 0.0],  # beside the head
        ],
        requires_grad=True,
    )
    whole, alone = penetration_loss(points, mesh), penetration_loss(points, mesh, head)
    assert whole.item() == pytest.approx((0.01**2 + 0.04**2 + 0.02**2 + 0.01**2) / 4, rel=0.02)
    assert alone.item() == pytest.approx((0.01**2 + 0.04**2) / 2, rel=0.02)
    alone.backward()
    assert points.grad is not None
    assert (points.grad != 0).any(1).tolist() == [True, True, False, False, False]
    assert penetration_loss(points, mesh, torch.zeros_like(head)).item() == 0
    torch.testing.assert_close(penetration_loss(points, mesh, torch.ones_like(head)), whole)
    none = penetration_loss(points[2:], mesh, head)
    none.backward()
    assert none.item() == 0


def test_counted_points_agree_with_a_loop() -> None:
    mesh, head = body()
    points = drawn((-0.2, 0.3, -0.2), (0.2, 0.7, 0.2), 300)
    nearest = mesh.nearest(torch.from_numpy(points)).position.double().numpy()
    clear = abs(nearest[:, 1] - CHIN) > 1e-4
    points, nearest = points[clear], nearest[clear]
    squares = [
        sum((point - place) ** 2)
        for point, place, inside in zip(points, nearest, is_inside(points), strict=True)
        if inside and place[1] > CHIN
    ]
    assert 10 < len(squares) < is_inside(points).sum()
    loss = penetration_loss(torch.from_numpy(points), mesh, head)
    assert loss.item() == pytest.approx(sum(squares) / len(squares), rel=1e-6)
