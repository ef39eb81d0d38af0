"""Colours of a surface from views."""

from __future__ import annotations

import torch

from dynhair.camera import Camera
from dynhair.training.static_views import RestViews
from dynhair.training.surface_colours import seen_colours

SIZE = 20


def camera(front: bool) -> Camera:
    """At 1 m before or behind a plane at z = 0; x to the right from before."""
    side = 1.0 if front else -1.0
    w2c = torch.tensor([[side, 0, 0, 0], [0, -1, 0, 0], [0, 0, -side, 1.0]])
    return Camera(w2c, torch.tensor([[20.0, 0, SIZE / 2], [0, 20, SIZE / 2], [0, 0, 1]]), SIZE, SIZE)


def views(hair: torch.Tensor) -> tuple[RestViews, torch.Tensor]:
    rgb = torch.zeros(2, SIZE, SIZE, 3)
    rgb[0, :, : SIZE // 2, 0] = 1.0  # from before: red at x < 0, green at x > 0
    rgb[0, :, SIZE // 2 :, 1] = 1.0
    rgb[1, ..., 2] = 1.0  # from behind: blue
    images = RestViews([camera(True), camera(False)], rgb, hair, torch.zeros(2, SIZE, SIZE, 2))
    return images, torch.ones(2, SIZE, SIZE)


POINTS = torch.tensor([[-0.3, 0.0, 0.0], [0.3, 0.1, 0.0], [0.3, 0.1, -0.01]])
NORMALS = torch.tensor([[0.0, 0, 1], [0, 0, 1], [0, 0, -1]])


def test_each_side_is_coloured_by_the_view_that_faces_it() -> None:
    colours = seen_colours(POINTS, NORMALS, *views(torch.zeros(2, SIZE, SIZE)))
    torch.testing.assert_close(colours, torch.tensor([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]))


def test_hair_hides_skin_which_takes_the_colour_of_seen_skin() -> None:
    hair = torch.zeros(2, SIZE, SIZE)
    hair[0, :, SIZE // 2 :] = 1.0
    colours = seen_colours(POINTS[:2], NORMALS[:2], *views(hair))
    torch.testing.assert_close(colours, torch.tensor([[1.0, 0, 0], [1, 0, 0]]))


def test_what_lies_behind_the_visible_surface_is_not_seen() -> None:
    images, depth = views(torch.zeros(2, SIZE, SIZE))
    depth[0, :, SIZE // 2 :] = 0.9  # something stands before the right half
    colours = seen_colours(POINTS[:2], NORMALS[:2], images, depth)
    torch.testing.assert_close(colours, torch.tensor([[1.0, 0, 0], [1, 0, 0]]))


def test_nothing_seen_is_grey() -> None:
    colours = seen_colours(POINTS, NORMALS, *views(torch.ones(2, SIZE, SIZE)))
    assert torch.equal(colours, torch.full((3, 3), 0.5))
