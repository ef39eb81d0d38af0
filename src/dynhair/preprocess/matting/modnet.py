"""Matting by MODNet, the paper's choice, from the user's own file."""

from __future__ import annotations

from pathlib import Path

from dynhair.errors import DynhairError
from dynhair.preprocess.matting.frames import stretched
from dynhair.preprocess.matting.networks import Matting, onnx_network

SIDE = 512
"""Of the image that MODNet was trained on, its shorter side, pixels."""
MULTIPLE = 32
"""Of which both sides must be."""


def modnet_matting(onnx: Path) -> Matting:
    """Make a matting by MODNet (paper, supplement, "Segmentation masks").

    Args:
        onnx: the official export, or another with the same input and output.

    Raises:
        DynhairError: the file is missing, or is not MODNet as ONNX.
    """
    if onnx.suffix in (".ckpt", ".pth", ".pt"):
        raise DynhairError(
            "PyTorch's checkpoints of MODNet are not read",
            path=onnx,
            expected="MODNet as ONNX",
            mend="take the official ONNX export, or make one from the checkpoint with MODNet's own onnx/export_onnx.py",
        )
    run, fixed = onnx_network(onnx)
    return lambda image: stretched(run, image, fixed or modnet_size(*image.shape[:2]), 127.5, 127.5)


def modnet_size(height: int, width: int) -> tuple[int, int]:
    """Compute the height and width at which MODNet sees an image.

    The shorter side becomes :data:`SIDE`, unless it is shorter already and the longer is not; then both are
    rounded down to a :data:`MULTIPLE`.
    """
    scale = SIDE / min(height, width) if max(height, width) < SIDE or min(height, width) > SIDE else 1.0
    rows, columns = (max(1, int(scale * side + 1e-6) // MULTIPLE) * MULTIPLE for side in (height, width))
    return rows, columns
