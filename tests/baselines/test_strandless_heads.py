"""Both heads without strands: kept in folders, opened by their kind, driven by fitting tracks alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import safetensors.torch
import torch
from bound_heads import BASIS, bound_gaussians, camera, gaussian_head_avatar, head_track

from dynhair.baselines import open_driven_head
from dynhair.baselines.strandless import StrandlessHead
from dynhair.capture import ExpressionBasis
from dynhair.config import LearningRates, TrainingConfig
from dynhair.errors import DynhairError
from dynhair.evaluation.protocol import DrivenHead

MAKERS: list[Callable[..., StrandlessHead]] = [bound_gaussians, gaussian_head_avatar]
both = pytest.mark.parametrize("make", MAKERS)


@both
def test_a_head_that_was_stored_looks_the_same(make: Callable[..., Any], tmp_path: Path) -> None:
    head = make()
    with torch.no_grad():
        for parameter in head.parameters():
            parameter.add_(0.01 * torch.randn_like(parameter))
    head.save(tmp_path / "head")
    stored = open_driven_head(tmp_path / "head")
    assert isinstance(stored, DrivenHead)
    assert isinstance(stored, StrandlessHead)
    assert type(stored) is type(head)
    assert stored.expression_basis == BASIS
    with torch.no_grad():
        one, other = (h.draw(h.pose(head_track(), 2), [camera()]) for h in (head, stored))
    assert torch.equal(one.rgb, other.rgb)
    assert torch.equal(one.alpha, other.alpha)
    assert all(torch.equal(value, stored.state_dict()[name]) for name, value in head.state_dict().items())


def changed(name: str, value: object) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        description = json.loads((folder / "avatar.json").read_text())
        (folder / "avatar.json").write_text(json.dumps(description | {name: value}))

    return change


def without_tensors(folder: Path) -> None:
    (folder / "avatar.safetensors").unlink()


def cut_short(folder: Path) -> None:
    file = folder / "avatar.safetensors"
    file.write_bytes(file.read_bytes()[:-10])


def with_fewer(folder: Path) -> None:
    tensors = safetensors.torch.load_file(folder / "avatar.safetensors")
    name = next(name for name in tensors if name.endswith("opacity_logits"))
    tensors[name] = tensors[name][:-1].clone()
    safetensors.torch.save_file(tensors, folder / "avatar.safetensors")


@both
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (changed("kind", "dynhair head"), "kind 'dynhair head'"),
        (changed("version", 99), "version 99"),
        (changed("expression_basis", 3), "do not fit"),
        (without_tensors, "file is missing"),
        (cut_short, "not readable as safetensors"),
        (with_fewer, "do not fit"),
    ],
)
def test_a_damaged_folder_is_refused(
    make: Callable[..., Any], spoil: Callable[[Path], None], message: str, tmp_path: Path
) -> None:
    head = make()
    head.save(tmp_path / "head")
    spoil(tmp_path / "head")
    with pytest.raises(DynhairError, match=message):
        open_driven_head(tmp_path / "head")


def test_another_methods_folder_and_no_folder_are_refused(tmp_path: Path) -> None:
    bound, free = bound_gaussians(), gaussian_head_avatar()
    bound.save(tmp_path / "head")
    with pytest.raises(DynhairError, match="dynhair gha baseline"):
        type(free).load(tmp_path / "head")
    for load in (open_driven_head, type(free).load):
        with pytest.raises(DynhairError, match="no such folder"):
            load(tmp_path / "none")


def test_gaussians_of_triangles_that_are_not_there_are_refused(tmp_path: Path) -> None:
    bound_gaussians().save(tmp_path / "head")
    file = tmp_path / "head" / "avatar.safetensors"
    tensors = safetensors.torch.load_file(file)
    safetensors.torch.save_file(tensors | {"triangle": tensors["triangle"] + 4}, file)
    with pytest.raises(DynhairError, match="not there"):
        open_driven_head(tmp_path / "head")


def test_a_folder_that_cannot_be_written_is_an_error_and_the_one_before_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = bound_gaussians()
    head.save(tmp_path / "head")

    def full_disk(*_arguments: object, **_named: object) -> None:
        raise OSError("No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(safetensors.torch, "save_file", full_disk)
        with pytest.raises(DynhairError, match="cannot be written"):
            head.save(tmp_path / "head")
    open_driven_head(tmp_path / "head")


@both
def test_other_expressions_are_refused(make: Callable[..., Any]) -> None:
    head = make()
    head.pose(head_track(basis=BASIS), 0)
    with pytest.raises(DynhairError, match="the face model 'other'"):
        head.pose(head_track(basis=replace(BASIS, name="other")), 0)
    with pytest.raises(DynhairError, match="5 expression coefficients"):
        head.pose(head_track(expressions=5, basis=ExpressionBasis("model")), 0)


@both
def test_a_held_head_is_the_same_head(make: Callable[..., Any]) -> None:
    head = make()
    free, held = (head.pose(head_track(), 3, rigid_hair=rigid) for rigid in (False, True))
    assert torch.equal(free.means, held.means)


@both
def test_each_parameter_is_in_one_group(make: Callable[..., Any]) -> None:
    head = make()
    groups = head.parameter_groups(TrainingConfig(rates=LearningRates()))
    grouped = [id(parameter) for group in groups for parameter in group["params"]]
    assert len(grouped) == len(set(grouped))
    assert set(grouped) == {id(parameter) for parameter in head.parameters() if parameter.requires_grad}
    assert all(group["lr"] > 0 for group in groups)


def test_networks_and_colours_of_the_free_head_get_gradients() -> None:
    head = gaussian_head_avatar(basis=None)
    head.draw(head.pose(head_track(), 1), [camera()]).rgb.square().mean().backward()
    for name, parameter in head.named_parameters():
        if parameter.numel():
            assert parameter.grad is not None, name
            assert parameter.grad.isfinite().all(), name
