"""Training the encoders on a few straight hairstyles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from views import FRAME, camera_at

from dynhair.prior import training
from dynhair.prior.dataset import TEXTURE, StyleViews
from dynhair.prior.disturbance import Maps, disturbed, random_views
from dynhair.prior.encoders import EncoderSizes
from dynhair.prior.hair_prior import HairPrior
from dynhair.prior.training import PriorTraining, Target, decoded, fitted_basis, mean_hairstyle, strand_loss
from dynhair.strands.scalp_map import directions, texel_uv

SMALL = EncoderSizes(8, 16, 16, 8)
ROOTS = directions(texel_uv(TEXTURE)).float()
TEXELS = torch.arange(300, 420, 3)


def style_of(length: float, seed: int) -> StyleViews:
    """Hair that stands off the scalp and bends to a side; what is seen of it tells its length."""
    outwards = directions(texel_uv(TEXTURE)).float()[TEXELS]
    along = torch.linspace(0, length, 64)[:, None]
    random = np.random.default_rng(seed)
    waves = torch.from_numpy(random.normal(0, 0.05, (len(TEXELS), 40, 3))).float()
    bend = (along[None] * torch.arange(1, 41)).sin() @ waves
    strands = outwards[:, None] * along + along**2 * torch.tensor([0.2, -0.1, 0.0]) + bend
    cameras = [camera_at(azimuth, size=24) for azimuth in (-30, -10, 10, 30, *range(0, 360, 15))]
    hair = np.zeros((28, 24, 24), np.uint8)
    half = round(4 * length)
    hair[:, 10 - half : 10 + half, 12 - half : 12 + half] = 255
    direction = np.zeros((28, 24, 24, 2), np.int8)
    direction[..., 0] = hair // 2
    depth = np.full((28, 24, 24), np.inf, np.float16)
    return StyleViews("straight", 0, FRAME, cameras, hair, direction, depth, TEXELS, strands)


@pytest.fixture(scope="module")
def styles() -> list[StyleViews]:
    return [style_of(length, seed) for seed, length in enumerate((0.5, 1.0, 2.0))]


@pytest.fixture
def prior(styles: list[StyleViews], monkeypatch: pytest.MonkeyPatch) -> HairPrior:
    monkeypatch.setattr(training, "_BATCH", 2)
    monkeypatch.setattr(training, "_WARM_UP", 1)
    monkeypatch.setattr(training, "_LEARNING_RATE", 4e-3)
    torch.manual_seed(0)
    basis = fitted_basis(styles, "points")
    return HairPrior(basis, mean_hairstyle(styles, basis), ROOTS, SMALL)


def test_mirror_images_lie_at_the_mirrored_texels(styles: list[StyleViews]) -> None:
    target = Target.of(styles[0], 24, mirrored=True)
    uv = texel_uv(TEXTURE)
    mirrored = directions(uv[TEXELS]) * torch.tensor([-1.0, 1.0, 1.0])
    torch.testing.assert_close(directions(uv[target.texels]), mirrored)
    expected = Target.of(styles[0], 24).strands * torch.tensor([-1.0, 1.0, 1.0])
    torch.testing.assert_close(target.strands, expected, atol=1e-5, rtol=1e-5)


def test_the_basis_and_its_mean_are_symmetric(styles: list[StyleViews], prior: HairPrior) -> None:
    texture = prior.basis.decode(prior.mean.movedim(0, -1), 10)
    mirrored = texture.flip(1) * torch.tensor([-1.0, 1.0, 1.0])
    known = torch.zeros(TEXTURE, TEXTURE, dtype=torch.bool)
    known.view(-1)[TEXELS] = True
    known &= known.flip(1)
    torch.testing.assert_close(texture[known], mirrored[known], atol=2e-2, rtol=0)


def test_the_loss_is_nought_for_the_truth_and_relative_to_length(styles: list[StyleViews]) -> None:
    short, long = (Target.of(styles[index], 24).strands for index in (0, 2))
    assert float(strand_loss(short, short)) == pytest.approx(0, abs=1e-6)
    assert strand_loss(short * 1.1, short) > 0.01
    assert strand_loss(short + 0.1, short) > 1.5 * strand_loss(long + 0.1, long)


def test_faults_change_the_views_but_hardly_the_evidence(styles: list[StyleViews]) -> None:
    random = np.random.Generator(np.random.PCG64(0))
    for _ in range(10):
        views = random_views(styles[2], random)
        assert len(set(views)) == len(views) >= 2
        maps = Maps.of(styles[2], views)
        faulty = disturbed(maps, random)
        assert faulty.hair.shape == maps.hair.shape
        assert (faulty.hair >= 0).all()
        assert (faulty.hair <= 1).all()
        assert torch.isfinite(faulty.direction).all()
        for before, after in zip(maps.cameras, faulty.cameras, strict=True):
            assert (before.centre - after.centre).norm() < 0.15
            R = after.w2c[:, :3]
            torch.testing.assert_close(R @ R.T, torch.eye(3), atol=1e-5, rtol=0)
        assert (maps.evidence().volume - faulty.evidence().volume).abs().mean() < 0.2


@torch.no_grad()
def error(prior: HairPrior, styles: list[StyleViews]) -> float:
    """Mean distance of corresponding points, scalp units, over the styles seen from everywhere."""
    distances = []
    for style in styles:
        coefficients = prior(Maps.of(style, range(28)).evidence())
        distances.append((decoded(prior, coefficients, TEXELS, 64) - style.strands).norm(dim=-1).mean())
    return float(torch.stack(distances).mean())


def test_training_learns_and_goes_on_exactly(styles: list[StyleViews], prior: HairPrior, tmp_path: Path) -> None:
    initial = {name: value.clone() for name, value in prior.state_dict().items()}
    before = error(prior, styles)
    whole = PriorTraining(prior, styles, tmp_path / "whole", 24, seed=0)
    whole.run(8, lambda step, loss: None, lambda prior: {"known": 1.0})
    assert [entry["step"] for entry in whole.course] == [8, 16, 24]
    assert error(prior, styles) < 0.98 * before

    other = HairPrior(prior.basis, prior.mean, ROOTS, SMALL)
    other.load_state_dict(initial)
    begun = PriorTraining(other, styles, tmp_path / "cut", 24, seed=0)

    def interrupt(step: int, loss: float) -> None:
        if step == 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        begun.run(8, interrupt)
    resumed = PriorTraining(HairPrior(prior.basis, prior.mean, ROOTS, SMALL), styles, tmp_path / "cut", 24, seed=0)
    assert resumed.step == 8
    resumed.run(8, lambda step, loss: None)
    pairs = zip(resumed.prior.state_dict().values(), prior.state_dict().values(), strict=True)
    assert all(torch.equal(*pair) for pair in pairs)
    assert [entry["step"] for entry in resumed.course] == [8, 16, 24]


def test_decoded_strands_of_the_mean_are_finite(prior: HairPrior) -> None:
    strands = decoded(prior, prior.mean, TEXELS, 12)
    assert strands.shape == (len(TEXELS), 12, 3)
    assert torch.isfinite(strands).all()
