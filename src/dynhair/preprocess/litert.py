"""Networks in TensorFlow Lite's format, run by LiteRT."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dynhair.quiet import silent_stderr


def litert_network(content: bytes) -> Callable[[np.ndarray], list[np.ndarray]]:
    """Load a network of one input, to run on one thread; one thread at a time may use it.

    Args:
        content: of the ``.tflite`` file.

    Returns:
        A function from the input to the outputs.
    """
    from ai_edge_litert.interpreter import Interpreter

    with silent_stderr():  # it announces its delegate
        interpreter = Interpreter(model_content=content, num_threads=1)
        interpreter.allocate_tensors()
    (source,) = interpreter.get_input_details()
    results = interpreter.get_output_details()

    def run(values: np.ndarray) -> list[np.ndarray]:
        interpreter.set_tensor(source["index"], values.astype(np.float32, copy=False))
        interpreter.invoke()
        return [interpreter.get_tensor(result["index"]) for result in results]

    return run
