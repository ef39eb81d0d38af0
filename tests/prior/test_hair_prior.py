"""The hair prior: from evidence to strands, and as a file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import safetensors.torch
import torch
from torch import Tensor
from views import FRAME, camera_at

from dynhair.errors import DynhairError
from dynhair.prior import fit_basis
from dynhair.prior.encoders import EncoderSizes
from dynhair.prior.evidence import CHANNELS, GRID, Evidence, gather_evidence
from dynhair.prior.hair_prior import HairPrior, builtin_prior
from dynhair.strands import segment_lengths
from dynhair.strands.scalp_map import directions, texel_uv

SIZE = 8
ROOTS = directions(texel_uv(SIZE)).float()
VALID = torch.ones(SIZE, SIZE, dtype=torch.bool)


def smooth_strands(count: int, seed: int) -> Tensor:
    random = torch.Generator().manual_seed(seed)
    waves = torch.randn(count, 5, 3, generator=random) / torch.arange(1, 6)[:, None]
    along = torch.linspace(0, 1, 200)[:, None]
    return (along * torch.arange(1, 6)).sin() @ waves


@pytest.fixture
def prior() -> HairPrior:
    """Small, with random weights everywhere."""
    torch.manual_seed(0)
    basis = fit_basis(smooth_strands(300, 0), count=12)
    prior = HairPrior(basis, 0.1 * torch.randn(12, SIZE, SIZE), ROOTS, EncoderSizes(4, 8, 8, 4), {"styles": 300})
    with torch.no_grad():
        for parameter in prior.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
    return prior.eval()


@pytest.fixture
def evidence() -> Evidence:
    torch.manual_seed(1)
    return Evidence(torch.rand(CHANNELS, *GRID))


def test_a_batch_is_its_parts(prior: HairPrior, evidence: Evidence) -> None:
    other = evidence.mirrored()
    with torch.no_grad():
        together = prior(Evidence.batch([evidence, other]))
        alone = torch.stack([prior(evidence), prior(other)])
    assert alone.shape == (2, 12, SIZE, SIZE)
    torch.testing.assert_close(together, alone, atol=1e-5, rtol=1e-5)


def test_the_coarse_network_leaves_the_finer_coefficients_at_their_means(prior: HairPrior, evidence: Evidence) -> None:
    with torch.no_grad():
        coarse, *_, fine = prior.coarse_to_fine(evidence)
    assert torch.equal(coarse[10:], prior.mean[10:])
    assert not torch.equal(coarse[:10], prior.mean[:10])
    assert (fine - coarse).abs().flatten(1).amax(1).min() > 1e-4


def test_strands_begin_at_their_roots_and_are_decoded_at_any_resolution(prior: HairPrior) -> None:
    positions = FRAME.to_head(torch.nn.functional.normalize(torch.rand(30, 3), dim=1))
    strands = prior.strands(prior.mean, VALID, FRAME, positions, 200)
    assert torch.equal(strands[:, 0], positions)
    few = prior.strands(prior.mean, VALID, FRAME, positions, 2)
    assert few.shape == (30, 2, 3)
    with pytest.raises(DynhairError):
        prior.strands(prior.mean, VALID, FRAME, positions, 1)


def test_the_strand_at_a_texel_is_the_texels(prior: HairPrior) -> None:
    truth = smooth_strands(1, 5)[0]
    texture = prior.basis.encode(truth).view(-1, 1, 1).expand(-1, SIZE, SIZE)
    strands = prior.strands(texture, VALID, FRAME, FRAME.centre[None] + torch.tensor([[0.01, 0.1, 0.0]]), 200)
    torch.testing.assert_close((strands[0] - strands[0, 0]) / FRAME.radius, truth, atol=2e-3, rtol=0)


def test_gradients_reach_coefficients_positions_and_encoders(prior: HairPrior, evidence: Evidence) -> None:
    positions = (FRAME.centre + 0.1 * torch.nn.functional.normalize(torch.rand(20, 3), dim=1)).requires_grad_()
    coefficients = prior(evidence)
    coefficients.retain_grad()
    segment_lengths(prior.strands(coefficients, VALID, FRAME, positions, 10)).square().sum().backward()
    assert coefficients.grad is not None
    assert coefficients.grad.any()
    assert all(p.grad is not None and torch.isfinite(p.grad).all() for p in prior.parameters())
    assert any(p.grad.any() for p in prior.coarse.parameters() if p.grad is not None)
    assert positions.grad is not None


def test_a_saved_prior_is_the_same_in_half_precision(prior: HairPrior, evidence: Evidence, tmp_path: Path) -> None:
    prior.save(tmp_path / "prior.safetensors")
    opened = HairPrior.load(tmp_path / "prior.safetensors")
    assert opened.recipe == {"styles": 300}
    assert opened.sizes == prior.sizes
    assert torch.equal(opened.mean, prior.mean)
    with torch.no_grad():
        torch.testing.assert_close(opened(evidence), prior(evidence), atol=2e-2, rtol=2e-2)
    opened.save(tmp_path / "again.safetensors")
    again = HairPrior.load(tmp_path / "again.safetensors")
    assert all(
        torch.equal(a, b) for a, b in zip(again.state_dict().values(), opened.state_dict().values(), strict=True)
    )


def rewritten(path: Path, prior: HairPrior, **changes: object) -> Path:
    """The prior's file with another description."""
    prior.save(path)
    with safetensors.safe_open(path, framework="pt") as file:
        description = json.loads(file.metadata()["dynhair"])
    safetensors.torch.save_file(
        safetensors.torch.load_file(path), path, metadata={"dynhair": json.dumps(description | changes)}
    )
    return path


def test_other_files_are_refused(prior: HairPrior, tmp_path: Path) -> None:
    path = tmp_path / "prior.safetensors"
    with pytest.raises(DynhairError, match="missing"):
        HairPrior.load(path)
    path.write_bytes(b"not safetensors")
    with pytest.raises(DynhairError, match="not readable"):
        HairPrior.load(path)
    safetensors.torch.save_file({"x": torch.zeros(1)}, path)
    with pytest.raises(DynhairError, match="kind None"):
        HairPrior.load(path)
    with pytest.raises(DynhairError, match="release that wrote it"):
        HairPrior.load(rewritten(path, prior, version=2))
    with pytest.raises(DynhairError, match="do not fit"):
        HairPrior.load(rewritten(path, prior, sizes={"volume": 8}))
    with pytest.raises(DynhairError, match="do not fit"):
        HairPrior.load(rewritten(path, prior, sizes=None))


def test_damaged_files_are_refused(prior: HairPrior, tmp_path: Path) -> None:
    path = tmp_path / "prior.safetensors"
    prior.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DynhairError, match="not readable"):
        HairPrior.load(path)
    prior.mean[0, 0, 0] = torch.nan
    prior.save(path)
    with pytest.raises(DynhairError, match="NaN"):
        HairPrior.load(path)


def test_the_builtin_prior_opens_and_predicts_long_hair_for_long_hair() -> None:
    """A curtain of hair around the head, against a cap: the strands' lengths must tell them apart."""
    prior = builtin_prior()
    assert prior is builtin_prior()
    positions = FRAME.to_head(prior.coarse.roots[prior.texels])
    valid = torch.zeros(prior.size, prior.size, dtype=torch.bool)
    valid.view(-1)[prior.texels] = True
    lengths = []
    for hem in (0.0, 0.3):
        hair = torch.zeros(4, 64, 64)
        cameras = [camera_at(azimuth) for azimuth in (0, 90, 180, 270)]
        for view, camera in zip(hair, cameras, strict=True):
            corners = FRAME.centre + torch.tensor([[0.0, 0.12, 0.0], [0.0, -hem, 0.0]])
            (top, bottom), _ = camera.project(corners)
            view[int(top[1]) : int(bottom[1]), 32 - 12 : 32 + 12] = 1
        direction = torch.stack([-hair, torch.zeros_like(hair)], -1)
        evidence = gather_evidence(FRAME, cameras, hair, direction, torch.full_like(hair, torch.inf))
        with torch.no_grad():
            strands = prior.strands(prior(evidence), valid, FRAME, positions, 20)
        lengths.append(segment_lengths(strands).sum(1).mean())
    assert lengths[1] > lengths[0] + 0.1
