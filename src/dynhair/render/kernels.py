"""The rasterizer's CPU kernels."""

from __future__ import annotations

from pathlib import Path

from dynhair.native import Kernel, compiled

SOURCES = Path(__file__).with_name("native")
SPLAT_HEADER = 8  # floats of a splat before its features: `Field` in common.cpp
TILE = 16  # as in common.cpp

_GAUSSIANS = "camera means quats scales opacities"
_LISTS = "splats starts:i32 entries:i32 reached:u16 ends:i32"


def project() -> Kernel:
    return _kernel(
        "common geometry tiles project",
        "first last width height stride channels",
        f"{_GAUSSIANS} features splats bounds:u16 masks:u16 keys:u64 counts:i32",
    )


def bin_splats() -> Kernel:
    return _kernel(
        "common tiles bin",
        "width height stride visible",
        "splats bounds:u16 masks:u16 keys:u64 spare:u64 starts:i32 entries:i32 cursors:i32",
    )


def blend(channels: int) -> Kernel:
    """For splats with room for ``channels`` features."""
    return _kernel(
        "common pixels blend", "first last width height channels", f"{_LISTS} image alpha depth", channels=channels
    )


def blend_backward(channels: int) -> Kernel:
    """For splats with room for ``channels`` features."""
    return _kernel(
        "common pixels blend_backward",
        "first last width height channels",
        f"{_LISTS} image alpha depth grad_image grad_alpha grad_depth grads",
        channels=channels,
    )


def project_backward() -> Kernel:
    return _kernel(
        "common geometry project_backward",
        "first last n stride channels slices accumulate accumulate_features",
        f"{_GAUSSIANS} grads grad_means grad_quats grad_scales grad_opacities grad_features",
    )


def _kernel(sources: str, integers: str, arrays: str, channels: int = 0) -> Kernel:
    files = [SOURCES / f"{source}.cpp" for source in sources.split()]
    return compiled(*files, integers=integers, arrays=arrays, channels=channels)
