"""The TensorBoard log of a training, which a full disk ends and training survives."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType

import numpy as np
from jaxtyping import UInt8
from torch.utils.tensorboard.writer import SummaryWriter


class TrainingLog:
    """Curves and pictures over training steps.

    Args:
        path: TensorBoard's folder; None to log nothing.
        first: the step that training begins with; what an earlier run logged after it is hidden.
        complain: told once if the log cannot be written; training goes on without it.
    """

    def __init__(self, path: Path | None, first: int, complain: Callable[[str], None]) -> None:
        self._path, self._complain = path, complain
        self._writer: SummaryWriter | None = None
        if path is not None:
            try:
                self._writer = SummaryWriter(path, purge_step=first)
            except OSError as error:
                self._give_up(error)

    def __enter__(self) -> TrainingLog:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            try:
                self._writer.close()
            except (OSError, ValueError) as error:  # a ValueError where the file was closed under the writer
                self._give_up(error)

    def curves(self, values: Mapping[str, float], step: int) -> None:
        """Log a value for each name."""
        if self._writer is None:
            return
        try:
            for name, value in values.items():
                self._writer.add_scalar(name, value, step)
        except OSError as error:
            self._give_up(error)

    def picture(self, name: str, picture: UInt8[np.ndarray, "h w 3"], step: int) -> None:
        """Log a picture."""
        if self._writer is None:
            return
        try:
            self._writer.add_image(name, picture, step, dataformats="HWC")
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: Exception) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            with contextlib.suppress(OSError, ValueError):
                writer.close()
        self._complain(f"{self._path}: the log ends here, it cannot be written ({error}).")
