"""The deformation network against the paper's formulas written out."""

from __future__ import annotations

import torch
from torch.nn import functional

from dynhair.avatar.deformer import DISPLACEMENT_UNIT, POSITION_UNIT, HairDeformer
from dynhair.avatar.encoding import encoded_size, positional_encoding
from dynhair.avatar.mlp import use_precision
from dynhair.config import DeformerConfig

CONFIG = DeformerConfig(history=3, position_frequencies=2, place_frequencies=2, hidden=8, width=16, layers=2)


def canonical(strands: int = 5, points: int = 7, seed: int = 0) -> torch.Tensor:
    return torch.randn(strands, points, 3, generator=torch.Generator().manual_seed(seed)) * 0.1


def lively(deformer: HairDeformer) -> HairDeformer:
    """With weights of the order of one in every layer, unlike a fresh network."""
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in deformer.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=generator, dtype=parameter.dtype) * 0.3)
    return deformer


def written_out(deformer: HairDeformer, strands: torch.Tensor, window: torch.Tensor) -> torch.Tensor:
    """The network point by point: LSTM, FiLM on the encoded position, concatenation, MLP, attenuation."""
    n, points = strands.shape[:2]
    h, c = deformer.h0, deformer.c0
    _, (h, c) = deformer.lstm(positional_encoding(window, CONFIG.signal_frequencies)[None], (h, c))
    scale, shift = deformer.film(h[0, 0]).chunk(2)
    position = positional_encoding((strands - strands.mean((0, 1))) / POSITION_UNIT, CONFIG.position_frequencies)
    result = torch.zeros_like(strands)
    for i in range(n):
        for j in range(points):
            place = positional_encoding(torch.tensor([j / points], dtype=strands.dtype), CONFIG.place_frequencies)
            x = torch.cat([position[i, j] * (1 + scale) + shift, place])
            for k, layer in enumerate(deformer.mlp):
                x = layer(x)
                if k + 1 < len(deformer.mlp):
                    x = functional.leaky_relu(x)
            result[i, j] = x * deformer.root_attenuation[j] * DISPLACEMENT_UNIT
    return result


def test_folded_network_is_the_papers_in_values_and_gradients() -> None:
    strands = canonical().double()
    deformer = lively(HairDeformer(strands, CONFIG).double())
    window = torch.randn(4, 9, generator=torch.Generator().manual_seed(2)).double()
    expected = written_out(deformer, strands, window)
    actual = deformer(window)
    torch.testing.assert_close(actual, expected)
    parameters = list(deformer.parameters())
    weight = torch.randn(expected.shape, generator=torch.Generator().manual_seed(3)).double()
    for a, b in zip(
        torch.autograd.grad((actual * weight).sum(), parameters),
        torch.autograd.grad((expected * weight).sum(), parameters),
        strict=True,
    ):
        torch.testing.assert_close(a, b)


def test_a_fresh_network_leaves_the_hair_where_it_is() -> None:
    deformer = HairDeformer(canonical(), DeformerConfig())
    assert deformer(torch.ones(6, 9)).abs().max() < 1e-4


def test_attenuation_starts_as_a_ramp_from_root_to_tip() -> None:
    ramp = HairDeformer(canonical(points=11), CONFIG).root_attenuation.detach()
    assert ramp[0] < 0.1
    assert ramp[-1] == 1
    torch.testing.assert_close(ramp.diff(), ramp.diff()[:1].expand(10))


def test_the_order_of_the_window_matters() -> None:
    deformer = lively(HairDeformer(canonical(), CONFIG))
    window = torch.randn(4, 9, generator=torch.Generator().manual_seed(4))
    assert (deformer(window) - deformer(window.flip(0))).abs().max() > 1e-3


def test_bfloat16_errs_by_less_than_two_percent() -> None:
    deformer = lively(HairDeformer(canonical(50, 20), CONFIG))
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
