from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
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


@pytest.fixture
def gha_folder(pristine: Path, tmp_path: Path) -> Path:
    """A capture turned into what Gaussian Head Avatar's preparation leaves, with full and low-resolution images."""
    target = Path(shutil.copytree(pristine, tmp_path / "subject"))
    for name in ("capture.json", "mesh.npz"):
        (target / name).unlink()
    for name in ("gt", "landmarks", "static360"):
        shutil.rmtree(target / name)
    for folder in (target / "images").iterdir():
        for path in folder.iterdir():
            if path.name.startswith(("hair", "orient")):
                path.unlink()
                continue
            image = Image.open(path).convert("RGB")
            if path.name.startswith("image"):
                image = Image.fromarray(np.maximum(np.asarray(image), 90))  # a grey wall behind
            kind, _, name = path.stem.partition("_")
            image.save(folder / f"{kind}_{name}.jpg", quality=95)
            image.resize((20, 20), Image.Resampling.BOX).save(folder / f"{kind}_lowres_{name}.jpg", quality=95)
            path.unlink()
    return target
