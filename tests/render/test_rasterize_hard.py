"""Gaussians, cameras and inputs at the edge of what can be drawn."""

from __future__ import annotations

import gc
import subprocess
import sys
from dataclasses import replace

import pytest
import torch
from gaussian_scenes import NAMES, assert_agrees, camera, gradients, leaves, loss, random_gaussians
from hypothesis import given
from hypothesis import strategies as st

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.render import Backend, Gaussians, rasterize

INFINITE = [float("nan"), float("inf"), float("-inf")]


def single(**changes: list[float]) -> Gaussians:
    """One Gaussian in front of the camera."""
    values = {
        "means": [0.0, 0.0, 0.0],
        "quats": [1.0, 0.0, 0.0, 0.0],
        "scales": [0.05, 0.02, 0.03],
        "opacities": 0.8,
        "features": [0.2, 0.7],
    }
    return Gaussians(**{name: torch.tensor([value]) for name, value in {**values, **changes}.items()})


@pytest.mark.parametrize(
    "changes",
    [
        {"scales": [0.0, 0.0, 0.0]},
        {"scales": [100.0, 80.0, 90.0]},
        {"opacities": 0.0},
        {"opacities": 1.0},
        {"opacities": 1 / 256},
        {"quats": [3.0, 1.0, -2.0, 5.0]},
        {"means": [0.0, 0.0, -0.95]},  # near, in front
        {"means": [0.0, 0.0, -0.995]},  # nearer than the near plane
        {"means": [0.0, 0.0, -2.0]},  # behind
        {"means": [0.9, 0.1, -0.5], "scales": [0.4, 0.3, 0.5]},  # beside the view: the Jacobian is held
        {"means": [-0.3, -0.9, -0.7], "scales": [0.4, 0.3, 0.5]},
        {"means": [50.0, 0.0, 0.0]},
    ],
    ids=str,
)
def test_single_gaussian(changes: dict[str, list[float]]) -> None:
    for view in (camera(), camera(33, 16, focal=2.0)):
        assert_agrees(single(**changes), [view])


@pytest.mark.parametrize("scales", [[0.3, 0.0, 0.0], [1e-4, 0.5, 1e-4], [0.02, 0.0003, 0.0003]])
def test_needle(scales: list[float]) -> None:
    """Widths next to nothing: in float32 their gradients are differences of nearly equal numbers."""
    assert_agrees(single(scales=scales, quats=[0.9, 0.1, 0.2, 0.5]), [camera()], gradient_tolerance=1e-2)


def test_needle_longer_than_the_scene() -> None:
    needle = single(scales=[30.0, 1e-3, 1e-3], quats=[0.9, 0.1, 0.2, 0.5])
    exact = leaves(needle, torch.float64)
    expected = rasterize(exact, camera(), backend="reference").features.float()
    torch.testing.assert_close(rasterize(needle, camera()).features, expected, atol=1e-4, rtol=0)


def test_nothing_to_draw() -> None:
    gaussians = leaves(random_gaussians(0, 3))
    rendering = rasterize(gaussians, [camera(), camera(turn=1.0)])
    assert rendering.features.shape == (2, 37, 50, 3)
    assert not rendering.features.any()
    assert not rendering.alpha.any()
    assert not rendering.depth.any()
    loss(rendering).backward()
    assert all(gradient.shape[0] == 0 for gradient in gradients(gaussians).values())


def test_many_opaque_layers_finish_every_pixel() -> None:
    gaussians = random_gaussians(2000, 3)
    gaussians = replace(gaussians, scales=3 * gaussians.scales, opacities=torch.full((2000,), 0.999))
    assert_agrees(gaussians, [camera(40, 24)])


def test_depth_of_a_flat_splat_is_its_distance_and_zero_where_nothing_is() -> None:
    rendering = rasterize(single(), camera(distance=1.5))
    hit = rendering.alpha > 0
    assert hit.any()
    assert not hit.all()
    torch.testing.assert_close(rendering.depth[hit], torch.full_like(rendering.depth[hit], 1.5))
    assert not rendering.depth[~hit].any()


def test_equal_depths_are_drawn_in_the_order_given() -> None:
    gaussians = single()
    pair = Gaussians(*(torch.cat([getattr(gaussians, name)] * 2) for name in NAMES))
    pair.features[1] = 0.0
    pair.opacities[:] = 0.99
    centre = rasterize(pair, camera()).features[0, 16, 26]
    assert centre[1] > 0.5  # the other way round it would be nearly black


@pytest.mark.parametrize("backend", ["cpu", "reference"])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", INFINITE)
def test_invalid_gaussians_are_not_drawn(backend: Backend, name: str, value: float) -> None:
    good = random_gaussians(40, 5)
    bad = Gaussians(*(getattr(good, attribute).clone() for attribute in NAMES))
    getattr(bad, name).view(40, -1)[7, -1] = value
    without = Gaussians(
        *(torch.cat([getattr(good, attribute)[:7], getattr(good, attribute)[8:]]) for attribute in NAMES)
    )

    gaussians = leaves(bad)
    rendering = rasterize(gaussians, camera(), backend=backend)
    torch.testing.assert_close(rendering.features, rasterize(without, camera(), backend=backend).features)
    loss(rendering).backward()
    for gradient in gradients(gaussians).values():
        assert torch.isfinite(gradient).all()
        assert not gradient[7].any()


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_zero_quaternions_are_not_drawn(backend: Backend) -> None:
    gaussians = leaves(single(quats=[0.0, 0.0, 0.0, 0.0]))
    rendering = rasterize(gaussians, camera(), backend=backend)
    assert not rendering.alpha.any()
    loss(rendering).backward()
    assert not any(gradient.any() for gradient in gradients(gaussians).values())


@given(st.data())
def test_no_input_brings_it_down(data: st.DataObject) -> None:
    """Any floats: the images stay finite, and alpha in [0, 1]."""
    n = data.draw(st.integers(1, 6))
    floats = st.floats(width=32, allow_nan=True, allow_infinity=True) | st.floats(-2, 2, width=32)

    def draw(*shape: int) -> torch.Tensor:
        count = int(torch.tensor(shape).prod())
        return torch.tensor(data.draw(st.lists(floats, min_size=count, max_size=count))).view(shape)

    gaussians = leaves(Gaussians(draw(n, 3), draw(n, 4), draw(n, 3), draw(n), torch.rand(n, 3)))
    rendering = rasterize(gaussians, camera(data.draw(st.integers(1, 40)), data.draw(st.integers(1, 40))))
    assert torch.isfinite(rendering.features).all()
    assert torch.isfinite(rendering.depth).all()
    assert ((rendering.alpha >= 0) & (rendering.alpha <= 1)).all()
    loss(rendering).backward()


def test_several_renderings_may_be_open_at_once() -> None:
    def render(seed: int) -> tuple[Gaussians, torch.Tensor]:
        gaussians = leaves(random_gaussians(60_000, 3, seed))
        return gaussians, loss(rasterize(gaussians, camera()))

    alone = []
    for seed in range(3):
        gaussians, total = render(seed)
        total.backward()
        alone.append(gradients(gaussians))
    together = [render(seed) for seed in range(3)]
    for expected, (gaussians, total) in zip(alone, together, strict=True):
        total.backward(retain_graph=True)
        assert all(torch.equal(gradients(gaussians)[name], expected[name]) for name in NAMES)


def test_buffers_are_used_again() -> None:
    from dynhair.render import workspace

    gaussians = random_gaussians(60_000, 3)
    seen = []
    for _ in range(3):
        rasterize(gaussians, camera())
        gc.collect()
        workspace._take(1)
        seen.append(sorted(buffer.data_ptr() for buffer in workspace._free))
    assert seen[0]
    assert seen[1] == seen[2]


def test_wide_features_are_blended_in_parts() -> None:
    wide = random_gaussians(50, 70)
    rendering = rasterize(wide, camera())
    narrow = rasterize(replace(wide, features=wide.features[:, 60:]), camera())
    torch.testing.assert_close(rendering.features[..., 60:], narrow.features)
    torch.testing.assert_close(rendering.alpha, narrow.alpha)


def test_double_precision_is_taken_and_gradients_return_in_it() -> None:
    gaussians = leaves(random_gaussians(20, 3), torch.float64)
    rendering = rasterize(gaussians, camera())
    assert rendering.features.dtype == torch.float32
    loss(rendering).backward()
    assert gaussians.means.grad is not None
    assert gaussians.means.grad.dtype == torch.float64


def test_strided_inputs() -> None:
    plain = random_gaussians(30, 4)
    strided = Gaussians(*(torch.stack([getattr(plain, name)] * 2, dim=-1)[..., 0] for name in NAMES))
    assert torch.equal(rasterize(strided, camera()).features, rasterize(plain, camera()).features)


def test_renders_from_several_python_threads() -> None:
    from concurrent.futures import ThreadPoolExecutor

    scenes = [random_gaussians(200, 3, seed) for seed in range(8)]
    expected = [rasterize(scene, camera()).features for scene in scenes]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda scene: rasterize(scene, camera()).features, scenes))
    assert all(torch.equal(a, b) for a, b in zip(found, expected, strict=True))


def broken_camera() -> Camera:
    view = camera()
    view.w2c[0, 3] = float("nan")
    return view


@pytest.mark.parametrize(
    ("changes", "cameras", "message"),
    [
        ({}, [], "no camera"),
        ({}, [camera(), camera(20, 20)], "different image sizes"),
        ({}, [broken_camera()], "camera 0 has a NaN"),
        ({"opacities": torch.ones(3)}, [camera()], "opacities have the shape"),
        ({"features": torch.ones(2, 5, 3)}, [camera()], "features are given for 2 views"),
        ({"features": torch.ones(4, 3)}, [camera()], "features have the shape"),
        ({"features": torch.ones(5, 0)}, [camera()], "features have the shape"),
    ],
)
def test_refuses_what_does_not_fit(changes: dict[str, torch.Tensor], cameras: list[Camera], message: str) -> None:
    gaussians = object.__new__(Gaussians)  # past the check of shapes that tests make at construction
    for name in NAMES:
        object.__setattr__(gaussians, name, changes.get(name, getattr(random_gaussians(5, 3), name)))
    with pytest.raises(DynhairError, match=message):
        rasterize(gaussians, cameras)


def test_refuses_a_background_of_another_width() -> None:
    with pytest.raises(DynhairError, match="background has the shape"):
        rasterize(random_gaussians(5, 3), camera(), background=torch.zeros(4))


def test_starts_without_a_word_and_imports_warp_only_when_it_draws() -> None:
    code = """
import sys, torch
from dynhair.camera import Camera
from dynhair.render import Backend, Gaussians, rasterize

assert "warp" not in sys.modules
one = torch.ones
rasterize(Gaussians(one(1, 3), one(1, 4), one(1, 3), one(1), one(1, 3)), Camera(torch.eye(3, 4), torch.eye(3), 8, 8))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == ""
    assert done.stderr == ""
