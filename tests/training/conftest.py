"""What all tests of training share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from dynhair.training import static_groom, static_hair


@pytest.fixture(scope="session", autouse=True)
def short_search() -> Iterator[None]:
    """A search for the groom that takes half a second; what it finds is tested by the slow tests."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (static_groom, static_hair):
            patch.setattr(module, "FIRST_POPULATION", 6)
            patch.setattr(module, "GENERATIONS", 1)
            patch.setattr(module, "POPULATION", 6)
        yield
