"""Training with the head's options: super-resolution, no follow weights, the mesh stage's surface."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from rich.console import Console

from dynhair.avatar import Avatar
from dynhair.capture import Capture
from dynhair.config import Config, DeformerConfig, HairConfig, HeadConfig, StaticConfig, TrainingConfig
from dynhair.mesh_config import MeshHeadConfig
from dynhair.training.trainer import train
from synthetic import write_synthetic_capture

CONFIG = Config(
    hair=HairConfig(strands=40, points=8, deformer=DeformerConfig(hidden=8, width=16)),
    static=StaticConfig(encoder_iterations=1, style_generations=0, iterations=2),
    mesh=MeshHeadConfig(
        resolution=8,
        width=48,
        layers=3,
        pretraining_iterations=120,
        iterations=4,
        views=2,
        image_size=48,
        refresh_every=2,
        checkpoint_every=2,
    ),
    head=HeadConfig(gaussians=400, mouth_gaussians=20, features=4, deformation_width=16, appearance_width=8),
    training=TrainingConfig(iterations=4, image_size=48, precision="float32", checkpoint_every=4, preview_every=4),
)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "capture"
    return write_synthetic_capture(path, frames=3, views=3, size=48)


@pytest.fixture(scope="module")
def with_hair(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A groom, so that the runs below need not look for one."""
    out = tmp_path_factory.mktemp("runs") / "hair"
    train(capture, out, CONFIG, stages=["static"], console=quiet())
    return out / "canonical_hair.safetensors"


def quiet() -> Console:
    return Console(file=io.StringIO())


def trained(capture: Path, hair: Path, out: Path, head: HeadConfig) -> Avatar:
    config = replace(CONFIG, head=head)
    train(capture, out, config, stages=[], console=quiet())
    (out / hair.name).write_bytes(hair.read_bytes())
    avatar = train(capture, out, config, resume=True, console=quiet())
    assert avatar is not None
    return Avatar.load(out / "avatar")


def rendered(avatar: Avatar, capture: Path) -> torch.Tensor:
    data = Capture.open(capture)
    segment = data.segments[0]
    posed = avatar.pose(data.track(segment), 1)
    return avatar.draw(posed, [data.camera(segment.start + 1, name) for name in data.camera_names]).rgb


def test_an_avatar_with_super_resolution_is_trained_at_the_larger_size(
    capture: Path, with_hair: Path, tmp_path: Path
) -> None:
    head = replace(CONFIG.head, super_resolution=2, super_resolution_channels=6)
    avatar = trained(capture, with_hair, tmp_path / "run", head)
    assert rendered(avatar, capture).shape == (3, 48, 48, 3)
    torch.manual_seed(0)
    assert avatar.super_resolution is not None
    assert avatar.super_resolution.last.weight.abs().max() > 1.5e-3  # it has left where it starts


def test_an_avatar_without_follow_weights_moves_all_with_the_head(
    capture: Path, with_hair: Path, tmp_path: Path
) -> None:
    avatar = trained(capture, with_hair, tmp_path / "run", replace(CONFIG.head, follow_weights=False))
    assert avatar.head.follow.equal(torch.ones_like(avatar.head.follow))
    assert rendered(avatar, capture).isfinite().all()


def test_an_avatar_begins_on_the_mesh_stages_surface(capture: Path, with_hair: Path, tmp_path: Path) -> None:
    avatar = trained(capture, with_hair, tmp_path / "run", replace(CONFIG.head, start="mesh"))
    assert (tmp_path / "run" / "mesh_head.safetensors").exists()
    assert len(avatar.scalp.rows) > 0
    assert rendered(avatar, capture).isfinite().all()


def test_the_mesh_stage_can_be_done_alone(capture: Path, tmp_path: Path) -> None:
    assert train(capture, tmp_path / "run", CONFIG, stages=["mesh"], console=quiet()) is None
    assert (tmp_path / "run" / "mesh_head.safetensors").exists()
    assert (tmp_path / "run" / "mesh_head.png").exists()
    assert not (tmp_path / "run" / "canonical_hair.safetensors").exists()
