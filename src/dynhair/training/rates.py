"""Parameters and the rates that they learn at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from torch import nn

from dynhair.config import LearningRates


def parameter_groups(by_rate: Mapping[str, Sequence[nn.Parameter]], rates: LearningRates) -> list[dict[str, Any]]:
    """An optimizer's groups; each has the ``name`` of its rate.

    Args:
        by_rate: parameters under the names of their rates, of which those without any are left out.
        rates: what the names stand for.
    """
    return [
        {"params": list(parameters), "lr": getattr(rates, name), "name": name}
        for name, parameters in by_rate.items()
        if parameters
    ]
