"""Training on a GPU against training on the CPU, where there is a GPU."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from quick_runs import CONFIG, begin, branch_off, go_on

from dynhair.evaluation import Appearance, run_evaluation
from dynhair.strands.collision import MeshDistance
from synthetic import write_synthetic_capture

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "capture"
    return write_synthetic_capture(path, frames=6, views=3, size=32, static_views=4)


@pytest.fixture(scope="module")
def begun(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return begin(capture, tmp_path_factory.mktemp("runs") / "begun")


def losses(folder: Path) -> list[float]:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder / "log"))
    events.Reload()
    return [event.value for event in events.Scalars("loss")]


@pytest.mark.parametrize("kind", ["paper", "modal", "strands"])
def test_the_loss_falls_as_on_the_cpu(
    kind: str, capture: Path, begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deformer = replace(CONFIG.hair.deformer, kind=kind, inextensible=kind != "paper")  # pyright: ignore[reportArgumentType]
    config = replace(CONFIG, hair=replace(CONFIG.hair, deformer=deformer))
    go_on(capture, branch_off(begun, tmp_path / "gpu", config))
    with monkeypatch.context() as patch:
        patch.setattr(torch.cuda, "is_available", lambda: False)
        patch.setattr(torch.cuda, "device_count", lambda: 0)
        go_on(capture, branch_off(begun, tmp_path / "cpu", config))
    np.testing.assert_allclose(losses(tmp_path / "gpu"), losses(tmp_path / "cpu"), rtol=0.02)
    run_evaluation(tmp_path / "gpu", capture, tmp_path / "evaluation", appearance=Appearance.quick())


def test_distances_to_a_mesh_that_moves() -> None:
    random = torch.Generator().manual_seed(0)
    vertices = torch.tensor([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * 0.1
    faces = torch.tensor([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    points = 0.15 * torch.randn(1000, 3, generator=random)
    there, here = MeshDistance(vertices.cuda(), faces.cuda()), MeshDistance(vertices, faces)
    for moved in (vertices, vertices + 0.05):
        there.refit(moved.cuda())
        here.refit(moved)
        a, b = there.nearest(points.cuda()), here.nearest(points)
        torch.testing.assert_close(a.distance.cpu(), b.distance, atol=1e-6, rtol=0)
        torch.testing.assert_close(a.position.cpu(), b.position, atol=1e-6, rtol=0)
