from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.synthetic import write_synthetic_capture


@pytest.fixture(scope="session")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture that no test may change."""
    path = tmp_path_factory.mktemp("captures") / "pristine"
    return write_synthetic_capture(path, frames=3, views=2, size=40, static_views=2)


@pytest.fixture
def broken(pristine: Path, tmp_path: Path) -> Path:
    """A copy to break."""
    return Path(shutil.copytree(pristine, tmp_path / "broken"))
