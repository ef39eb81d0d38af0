"""Runs of seconds, for tests of the joint training."""

from __future__ import annotations

import io
import shutil
from dataclasses import replace
from pathlib import Path

import safetensors.torch
from rich.console import Console

from dynhair.config import Config, DeformerConfig, HairConfig, HeadConfig, StaticConfig, TrainingConfig, write_config
from dynhair.training.trainer import train

CONFIG = Config(
    hair=HairConfig(strands=60, points=10, deformer=DeformerConfig(hidden=8, width=16)),
    static=StaticConfig(encoder_iterations=2, style_generations=0, iterations=6),
    head=HeadConfig(gaussians=500, features=4, deformation_width=16, appearance_width=8),
    training=TrainingConfig(
        iterations=12, views=2, image_size=32, precision="float32", checkpoint_every=5, preview_every=6
    ),
)


def with_training(**settings: int) -> Config:
    """`CONFIG` with other settings of the joint training."""
    return replace(CONFIG, training=replace(CONFIG.training, **settings))


class Dialogue:
    """A console whose words can be read."""

    def __init__(self) -> None:
        self.console = Console(file=io.StringIO(), width=400)

    @property
    def text(self) -> str:
        """All that was said."""
        assert isinstance(self.console.file, io.StringIO)
        return self.console.file.getvalue()


def begin(capture: Path, out: Path) -> Path:
    """Do the static stage alone."""
    train(capture, out, CONFIG, stages=("static",), console=Dialogue().console)
    return out


def branch_off(begun: Path, out: Path, config: Config = CONFIG) -> Path:
    """Another run that goes on where the first one is, with a configuration of its own."""
    shutil.copytree(begun, out)
    write_config(config, out / "config.yaml")
    return out


def go_on(capture: Path, run: Path) -> str:
    """Do the joint training and return what was said."""
    dialogue = Dialogue()
    train(capture, run, resume=True, console=dialogue.console)
    return dialogue.text


def assert_same_avatar(one: Path, other: Path, tolerance: float = 0.0) -> None:
    """Avatars agree, to the last bit by default.

    With a tolerance, one value in a hundred of a tensor may be ten times as far off: where a gradient is hardly more
    than its rounding, Adam makes steps of that.
    """
    a = safetensors.torch.load_file(one / "avatar" / "avatar.safetensors")
    b = safetensors.torch.load_file(other / "avatar" / "avatar.safetensors")
    assert a.keys() == b.keys()
    for name, value in a.items():
        assert value.shape == b[name].shape, name
        if value.numel():
            difference = (value.double() - b[name].double()).abs()
            assert difference.max() <= 10 * tolerance, name
            assert (difference > tolerance).double().mean() <= 0.01, name
