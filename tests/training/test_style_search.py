"""The search for a procedural style."""

from __future__ import annotations

import pytest
import torch

from dynhair.camera import Camera
from dynhair.hairstyles import HeadField, grow_hairstyle, random_head, random_style
from dynhair.render import Gaussians
from dynhair.strands import ScalpFrame, sample_roots, smooth_surface
from dynhair.training import style_search
from dynhair.training.static_scene import render_hair, surface_gaussians
from dynhair.training.static_views import RestViews
from dynhair.training.style_search import misfit, search_length, search_style

WIDTH = 0.012


class Head:
    """A head of 100 roots, seen from four sides."""

    def __init__(self) -> None:
        self.vertices, self.faces, scalp = random_head(0)
        self.frame = ScalpFrame.of(self.vertices, self.faces, scalp)
        self.field = HeadField.of(self.vertices, self.faces)
        self.body: Gaussians = surface_gaussians(self.vertices, self.faces)
        roots = sample_roots(self.vertices, self.faces, scalp, 100, 0)
        self.positions, self.normals = smooth_surface(roots, self.vertices, self.faces)

    def grow(self, family: str, seed: int) -> torch.Tensor:
        style = random_style(family, seed)
        return grow_hairstyle(style, self.positions, self.normals, self.frame, self.field, 24)

    def views(self, strands: torch.Tensor) -> RestViews:
        cameras = [_camera(turn) for turn in (0.0, 0.25, 0.5, 0.75)]
        images = render_hair(strands, WIDTH, self.body, cameras)
        return RestViews(cameras, torch.zeros(4, 48, 48, 3), images.coverage, images.direction)


def _camera(turn: float) -> Camera:
    angle = torch.tensor(2 * torch.pi * turn)
    back = torch.stack([angle.sin(), torch.tensor(0.0), angle.cos()])
    right = torch.stack([angle.cos(), torch.tensor(0.0), -angle.sin()])
    rotation = torch.stack([right, torch.tensor([0.0, -1.0, 0.0]), -back])
    position = 1.2 * back + torch.tensor([0.0, -0.1, 0.0])
    K = torch.tensor([[80.0, 0.0, 24.0], [0.0, 80.0, 24.0], [0.0, 0.0, 1.0]])
    return Camera(torch.cat([rotation, -(rotation @ position)[:, None]], 1), K, 48, 48)


@pytest.fixture(scope="module")
def head() -> Head:
    return Head()


def search(head: Head, views: RestViews, generations: int) -> tuple[object, float, list[tuple[int, float]]]:
    calls: list[tuple[int, float]] = []
    style, least = search_style(
        head.positions, head.normals, head.frame, head.field, head.body, views, WIDTH,
        generations=generations, seed=0,
        progress=lambda tried, least: calls.append((tried, least)),
    )  # fmt: skip
    return style, least, calls


def test_hair_fits_its_own_views_and_other_hair_does_not(head: Head) -> None:
    own, other = head.grow("bob_straight", 5), head.grow("cropped", 5)
    views = head.views(own)
    assert misfit(own, WIDTH, head.body, views) < 0.1
    assert misfit(other, WIDTH, head.body, views) > 0.3
    assert 0.9 < misfit(own + 9.0, WIDTH, head.body, views) < 1.1


def test_the_search_gets_closer_and_counts_what_it_tries(head: Head, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style_search, "FAMILIES", ("bob_straight", "cropped", "long_straight_middle"))
    monkeypatch.setattr(style_search, "FIRST_DRAWS", 2)
    monkeypatch.setattr(style_search, "POPULATION", 4)
    views = head.views(head.grow("bob_straight", 1000))
    style, least, calls = search(head, views, 2)
    assert [tried for tried, _ in calls] == list(range(1, search_length(2) + 1))
    assert calls[-1][1] == least
    assert least < calls[0][1] or calls[0][1] == least
    assert least < misfit(head.grow("cropped", 0), WIDTH, head.body, views)
    assert search(head, views, 2)[0] == style


@pytest.mark.slow
def test_a_style_that_was_not_among_the_draws_is_found(head: Head) -> None:
    strands = head.grow("long_straight_side", 1000)
    _, least, calls = search(head, head.views(strands), 20)
    assert least < 0.3
    assert least < 0.9 * calls[len(style_search.FAMILIES) * style_search.FIRST_DRAWS - 1][1]
