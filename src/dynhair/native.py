"""C++ that Warp compiles for the machine at hand, on first use, and keeps in its cache."""

from __future__ import annotations

import functools
import inspect
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.render.warp_runtime import warp

Kernel = Callable[..., None]
"""Runs on the calling thread without Python's global lock; takes the integers and tensors it was compiled for."""

_ARRAY_TYPES = {
    "f32": ("float", torch.float32),
    "i32": ("int", torch.int32),
    "u16": ("unsigned short", torch.int16),
    "u64": ("unsigned long long", torch.int64),
}
_OPTIONS = {
    "enable_backward": False,
    "fast_math": False,  # comparisons with NaN must stay false: that is how a Gaussian with a NaN is dropped
    # Clang prefers half-width vectors on several CPUs where these kernels run faster with full ones.
    "cpu_compiler_flags": "-march=native -mprefer-vector-width=512 -ffp-contract=fast",
}
_compiling = threading.Lock()


def compiled(*sources: Path, integers: str, arrays: str, channels: int = 0) -> Kernel:
    """Compile a function whose body is the sources one after the other; once, for the same arguments.

    Args:
        sources: files of C++.
        integers: names of the integer arguments.
        arrays: names of the array arguments, each with its type after a colon if that is not ``f32``.
        channels: the constant ``CHANNELS``.
    """
    with _compiling:
        return _compile(sources, integers, arrays, channels)


def for_kernels(*tensors: Tensor) -> bool:
    """Whether compiled code takes these tensors: they are float32 and on the CPU."""
    return all(tensor.dtype == torch.float32 and tensor.device.type == "cpu" for tensor in tensors)


def require_shapes(**tensors: tuple[Tensor, Sequence[int]]) -> None:
    """Refuse tensors that compiled code, which sees addresses alone, would read or write beyond.

    Args:
        tensors: by name, each with the shape that it must have.

    Raises:
        DynhairError: one has another shape.
    """
    for name, (tensor, shape) in tensors.items():
        if tensor.shape != tuple(shape):
            raise DynhairError(f"`{name}` has the shape {tuple(tensor.shape)}", expected=f"{tuple(shape)}")


@functools.cache
def _compile(sources: tuple[Path, ...], integers: str, arrays: str, channels: int) -> Kernel:
    wp = warp()
    # The kernel's one argument is a table of integers and addresses: Warp would want the signature spelt out thrice.
    names = integers.split()
    lines = [f"const int {name} = (int)table.data[{index}];" for index, name in enumerate(names)]
    dtypes: list[torch.dtype] = []
    for index, array in enumerate(arrays.split(), start=len(names)):
        name, _, kind = array.partition(":")
        c_type, dtype = _ARRAY_TYPES[kind or "f32"]
        lines.append(f"{c_type}* __restrict__ const {name} = ({c_type}*)table.data[{index}];")
        dtypes.append(dtype)
    lines.append(f"constexpr int CHANNELS = {channels};")
    lines += [source.read_text(encoding="utf-8") for source in sources]

    def body(table): ...

    def entry(table):
        body(table)

    # Warp reads the source of these functions, which a run-time type checker may have wrapped.
    native, entry = inspect.unwrap(body), inspect.unwrap(entry)
    native.__annotations__ = entry.__annotations__ = {"table": wp.array(dtype=wp.int64)}
    body = wp.func_native("\n".join(lines))(native)
    kernel = wp.kernel(entry, module="unique", enable_backward=False, module_options=_OPTIONS)
    wp.load_module(kernel.module, device="cpu", block_dim=1)  # CPU launches run in blocks of one

    def launch(*arguments: int | Tensor) -> None:
        integers, tensors = arguments[: len(names)], arguments[len(names) :]
        addresses: list[int] = []
        for tensor, dtype in zip(tensors, dtypes, strict=True):
            assert isinstance(tensor, Tensor)
            assert tensor.dtype is dtype
            assert tensor.device.type == "cpu"
            assert tensor.is_contiguous()
            addresses.append(tensor.data_ptr())
        table = torch.tensor([*integers, *addresses], dtype=torch.int64, device="cpu")
        wp.launch(kernel, dim=1, inputs=[wp.from_torch(table, return_ctype=True)], device="cpu")

    return launch
