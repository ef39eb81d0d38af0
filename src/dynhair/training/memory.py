"""When memory does not suffice: which settings to lower."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from operator import attrgetter

import torch

from dynhair.config import Config
from dynhair.errors import DynhairError

STATIC_SETTINGS = ("static.views", "static.image_size", "hair.strands")
MESH_SETTINGS = ("mesh.views", "mesh.image_size", "mesh.resolution", "mesh.width")
DYNAMIC_SETTINGS = (
    "training.views",
    "training.image_size",
    "training.perceptual_crop",
    "hair.strands",
    "hair.points",
    "head.gaussians",
    "head.features",
)

_COMPLAINTS = (  # of PyTorch's allocator, of Warp's, and of the C++ library's
    "can't allocate memory",
    "not enough memory",
    "out of memory",
    "failed to allocate",
    "bad_alloc",
)


@contextmanager
def explained_shortage(stage: str, config: Config, settings: Sequence[str]) -> Iterator[None]:
    """Turn a lack of memory inside the block into an error that says what to lower.

    Args:
        stage: what the block does.
        config: the run's.
        settings: paths in the configuration of what takes memory, that which is lowered at least cost first.

    Raises:
        DynhairError: memory did not suffice.
    """
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        if not is_shortage(error):
            raise
        values = ", ".join(f"{name} ({attrgetter(name)(config)})" for name in settings)
        where = "GPU memory" if isinstance(error, torch.OutOfMemoryError) else "memory"
        said = str(error).splitlines() or ["out of memory"]
        raise DynhairError(
            f"{where} does not suffice for {stage} ({said[0]})",
            mend=f"lower one of {values}: views and sizes of images and crops in the run's config.yaml, before going "
            "on with --resume; sizes of hair, head and mesh in the configuration of another run",
        ) from error


def is_shortage(error: BaseException) -> bool:
    """Whether an exception says that there is not enough memory."""
    if isinstance(error, (MemoryError, torch.OutOfMemoryError)):
        return True
    text = str(error).lower()
    return isinstance(error, RuntimeError) and any(complaint in text for complaint in _COMPLAINTS)
