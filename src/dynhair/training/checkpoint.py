"""Checkpoints: everything that a run needs to go on exactly, in one safetensors file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
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
        record: what else the run must remember, as JSON values.
    """

    step: int
    model: dict[str, Tensor]
    optimizer: dict[str, Tensor]
    record: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls, step: int, model: nn.Module, optimizer: torch.optim.Optimizer, record: Mapping[str, Any] | None = None
    ) -> Checkpoint:
        """The present state of a model and its optimizer."""
        states = optimizer.state_dict()["state"]
        flat = {
            f"{index}.{name}": value
            for index, state in states.items()
            for name, value in state.items()
            if isinstance(value, Tensor)
        }
        return cls(step, dict(model.state_dict()), flat, record or {})

    def restore(self, model: nn.Module, optimizer: torch.optim.Optimizer) -> None:
        """Put the state back into a model and an optimizer made in the same way."""
        model.load_state_dict(self.model)
        described: dict[str, Any] = optimizer.state_dict()
        parameters: list[Tensor] = [p for group in optimizer.param_groups for p in group["params"]]
        states: dict[int, dict[str, Tensor]] = {}
        for key, value in self.optimizer.items():
            index, name = key.split(".", 1)
            parameter = parameters[int(index)]
            # fused optimizers pair the numbers of a parameter and of its moments as they lie in memory
            laid = torch.empty_like(parameter).copy_(value) if value.shape == parameter.shape else value
            states.setdefault(int(index), {})[name] = laid
        described["state"] = states
        optimizer.load_state_dict(described)

    def write(self, path: Path) -> None:
        """Write the checkpoint, atomically: a kill leaves the one before.

        Raises:
            DynhairError: it cannot be written; the one before is still there.
        """
        tensors = {f"model.{name}": value for name, value in self.model.items()}
        tensors |= {f"optimizer.{name}": value for name, value in self.optimizer.items()}
        tensors = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
        metadata = {"dynhair": json.dumps({"step": self.step, "record": self.record})}
        try:
            with atomic_file(path) as temporary:
                safetensors.torch.save_file(tensors, temporary, metadata=metadata)
        except (OSError, safetensors.SafetensorError) as error:
            size = sum(tensor.numel() * tensor.element_size() for tensor in tensors.values())
            raise DynhairError(
                f"the checkpoint of step {self.step} cannot be written ({error}); {_left(path)}",
                path=path,
                expected=f"{size / 1e6:.0f} MB of free space, beside the checkpoint before",
                mend="free some space and go on with --resume",
            ) from error

    @classmethod
    def read(cls, path: Path) -> Checkpoint:
        """Read a checkpoint.

        Raises:
            DynhairError: the file is missing or damaged.
        """
        try:
            with safetensors.safe_open(path, framework="pt") as file:
                state = json.loads((file.metadata() or {})["dynhair"])
                step, record = int(state["step"]), dict(state.get("record", {}))
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
        except FileNotFoundError:
            raise DynhairError("the file is missing", path=path) from None
        except (OSError, KeyError, ValueError, safetensors.SafetensorError) as error:
            raise DynhairError(f"not a checkpoint ({error})", path=path, mend="start the run again") from None
        model = {name.removeprefix("model."): t for name, t in tensors.items() if name.startswith("model.")}
        optimizer = {name.removeprefix("optimizer."): t for name, t in tensors.items() if name.startswith("optimizer.")}
        return cls(step, model, optimizer, record)


def _left(path: Path) -> str:
    """What is left at a checkpoint's place, in words."""
    if not path.exists():
        return "there is none before it"
    try:
        return f"that of step {Checkpoint.read(path).step} is whole"
    except DynhairError:
        return "the one before is damaged"
