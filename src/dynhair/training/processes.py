"""The processes that train together: one, or as many as torchrun has started.

All hold the same avatar and take the same steps. Each draws its own share of a step's views; what depends on no view is
computed by all. The gradient of a step is the mean of theirs, in one message, so that a step does not depend on how
many they are. It is averaged here and not by PyTorch's wrapper, which would have to look for the parameters that a step
leaves alone (the pose corrections of the other frames) and could not carry along what the processes must agree on.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import timedelta
from typing import Any

import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from lightning_fabric.plugins.environments.torchelastic import TorchElasticEnvironment
from torch import Tensor, nn

from dynhair.errors import DynhairError

_LONGEST_STAGE = timedelta(days=100)


class Processes:
    """The processes of a training, seen from one of them.

    Attributes:
        count: of all of them.
        local_count: of those on this machine.
        rank: this one's place among all.

    Raises:
        DynhairError: there are more processes than GPUs.
    """

    def __init__(self) -> None:
        together = TorchElasticEnvironment.detect()
        self.count = int(os.environ["WORLD_SIZE"]) if together else 1
        self.local_count = local = int(os.environ["LOCAL_WORLD_SIZE"]) if together else 1
        if 0 < torch.cuda.device_count() < local:
            raise DynhairError(
                f"{local} processes on {torch.cuda.device_count()} GPUs",
                expected="a GPU for each process",
                mend="give torchrun fewer by --nproc-per-node",
            )
        if self.count == 1:
            self.fabric = Fabric(accelerator="auto", devices=1)
        else:
            self.fabric = Fabric(accelerator="auto", devices=local, num_nodes=self.count // local, strategy="ddp")
            self.fabric.launch()
            # one process may work for hours on a stage while the others wait; the usual limit is half an hour
            self._waiting: Any = torch.distributed.new_group(backend="gloo", timeout=_LONGEST_STAGE)
            _take_share_of_threads(local)
        self.rank = self.fabric.global_rank

    @property
    def device(self) -> torch.device:
        """Where this process computes."""
        return self.fabric.device

    @property
    def first(self) -> bool:
        """Whether this is the process that writes files and shows progress."""
        return self.rank == 0

    def wait(self) -> None:
        """Wait until all processes are here."""
        if self.count > 1:
            torch.distributed.monitored_barrier(self._waiting)

    def share(self, count: int) -> slice:
        """The part of ``count`` views that is this process's.

        Raises:
            DynhairError: they cannot be shared out evenly.
        """
        if count % self.count:
            raise DynhairError(
                f"{count} views a step cannot be shared out among {self.count} processes",
                expected="a multiple of the number of processes",
                mend="set training.views to one, or start another number of processes by torchrun --nproc-per-node",
            )
        each = count // self.count
        return slice(self.rank * each, (self.rank + 1) * each)

    def average(self, tensors: Sequence[Tensor]) -> None:
        """Replace each process's tensors, all of one type, by their mean over the processes, in one message."""
        if self.count == 1:
            return
        message = torch.cat([tensor.flatten() for tensor in tensors])
        mean = torch.as_tensor(self.fabric.all_reduce(message, reduce_op="mean"))
        for tensor, part in zip(tensors, mean.split([tensor.numel() for tensor in tensors]), strict=True):
            tensor.copy_(part.view_as(tensor))

    def balance(self, weight: Float[Tensor, ""]) -> Float[Tensor, ""]:
        """The factor that makes weighted means over each process's pixels average to the mean over all pixels.

        Args:
            weight: of this process's pixels in all.

        Returns:
            The weight by its mean over the processes; one where there is a single process, or no weight anywhere.
        """
        if self.count == 1:
            return torch.ones_like(weight)
        mean = weight.detach().clone()
        self.average([mean])
        return torch.where(mean > 0, weight / mean, 1.0)

    @torch.no_grad()
    def agree(self, module: nn.Module) -> None:
        """Give all processes the first one's parameters and buffers, to the last bit."""
        if self.count > 1:
            for tensor in (*module.parameters(), *module.buffers()):
                given = tensor.contiguous()  # NCCL sends no others
                torch.distributed.broadcast(given, src=0)
                tensor.copy_(given)


def _take_share_of_threads(processes: int) -> None:
    """Let PyTorch, and with it :mod:`dynhair.threads`, use this process's share of the machine's cores.

    Torchrun allows each process a single thread, unless the user has set ``OMP_NUM_THREADS`` to something else.
    """
    if os.environ.get("OMP_NUM_THREADS") == "1" and processes > 1:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        torch.set_num_threads(max(1, cores // processes))
