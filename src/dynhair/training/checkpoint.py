"""Checkpoints: everything that a run needs to go on exactly, in one safetensors file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch
from torch import Tensor, nn

from dynhair.errors import DynhairError
from dynhair.storage import atomic_file


@dataclass(frozen=True)
class Checkpoint:
    """The state of a run after a number of steps.

    Attributes:
        step: steps taken.
        model: the model's tensors.
        optimizer: the optimizer's tensors, by parameter and state name.
    """

    step: int
    model: dict[str, Tensor]
    optimizer: dict[str, Tensor]

    @classmethod
    def of(cls, step: int, model: nn.Module, optimizer: torch.optim.Optimizer) -> Checkpoint:
        """The present state of a model and its optimizer."""
        states = optimizer.state_dict()["state"]
        flat = {
            f"{index}.{name}": value
            for index, state in states.items()
            for name, value in state.items()
            if isinstance(value, Tensor)
        }
        return cls(step, dict(model.state_dict()), flat)

    def restore(self, model: nn.Module, optimizer: torch.optim.Optimizer) -> None:
        """Put the state back into a model and an optimizer made in the same way."""
        model.load_state_dict(self.model)
        described: dict[str, Any] = optimizer.state_dict()
        states: dict[int, dict[str, Tensor]] = {}
        for key, value in self.optimizer.items():
            index, name = key.split(".", 1)
            states.setdefault(int(index), {})[name] = value
        described["state"] = states
        optimizer.load_state_dict(described)

    def write(self, path: Path) -> None:
        """Write the checkpoint, atomically: a kill leaves the one before."""
        tensors = {f"model.{name}": value for name, value in self.model.items()}
        tensors |= {f"optimizer.{name}": value for name, value in self.optimizer.items()}
        tensors = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
        with atomic_file(path) as temporary:
            safetensors.torch.save_file(tensors, temporary, metadata={"dynhair": json.dumps({"step": self.step})})

    @classmethod
    def read(cls, path: Path) -> Checkpoint:
        """Read a checkpoint.

        Raises:
            DynhairError: the file is missing or damaged.
        """
        try:
            with safetensors.safe_open(path, framework="pt") as file:
                step = int(json.loads((file.metadata() or {})["dynhair"])["step"])
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
        except FileNotFoundError:
            raise DynhairError("the file is missing", path=path) from None
        except (OSError, KeyError, ValueError, safetensors.SafetensorError) as error:
            raise DynhairError(f"not a checkpoint ({error})", path=path, mend="start the run again") from None
        model = {name.removeprefix("model."): t for name, t in tensors.items() if name.startswith("model.")}
        optimizer = {name.removeprefix("optimizer."): t for name, t in tensors.items() if name.startswith("optimizer.")}
        return cls(step, model, optimizer)
