"""Hair against the tracked surface: what a thread finds beside the drawing is what one finds in turn."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from dynhair.capture import Capture
from dynhair.demo import sample_capture
from dynhair.errors import DynhairError
from dynhair.losses import penetration_loss, sample_strand_points
from dynhair.strands import MeshDistance, sample_roots
from dynhair.training.contact import HEAD_FOLLOWS, SurfaceContact
from dynhair.training.surface import TrackedSurface, tracked_surface

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def surface() -> TrackedSurface:
    return tracked_surface(Capture.open(sample_capture()))


def strands_about(surface: TrackedSurface, frame: int) -> Tensor:
    """Strands from the surface outwards and inwards."""
    vertices = surface.vertices(frame)
    roots = sample_roots(vertices, surface.faces, surface.scalp, 40, 0)
    ends = torch.randn(40, 3, generator=torch.Generator().manual_seed(0)) * 0.05
    return roots.positions(vertices)[:, None] + torch.linspace(0, 1, 6)[:, None] * ends[:, None]


@pytest.mark.parametrize("body", [True, False])
def test_each_frame_is_that_of_a_query_in_turn(surface: TrackedSurface, body: bool) -> None:
    first = surface.capture.segments[0].start
    held = sample_roots(surface.vertices(first), surface.faces, surface.scalp, 5, 1)
    contact = SurfaceContact(surface, first, held, 100, body=body, device=CPU)
    counted = None if body else surface.follow[surface.faces].mean(1) > HEAD_FOLLOWS
    for frame in (first + 3, first, first + 1):
        strands = strands_about(surface, frame).requires_grad_()
        found = contact.begin(frame, strands, torch.Generator().manual_seed(frame))()
        (gradient,) = torch.autograd.grad(found.penetration, strands)
        points = sample_strand_points(strands, 100, generator=torch.Generator().manual_seed(frame))
        expected = penetration_loss(points, MeshDistance(surface.vertices(frame), surface.faces), counted)
        assert found.penetration > 0
        torch.testing.assert_close(found.penetration, expected)
        torch.testing.assert_close(gradient, torch.autograd.grad(expected, strands)[0])
        assert found.tracked is not None
        torch.testing.assert_close(found.tracked, held.positions(surface.vertices(frame)))


def test_what_goes_wrong_in_the_thread_comes_out(surface: TrackedSurface) -> None:
    contact = SurfaceContact(surface, surface.capture.segments[0].start, None, 10, body=True, device=CPU)
    waiting = contact.begin(1_000_000, torch.zeros(2, 3, 3), torch.Generator())
    with pytest.raises((DynhairError, StopIteration, OSError)):
        waiting()
