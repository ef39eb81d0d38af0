"""The call of gsplat, recorded by a stand-in that answers with the reference's images."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import pytest
import torch
from gaussian_scenes import camera, gradients, leaves, loss, random_gaussians
from torch import Tensor

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.render import Gaussians, rasterize


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What gsplat's ``rasterization`` was called with."""
    calls: list[dict[str, Any]] = []

    def rasterization(**arguments: Any) -> tuple[Tensor, Tensor, dict[str, Any]]:
        calls.append(arguments)
        cameras = [
            Camera(w2c[:3], K, arguments["width"], arguments["height"])
            for w2c, K in zip(arguments["viewmats"], arguments["Ks"], strict=True)
        ]
        gaussians = Gaussians(*(arguments[name] for name in ("means", "quats", "scales", "opacities", "colors")))
        rendering = rasterize(gaussians, cameras, backend="reference")
        colors = torch.cat([rendering.features, rendering.depth[..., None]], dim=-1)
        return colors, rendering.alpha[..., None], {}

    module = ModuleType("gsplat")
    module.rasterization = rasterization  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "gsplat", module)
    return calls


@pytest.mark.parametrize("views", [None, 2])
def test_arguments_and_images(calls: list[dict[str, Any]], views: int | None) -> None:
    gaussians, cameras = random_gaussians(30, 5, views=views), [camera(), camera(turn=0.5)]
    rendering = rasterize(gaussians, cameras, backend="cuda")

    (call,) = calls
    for ours, theirs in {
        "means": "means",
        "quats": "quats",
        "scales": "scales",
        "opacities": "opacities",
        "features": "colors",
    }.items():
        assert torch.equal(call[theirs], getattr(gaussians, ours)), ours
    assert call["viewmats"].shape == (2, 4, 4)
    assert torch.equal(call["viewmats"][:, :3], torch.stack([view.w2c for view in cameras]))
    assert torch.equal(call["viewmats"][:, 3], torch.tensor([[0.0, 0.0, 0.0, 1.0]] * 2))
    assert torch.equal(call["Ks"], torch.stack([view.K for view in cameras]))
    assert (call["width"], call["height"]) == (50, 37)
    assert call["near_plane"] == 0.01
    assert call["eps2d"] == 0.3
    assert call["render_mode"] == "RGB+ED"
    assert call["rasterize_mode"] == "antialiased"
    assert call.get("sh_degree") is None

    expected = rasterize(gaussians, cameras, backend="reference")
    torch.testing.assert_close(vars(rendering), vars(expected))


def test_gradients_and_background_pass_through(calls: list[dict[str, Any]]) -> None:
    colour = torch.tensor([0.1, 0.9, 0.4])
    found, expected = leaves(random_gaussians(30, 3)), leaves(random_gaussians(30, 3))
    loss(rasterize(found, camera(), background=colour, backend="cuda")).backward()
    loss(rasterize(expected, camera(), background=colour, backend="reference")).backward()
    torch.testing.assert_close(gradients(found), gradients(expected))
    assert "backgrounds" not in calls[0]


def test_invalid_gaussians_reach_gsplat_harmless(calls: list[dict[str, Any]]) -> None:
    gaussians = random_gaussians(4, 3)
    gaussians.means[1, 0] = float("nan")
    gaussians.quats[2] = 0.0
    gaussians.features[3, 1] = float("inf")
    rasterize(gaussians, camera(), backend="cuda")
    assert torch.equal(calls[0]["opacities"] > 0, torch.tensor([True, False, False, False]))
    assert all(torch.isfinite(calls[0][name]).all() for name in ("means", "quats", "scales", "colors"))


def test_says_how_to_install_gsplat(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(DynhairError, match="gsplat"):
        rasterize(random_gaussians(4, 3), camera(), backend="cuda")
