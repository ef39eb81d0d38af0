"""Checkpoints: exact resumption, and refusal of what is none."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest
import torch

from dynhair.errors import DynhairError
from dynhair.training.checkpoint import Checkpoint


def model_and_optimizer() -> tuple[torch.nn.Module, torch.optim.Optimizer]:
    torch.manual_seed(0)
    model = torch.nn.Sequential(torch.nn.Linear(3, 4), torch.nn.Tanh(), torch.nn.Linear(4, 1))
    groups = [{"params": list(part.parameters()), "lr": rate} for part, rate in ((model[0], 1e-2), (model[2], 1e-3))]
    return model, torch.optim.Adam(groups, fused=True)


def steps(model: torch.nn.Module, optimizer: torch.optim.Optimizer, first: int, stop: int) -> None:
    for step in range(first, stop):
        x = torch.randn(8, 3, generator=torch.Generator().manual_seed(step))
        optimizer.zero_grad()
        model(x).square().mean().backward()
        optimizer.step()


def test_a_restored_run_ends_bit_for_bit_like_an_uninterrupted_one(tmp_path: Path) -> None:
    whole = model_and_optimizer()
    steps(*whole, 0, 9)

    first = model_and_optimizer()
    steps(*first, 0, 4)
    Checkpoint.of(4, *first).write(tmp_path / "c.safetensors")
    second = model_and_optimizer()
    checkpoint = Checkpoint.read(tmp_path / "c.safetensors")
    checkpoint.restore(*second)
    steps(*second, checkpoint.step, 9)
    for name, value in whole[0].state_dict().items():
        assert torch.equal(value, second[0].state_dict()[name])


def test_moments_lie_in_memory_as_their_parameter_does(tmp_path: Path) -> None:
    class Transposed(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.weight = torch.nn.Parameter(torch.arange(12.0).view(3, 4).T.clone())
            assert not self.weight.is_contiguous()

    def transposed() -> tuple[Transposed, torch.optim.Optimizer]:
        module = Transposed()
        return module, torch.optim.Adam(module.parameters(), lr=0.1, fused=True)

    def go(module: Transposed, optimizer: torch.optim.Optimizer, first: int, stop: int) -> torch.Tensor:
        for step in range(first, stop):
            goal = torch.randn(4, 3, generator=torch.Generator().manual_seed(step))
            optimizer.zero_grad()
            (module.weight - goal).pow(4).sum().backward()
            optimizer.step()
        return module.weight.detach()

    whole = go(*transposed(), 0, 8)
    first = transposed()
    go(*first, 0, 4)
    Checkpoint.of(4, *first).write(tmp_path / "c.safetensors")
    second = transposed()
    Checkpoint.read(tmp_path / "c.safetensors").restore(*second)
    assert second[1].state[second[0].weight]["exp_avg"].stride() == second[0].weight.stride()
    assert torch.equal(go(*second, 4, 8), whole)


@pytest.mark.parametrize("content", [b"", b"\x80\x04", b"x" * 100])
def test_what_is_no_checkpoint_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "c.safetensors"
    path.write_bytes(content)
    with pytest.raises(DynhairError, match="not a checkpoint"):
        Checkpoint.read(path)


def test_a_missing_checkpoint_is_named(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="missing"):
        Checkpoint.read(tmp_path / "c.safetensors")


def test_a_checkpoint_keeps_what_else_the_run_remembers(tmp_path: Path) -> None:
    record = {"skipped": 3, "norms": [0.1, 1e-30, 1 / 3]}
    Checkpoint.of(4, *model_and_optimizer(), record).write(tmp_path / "c.safetensors")
    assert Checkpoint.read(tmp_path / "c.safetensors").record == record


def test_a_disk_that_is_full_leaves_the_checkpoint_before(tmp_path: Path) -> None:
    path = tmp_path / "c.safetensors"
    model, optimizer = model_and_optimizer()
    Checkpoint.of(4, model, optimizer).write(path)
    steps(model, optimizer, 0, 1)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        with pytest.raises(DynhairError, match=r"step 5 cannot be written .* that of step 4 is whole") as caught:
            Checkpoint.of(5, model, optimizer).write(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.path == path
    assert "MB of free space" in (caught.value.expected or "")
    assert Checkpoint.read(path).step == 4
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    with pytest.raises(DynhairError, match="none before it"):
        Checkpoint.of(5, model, optimizer).write(path / "a_file_is_no_folder.safetensors")
