"""The deformation network against the paper's formulas written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.interpolate import CubicSpline
from torch.nn import functional

from dynhair.avatar.deformer import DISPLACEMENT_UNIT, POSITION_UNIT, PaperDeformer
from dynhair.avatar.encoding import encoded_size, positional_encoding
from dynhair.avatar.mlp import use_precision
from dynhair.config import DeformerConfig
from dynhair.motion import signal_names

CONFIG = DeformerConfig(history=3, position_frequencies=2, place_frequencies=2, hidden=8, width=16, layers=2, knots=0)
KNOTS = {4: [0, 2, 4, 6], 2: [0, 6]}  # of strands of 7 points


def canonical(strands: int = 5, points: int = 7, seed: int = 0) -> torch.Tensor:
    return torch.randn(strands, points, 3, generator=torch.Generator().manual_seed(seed)) * 0.1


def lively(deformer: PaperDeformer) -> PaperDeformer:
    """With weights of the order of one in every layer, unlike a fresh network."""
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in deformer.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=generator, dtype=parameter.dtype) * 0.3)
    return deformer


def embedding(deformer: PaperDeformer, window: torch.Tensor) -> torch.Tensor:
    signal = positional_encoding(window, deformer.config.signal_frequencies)
    if deformer.config.encoder == "lstm":
        _, (h, _) = deformer.lstm(signal[None], (deformer.h0, deformer.c0))
        return h[0, 0]
    x = torch.cat(list(signal))
    linear = [layer for layer in deformer.window_mlp if isinstance(layer, torch.nn.Linear)]
    for layer in linear[:-1]:
        x = functional.leaky_relu(layer.weight @ x + layer.bias)
    return linear[-1].weight @ x + linear[-1].bias


def written_out(deformer: PaperDeformer, strands: torch.Tensor, window: torch.Tensor) -> torch.Tensor:
    """The network knot by knot: embedding, FiLM on the encoded position, concatenation, MLP, attenuation.

    Between knots SciPy's spline.
    """
    n, points = strands.shape[:2]
    config, z = deformer.config, embedding(deformer, window)
    knots = KNOTS.get(config.knots, list(range(points)))
    position = positional_encoding((strands - strands.mean((0, 1))) / POSITION_UNIT, config.position_frequencies)
    result = torch.zeros_like(strands)
    for i in range(n):
        for j in knots:
            place = positional_encoding(torch.tensor([j / points], dtype=strands.dtype), config.place_frequencies)
            if config.film:
                scale, shift = deformer.film(z).chunk(2)
                x = torch.cat([position[i, j] * (1 + scale) + shift, place])
            else:
                x = torch.cat([position[i, j], place, z])
            for k, layer in enumerate(deformer.mlp):
                x = layer(x)
                if k + 1 < len(deformer.mlp):
                    x = functional.leaky_relu(x)
            result[i, j] = x
    if len(knots) < points:
        curves = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")(np.arange(points))
        result = torch.einsum("lk,nkc->nlc", torch.from_numpy(curves), result[:, knots])
    return result * deformer.root_attenuation[:, None] * DISPLACEMENT_UNIT


VARIANTS = {
    "paper": CONFIG,
    "4 knots": replace(CONFIG, knots=4),
    "2 knots, mlp": replace(CONFIG, knots=2, encoder="mlp"),
    "no acceleration": replace(CONFIG, acceleration=False),
    "pose": replace(CONFIG, signals="pose"),
    "no gravity": replace(CONFIG, gravity=False),
    "no film": replace(CONFIG, film=False),
    "mlp": replace(CONFIG, encoder="mlp"),
    "mlp, no film, no gravity": replace(CONFIG, encoder="mlp", film=False, gravity=False),
}


@pytest.mark.parametrize("config", VARIANTS.values(), ids=VARIANTS.keys())
def test_folded_network_is_the_papers_in_values_and_gradients(config: DeformerConfig) -> None:
    strands = canonical().double()
    deformer = lively(PaperDeformer(strands, config).double())
    size = 3 * len(signal_names(config))
    window = torch.randn(4, size, generator=torch.Generator().manual_seed(2), dtype=torch.double).requires_grad_()
    expected = written_out(deformer, strands, window)
    actual = deformer(window)
    torch.testing.assert_close(actual, expected)
    inputs = [window, *deformer.parameters()]
    weight = torch.randn(expected.shape, generator=torch.Generator().manual_seed(3)).double()
    for a, b in zip(
        torch.autograd.grad((actual * weight).sum(), inputs),
        torch.autograd.grad((expected * weight).sum(), inputs),
        strict=True,
    ):
        assert a.abs().max() > 0
        torch.testing.assert_close(a, b)


def test_both_encoders_are_of_about_the_same_size() -> None:
    sizes = []
    for encoder in ("lstm", "mlp"):
        deformer = PaperDeformer(canonical(), DeformerConfig(encoder=encoder))
        sizes.append(sum(p.numel() for p in deformer.parameters()))
    assert 0.8 < sizes[1] / sizes[0] < 1.25


def test_the_root_moves_as_its_attenuation_says_however_few_the_knots() -> None:
    deformer = lively(PaperDeformer(canonical(), replace(CONFIG, knots=3)))
    with torch.no_grad():
        deformer.root_attenuation[:2] = 0.0
    moved = deformer(torch.randn(4, 9, generator=torch.Generator().manual_seed(6)))
    assert moved[:, :2].abs().max() == 0
    assert moved[:, 2:].abs().amin(0).max() > 0


def test_a_fresh_network_leaves_the_hair_where_it_is() -> None:
    deformer = PaperDeformer(canonical(), DeformerConfig())
    assert deformer(torch.ones(6, 9)).abs().max() < 1e-4


def test_attenuation_starts_as_a_ramp_from_root_to_tip() -> None:
    ramp = PaperDeformer(canonical(points=11), CONFIG).root_attenuation.detach()
    assert ramp[0] < 0.1
    assert ramp[-1] == 1
    torch.testing.assert_close(ramp.diff(), ramp.diff()[:1].expand(10))


def test_the_order_of_the_window_matters() -> None:
    deformer = lively(PaperDeformer(canonical(), CONFIG))
    window = torch.randn(4, 9, generator=torch.Generator().manual_seed(4))
    assert (deformer(window) - deformer(window.flip(0))).abs().max() > 1e-3


def test_bfloat16_errs_by_less_than_two_percent() -> None:
    deformer = lively(PaperDeformer(canonical(50, 20), CONFIG))
    window = torch.randn(4, 9, generator=torch.Generator().manual_seed(5))
    exact = deformer(window)
    use_precision(deformer, torch.bfloat16)
    quick = deformer(window)
    assert quick.dtype == torch.float32
    assert 0 < (quick - exact).norm(dim=-1).mean() / exact.norm(dim=-1).mean() < 0.02
    use_precision(deformer, None)
    assert torch.equal(deformer(window), exact)


def test_encoding_is_identity_sines_cosines() -> None:
    x = torch.tensor([[0.3, -1.2]])
    expected = torch.tensor(
        [[0.3, -1.2, *torch.tensor([0.3, -1.2, 0.6, -2.4]).sin(), *torch.tensor([0.3, -1.2, 0.6, -2.4]).cos()]]
    )
    torch.testing.assert_close(positional_encoding(x, 2), expected)
    assert positional_encoding(x, 2).shape[-1] == encoded_size(2, 2)
