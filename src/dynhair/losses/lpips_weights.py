"""The published weights of LPIPS, read from a pickle that may name nothing but NumPy's arrays."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError

_RECONSTRUCT: Any = np.zeros(0).__reduce__()[0]  # NumPy's own function, wherever this version of NumPy keeps it
_ALLOWED = {
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    ("numpy.core.multiarray", "_reconstruct"): _RECONSTRUCT,
}


@dataclass(frozen=True)
class LpipsWeights:
    """Weights of a network and of the heads that compare its features.

    Attributes:
        convolutions: kernel (out, in, y, x) and bias (out) of each convolution, from the image on.
        heads: weight of each channel, at each depth that is compared.
    """

    convolutions: list[tuple[Float[Tensor, "_ _ _ _"], Float[Tensor, " _"]]]
    heads: list[Float[Tensor, " _"]]


def read_lpips_weights(path: Path) -> LpipsWeights:
    """Read the parameters of the JAX port of LPIPS: nested dictionaries of arrays, kernels as (y, x, in, out).

    Raises:
        DynhairError: the file is no such pickle, or names anything but NumPy's arrays.
    """
    try:
        with path.open("rb") as file:
            content = _Unpickler(file).load()
        heads = {name: layer for name, layer in content.items() if name.startswith("NetLinLayer_")}
        (network,) = (content[name] for name in content.keys() - heads.keys())
        return LpipsWeights(
            convolutions=[
                (_tensor(layer["kernel"]).permute(3, 2, 0, 1).contiguous(), _tensor(layer["bias"]))
                for layer in _in_order(network)
            ],
            heads=[_tensor(layer["Conv_0"]["kernel"]).flatten() for layer in _in_order(heads)],
        )
    except Exception as error:  # a malformed pickle may raise anything
        raise DynhairError(
            f"these are not the weights of LPIPS: {error}",
            path=path,
            expected="a pickle of the JAX port's parameters, with NumPy's arrays alone",
        ) from error


class _Unpickler(pickle.Unpickler):
    def find_class(self, module_name: str, global_name: str, /) -> Any:
        try:
            return _ALLOWED[module_name, global_name]
        except KeyError:
            raise pickle.UnpicklingError(f"it names {module_name}.{global_name}; nothing was run") from None


def _in_order(layers: dict[str, Any]) -> list[Any]:
    """Layers by the number at the end of their names."""
    return [layers[name] for name in sorted(layers, key=lambda name: int(name.rpartition("_")[2]))]


def _tensor(array: Any) -> Tensor:
    return torch.from_numpy(np.array(array, np.float32))
