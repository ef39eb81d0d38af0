"""What all tests of training share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.prior.basis import fit_basis
from dynhair.prior.encoders import EncoderSizes
from dynhair.prior.hair_prior import HairPrior
from dynhair.strands.scalp_map import directions, texel_uv
from dynhair.training import static_hair
from dynhair.training.rest_scene import RestScene
from dynhair.training.static_model import POINTS


@pytest.fixture(scope="session")
def small_prior(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An untrained prior that guesses strands which hang down, slightly bent."""
    random = torch.Generator().manual_seed(0)
    along = torch.linspace(0, 1, 200)[None, :, None]
    lengths = 0.6 + 0.6 * torch.rand(300, 1, 1, generator=random)
    lean = 0.4 * torch.randn(300, 1, 3, generator=random)
    down = torch.tensor([0.0, -1.0, 0.0])
    basis = fit_basis(lengths * (along * down + along.square() * lean), count=16)
    sizes = EncoderSizes(volume=4, code=8, texture=8, point=4)
    torch.manual_seed(0)
    prior = HairPrior(basis, torch.zeros(16, 16, 16), directions(texel_uv(16)).float(), sizes)
    path = tmp_path_factory.mktemp("prior") / "prior.safetensors"
    prior.save(path)
    return path


@pytest.fixture(scope="session", autouse=True)
def quick_prior(small_prior: Path) -> Iterator[None]:
    """The small prior in the place of the package's own, which takes longer and is tested by itself."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(static_hair, "builtin_prior", lambda: HairPrior.load(small_prior))
        yield


def bristles(
    scene: RestScene, count: int, generations: int, seed: int, progress: Callable[[int, float], None]
) -> Float[Tensor, "n 200 3"]:
    """Short strands that stand off the scalp."""
    positions, normals = scene.roots(count, seed)
    progress(generations, 1.0)
    return positions[:, None] + torch.linspace(0, 0.02, POINTS)[:, None] * normals[:, None]


@pytest.fixture(scope="session", autouse=True)
def quick_style() -> Iterator[None]:
    """Bristles in the place of the search for a style, which takes seconds and is tested by itself."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(static_hair, "grown_style", bristles)
        yield
