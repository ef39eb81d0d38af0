"""Mattings by networks that are fetched when first needed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from dynhair.assets import asset_path
from dynhair.errors import DynhairError
from dynhair.preprocess.litert import litert_network
from dynhair.preprocess.matting.frames import Predict, letterboxed, stretched

Matting = Callable[[UInt8[np.ndarray, "h w 3"]], UInt8[np.ndarray, "h w"]]
"""From an sRGB image to the coverage of each pixel by the person, 0 to 255."""

FAST_SIZE, QUALITY_SIZE = 256, 1024


def fast_matting(predict: Predict | None = None) -> Matting:
    """Make a matting by MediaPipe's selfie segmentation: some 10 ms an image, blurred at the hair's edge.

    Args:
        predict: takes the network's place.

    Raises:
        DynhairError: the network is not there and cannot be fetched; so for all networks here.
    """
    run = predict or fast_network()
    return lambda image: letterboxed(run, image, FAST_SIZE)


def fast_network() -> Predict:
    """MediaPipe's selfie segmentation."""
    run = litert_network(asset_path("selfie-segmentation").read_bytes())
    return lambda image: run(image[None])[0][0, ..., 0]


def quality_matting(predict: Predict | None = None) -> Matting:
    """Make a matting by IS-Net: seconds an image, soft at the hair's edge.

    The network finds the most salient things, not people: a chair or a telephone in the picture may be kept.

    Args:
        predict: takes the network's place.
    """
    run = predict or onnx_network(asset_path("isnet"))[0]
    return lambda image: stretched(run, image, (QUALITY_SIZE, QUALITY_SIZE), 128.0, 256.0)


def onnx_network(path: Path) -> tuple[Predict, tuple[int, int] | None]:
    """Load an ONNX network whose input is one image and whose first output is its matte, to run on one thread.

    Returns:
        The network, and the height and width of its input if these are fixed.

    Raises:
        DynhairError: the file is missing, is not ONNX, or has another input.
    """
    import onnxruntime

    if not path.is_file():
        raise DynhairError("the file is missing", path=path, expected="a network as ONNX")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's errors have no base of their own
        raise DynhairError(
            f"not readable as a network ({error})", path=path, expected="ONNX", mend="export or download it again"
        ) from None
    inputs = session.get_inputs()
    shape = inputs[0].shape if len(inputs) == 1 and inputs[0].type == "tensor(float)" else []
    if len(shape) != 4 or (isinstance(shape[1], int) and shape[1] != 3):  # a size that varies is a name or None
        found = ", ".join(f"{each.name}: {each.type} {each.shape}" for each in inputs)
        raise DynhairError(f"takes {found}", path=path, expected="one float image of shape (1, 3, height, width)")
    source, result = inputs[0].name, session.get_outputs()[0].name

    def predict(image: np.ndarray) -> np.ndarray:
        (matte,) = session.run([result], {source: np.ascontiguousarray(image.transpose(2, 0, 1)[None])})
        return np.asarray(matte)[0, 0]

    height, width = shape[2:]
    return predict, (height, width) if isinstance(height, int) and isinstance(width, int) else None
