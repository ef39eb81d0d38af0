"""The published weights of the Inception network, read from a TorchScript archive without running what is in it.

TorchScript is code: loading an archive by its own loader would run it. The archive's pickle is read here by a reader
that knows numbers, lists and arrays alone; the modules that it names become empty shells that hold their parameters.
"""

from __future__ import annotations

import pickle
import zipfile
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError

EPSILON = 1e-3
"""What is added to a variance before its root is taken."""


@dataclass(frozen=True)
class ConvolutionWeights:
    """A convolution whose output is brought to a normal distribution and shifted.

    Attributes:
        kernel: (out, in, y, x).
        shift: of each output, after it was normalised.
        mean: of each output, in training.
        variance: of each output, in training.
    """

    kernel: Float[Tensor, "o _ _ _"]
    shift: Float[Tensor, " o"]
    mean: Float[Tensor, " o"]
    variance: Float[Tensor, " o"]

    def folded(self) -> tuple[Float[Tensor, "o _ _ _"], Float[Tensor, " o"]]:
        """Kernel and bias of the plain convolution that does the same."""
        scale = (self.variance.double() + EPSILON).rsqrt()
        kernel = self.kernel.double() * scale[:, None, None, None]
        return kernel.float(), (self.shift.double() - self.mean.double() * scale).float()


def read_inception_weights(path: Path) -> list[ConvolutionWeights]:
    """Read the convolutions of a TorchScript archive, in the order in which its modules hold them.

    Raises:
        DynhairError: the file is no such archive, or names anything but modules and arrays.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            (root,) = (name.removesuffix("data.pkl") for name in archive.namelist() if name.endswith("/data.pkl"))
            with archive.open(f"{root}data.pkl") as file:
                content = _Unpickler(file, archive, root).load()
        return [
            ConvolutionWeights(layer["weight"], layer["beta"], layer["mean"], layer["var"])
            for layer in map(vars, _modules(content))
            if "weight" in layer
        ]
    except Exception as error:  # a malformed archive may raise anything
        raise DynhairError(
            f"these are not the weights of the Inception network: {error}",
            path=path,
            expected="a TorchScript archive of convolutions with single-precision weights",
        ) from error


class _Module:
    """Stands for a module of any class, and holds its attributes."""


def _modules(module: _Module) -> Iterator[_Module]:
    yield module
    for value in vars(module).values():
        if isinstance(value, _Module):
            yield from _modules(value)


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: Any, archive: zipfile.ZipFile, root: str) -> None:
        super().__init__(file)
        self._archive, self._root = archive, root

    def find_class(self, module_name: str, global_name: str, /) -> Any:
        if module_name.partition(".")[0] == "__torch__":
            return _Module
        try:
            return _ALLOWED[module_name, global_name]
        except KeyError:
            raise pickle.UnpicklingError(f"it names {module_name}.{global_name}; nothing was run") from None

    def persistent_load(self, pid: Any, /) -> np.ndarray:
        _, kind, key, _, count = pid
        if kind != np.float32 or not str(key).isdecimal():
            raise pickle.UnpicklingError(f"it holds numbers of another kind: {pid}")
        return np.frombuffer(self._archive.read(f"{self._root}data/{key}"), "<f4", count)


def _tensor(storage: np.ndarray, offset: int, shape: Sequence[int], strides: Sequence[int], *_: Any) -> Tensor:
    array = storage[offset : offset + int(np.prod(shape))].reshape(shape)
    if tuple(stride * array.itemsize for stride in strides) != array.strides:
        raise pickle.UnpicklingError(f"an array of shape {shape} does not lie row by row")
    return torch.from_numpy(array.astype(np.float32))


_ALLOWED = {
    ("collections", "OrderedDict"): OrderedDict,
    ("torch", "FloatStorage"): np.float32,
    ("torch._utils", "_rebuild_tensor_v2"): _tensor,
    ("torch.jit._pickle", "build_intlist"): list,
}
