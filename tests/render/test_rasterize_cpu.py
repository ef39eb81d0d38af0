from __future__ import annotations

import pytest
import torch
from gaussian_scenes import assert_agrees, camera, gradients, leaves, loss, random_gaussians
from hypothesis import given
from hypothesis import strategies as st

from dynhair.camera import Camera
from dynhair.render import rasterize


@pytest.mark.parametrize("channels", [1, 3, 8, 13, 32])
def test_agrees_with_the_reference_for_any_number_of_channels(channels: int) -> None:
    assert_agrees(random_gaussians(150, channels), [camera()])


@given(
    seed=st.integers(0, 10_000),
    n=st.integers(0, 80),
    view=st.builds(
        camera,
        width=st.integers(1, 70),
        height=st.integers(1, 40),
        focal=st.floats(0.4, 4.0),
        distance=st.floats(-0.2, 1.5),
        turn=st.floats(-3.0, 3.0),
    ),
)
def test_agrees_with_the_reference_on_random_scenes(seed: int, n: int, view: Camera) -> None:
    assert_agrees(random_gaussians(n, 3, seed), [view])


def test_several_views_share_features_or_have_their_own() -> None:
    cameras = [camera(), camera(turn=0.5), camera(focal=2.0, turn=-1.0)]
    assert_agrees(random_gaussians(100, 4), cameras)
    assert_agrees(random_gaussians(100, 4, views=3), cameras)


def test_background_stands_behind_what_is_not_covered() -> None:
    gaussians, colour = leaves(random_gaussians(30, 3)), torch.tensor([0.2, 0.5, 1.0], requires_grad=True)
    over, black = rasterize(gaussians, camera(), background=colour), rasterize(gaussians, camera())
    torch.testing.assert_close(over.features, black.features + (1 - black.alpha)[..., None] * colour)
    over.features.sum().backward()
    assert colour.grad is not None
    torch.testing.assert_close(colour.grad, (1 - black.alpha).sum().expand(3))


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("views", [1, 2])
def test_same_bits_from_run_to_run(threads: int, views: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynhair.threads._own", threads)
    runs = []
    for _ in range(2):
        gaussians = leaves(random_gaussians(500, 4))
        rendering = rasterize(gaussians, [camera(turn=0.4 * view) for view in range(views)])
        loss(rendering).backward()
        runs.append([rendering.features, rendering.alpha, rendering.depth, *gradients(gaussians).values()])
    assert all(torch.equal(a, b) for a, b in zip(*runs, strict=True))


@pytest.mark.parametrize("views", [1, 2])
def test_threads_change_nothing_but_rounding(views: int, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = []
    for threads in (1, 5):
        monkeypatch.setattr("dynhair.threads._own", threads)
        gaussians = leaves(random_gaussians(300, 4))
        rendering = rasterize(gaussians, [camera(turn=0.4 * view) for view in range(views)])
        loss(rendering).backward()
        runs.append((vars(rendering), gradients(gaussians)))
    (images, grads), (same_images, same_grads) = runs
    assert all(torch.equal(images[name], same_images[name]) for name in images)
    torch.testing.assert_close(grads, same_grads, atol=1e-3, rtol=1e-3)
