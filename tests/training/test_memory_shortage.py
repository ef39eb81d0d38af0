"""A lack of memory is explained."""

from __future__ import annotations

import pytest
import torch

from dynhair.config import Config
from dynhair.errors import DynhairError
from dynhair.training.memory import (
    DYNAMIC_SETTINGS,
    MESH_SETTINGS,
    STATIC_SETTINGS,
    explained_shortage,
    is_shortage,
)


@pytest.mark.parametrize("settings", [DYNAMIC_SETTINGS, MESH_SETTINGS, STATIC_SETTINGS])
def test_the_settings_are_named_with_their_values(settings: tuple[str, ...]) -> None:
    with (
        pytest.raises(DynhairError, match="does not suffice for some stage") as caught,
        explained_shortage("some stage", Config(), settings),
    ):
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20.00 GiB.")
    assert caught.value.message.startswith("GPU memory")
    for name in settings:
        assert name in (caught.value.mend or "")
    if settings is DYNAMIC_SETTINGS:
        assert f"training.image_size ({Config().training.image_size})" in (caught.value.mend or "")


def test_the_allocator_of_a_cpu_is_understood() -> None:
    with pytest.raises(DynhairError, match=r"^memory does not"), explained_shortage("it", Config(), ()):
        torch.empty(1 << 55)
    with pytest.raises(DynhairError, match="out of memory"), explained_shortage("it", Config(), ()):
        raise MemoryError


def test_other_errors_pass() -> None:
    with pytest.raises(RuntimeError, match="shapes"), explained_shortage("it", Config(), ()):
        raise RuntimeError("shapes do not match")
    assert not is_shortage(OSError("not enough memory in the title"))
