"""The strands' basis against NumPy's SVD, in three forms."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.prior import POINTS, BasisFit, StrandBasis, fit_basis, normal_form
from dynhair.prior.basis import Form
from dynhair.strands import ScalpFrame, segment_lengths

FORMS: tuple[Form, ...] = ("points", "fourier", "segments")


def strands(count: int = 300, seed: int = 0) -> torch.Tensor:
    """Wavy strands that fall, in normal form, with a spectrum that decreases clearly."""
    generator = np.random.default_rng(seed)
    along = np.linspace(0, 1, POINTS)[None, :, None]
    orders = np.arange(1, 20)[:, None, None]
    waves = np.sin(orders * along * math.pi / 2)
    amplitudes = generator.normal(size=(count, 19, 3)) / orders[:, 0] ** 1.5
    paths = np.einsum("nka,kpo->npa", amplitudes, waves)
    fall = np.concatenate([0 * along, -3 * along, 0 * along], axis=2)
    return torch.from_numpy(paths + fall * generator.uniform(0.2, 1, (count, 1, 1)))


@cache
def fitted(form: Form = "points") -> StrandBasis:
    return fit_basis(strands(), count=10, form=form).to(torch.float64)


def transformed(form: Form, rows: np.ndarray) -> np.ndarray:
    """The form of points after the root (n, 199, 3), written down anew."""
    if form == "segments":
        rows = np.diff(rows, axis=1, prepend=0)
    if form == "fourier":
        spectrum = np.fft.rfft(rows, axis=1, norm="ortho")
        rows = np.concatenate([spectrum.real, spectrum.imag], axis=1)
    return rows.reshape(len(rows), -1)


@pytest.mark.parametrize("form", FORMS)
def test_no_linear_code_does_better(form: Form) -> None:
    """The squared error in the form's measure is the one that the SVD says is the least (Eckart and Young)."""
    given, basis = strands(), fitted(form)
    rows = transformed(form, given[:, 1:].numpy())
    singular = np.linalg.svd(rows - rows.mean(axis=0), compute_uv=False)
    np.testing.assert_allclose(basis.deviation, singular[:10] / math.sqrt(len(given)), rtol=1e-5)
    for count in (3, 10):
        rest = given - basis.decode(basis.encode(given)[:, :count])
        error = (transformed(form, rest[:, 1:].numpy()) ** 2).sum()
        assert error == pytest.approx((singular[count:] ** 2).sum(), rel=1e-4)


@pytest.mark.parametrize("form", FORMS)
def test_strands_of_the_basis_come_back(form: Form) -> None:
    basis = fitted(form)
    coefficients = torch.randn(2, 5, 10, generator=torch.Generator().manual_seed(0)) * basis.deviation
    decoded = basis.decode(coefficients)
    assert (decoded[..., 0, :] == 0).all()
    torch.testing.assert_close(basis.encode(decoded), coefficients, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("form", FORMS)
def test_encoding_is_the_nearest_strand_of_the_basis(form: Form) -> None:
    """Against NumPy's least squares; leading coefficients too."""
    basis, other = fitted(form), strands(4, seed=9)
    design = transformed(form, basis.components.numpy().reshape(10, 199, 3))
    target = transformed(form, (other[:, 1:].flatten(1) - basis.mean).numpy().reshape(4, 199, 3))
    for leading in (5, 10):
        expected = np.linalg.lstsq(design[:leading].T, target.T, rcond=None)[0].T
        np.testing.assert_allclose(basis.encode(other)[:, :leading], expected, atol=1e-5)


def test_all_forms_are_the_same_with_all_components() -> None:
    """Random walks span all 597 dimensions; the code is then exact, whatever the form."""
    walks = torch.randn(700, POINTS - 1, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    given = torch.nn.functional.pad(walks.cumsum(dim=1), (0, 0, 1, 0)) / POINTS
    for form in FORMS:
        basis = fit_basis(given, count=597, form=form).to(torch.float64)
        torch.testing.assert_close(basis.decode(basis.encode(given)), given, atol=1e-5, rtol=0)


def test_fourier_is_points_but_for_the_share_of_frequency_zero() -> None:
    """Strands whose points' mean is common to all of them have the same components in both forms."""
    given = strands()
    level = given[:, 1:].mean(dim=1, keepdim=True)
    given[:, 1:] -= level - level.mean(dim=0)
    points, fourier = (fit_basis(given, count=5, form=form) for form in ("points", "fourier"))
    torch.testing.assert_close(fourier.decode(fourier.encode(given)), points.decode(points.encode(given)))
    torch.testing.assert_close(fourier.deviation * math.sqrt(2), points.deviation)


@given(st.lists(st.floats(-3, 3), min_size=10, max_size=10), st.floats(-2, 2), st.sampled_from([2, 13, 64, 200]))
@settings(deadline=None, max_examples=30)
def test_decoding_is_linear_about_the_mean(values: list[float], scale: float, points: int) -> None:
    basis = fitted()
    one = torch.tensor(values, dtype=torch.float64)
    mean = basis.decode(0 * one, points)
    torch.testing.assert_close(basis.decode(scale * one, points) - mean, scale * (basis.decode(one, points) - mean))


@pytest.mark.parametrize("points", [2, 20, 64, 200, 399])
def test_fewer_points_are_those_of_the_whole_strand(points: int) -> None:
    basis = fitted()
    coefficients = basis.encode(strands(6, seed=3))
    whole = basis.decode(coefficients).numpy()
    places = np.linspace(0, 1, points)
    expected = [[np.interp(places, np.linspace(0, 1, POINTS), x) for x in strand.T] for strand in whole]
    np.testing.assert_allclose(basis.decode(coefficients, points), np.swapaxes(expected, 1, 2), atol=1e-6)


def test_fewer_coefficients_are_the_others_at_zero() -> None:
    basis = fitted()
    coefficients = basis.encode(strands(6))
    padded = torch.nn.functional.pad(coefficients[:, :3], (0, 7))
    torch.testing.assert_close(basis.decode(coefficients[:, :3]), basis.decode(padded))


def test_strands_may_come_in_batches_and_have_weights() -> None:
    given = strands(90)
    weights = torch.arange(90, dtype=torch.float64) % 3
    repeated = fit_basis(given.repeat_interleave(weights.long(), dim=0), count=6, form="segments")
    fit = BasisFit()
    for some, shares in zip(given.split(40), weights.split(40), strict=True):
        fit.add(some, 0.5 * shares)
    for name, value in fit.fit(6, "segments").to_state().items():
        torch.testing.assert_close(value, repeated.to_state()[name], atol=1e-5, rtol=1e-5)


def test_gradients_reach_coefficients() -> None:
    basis = fitted()
    coefficients = torch.randn(3, 10, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda c: basis.decode(c, 9), coefficients)


def test_a_stored_basis_is_the_same_and_is_checked() -> None:
    basis = fitted()
    state = basis.to_state()
    again = StrandBasis.from_state(state)
    assert all(torch.equal(value, state[name]) for name, value in again.to_state().items())
    for broken in ({**state, "mean": state["mean"][1:]}, {**state, "deviation": state["deviation"] * math.nan}, {}):
        with pytest.raises(DynhairError, match="no usable"):
            StrandBasis.from_state(broken)


def test_normal_form() -> None:
    frame = ScalpFrame(centre=torch.tensor([0.1, 0.2, 0.3]), radius=0.09)
    given = torch.randn(5, 20, 3, generator=torch.Generator().manual_seed(0)).cumsum(dim=1)
    normal = normal_form(given, frame)
    assert normal.shape == (5, POINTS, 3)
    assert (normal[:, 0] == 0).all()
    torch.testing.assert_close(normal[:, -1] * 0.09, given[:, -1] - given[:, 0])
    straight = normal_form(given[:, :2], frame)
    lengths = segment_lengths(straight)
    torch.testing.assert_close(lengths, lengths.mean(dim=1, keepdim=True).expand_as(lengths), rtol=1e-3, atol=0)


def test_bad_input_is_refused() -> None:
    basis, given = fitted(), strands(5)
    with pytest.raises(DynhairError, match="10 components cannot decode 11"):
        basis.decode(torch.zeros(11))
    with pytest.raises(DynhairError, match="to 1 points"):
        basis.decode(torch.zeros(10), 1)
    with pytest.raises(DynhairError, match="without strands"):
        BasisFit().fit(3)
    with pytest.raises(DynhairError, match="cannot have 598"):
        fit_basis(given, count=598)
    with pytest.raises(DynhairError, match="normal form"):
        fit_basis(given + 1)
    with pytest.raises(DynhairError, match="normal form"):
        fit_basis(given * math.nan)
    with pytest.raises(DynhairError, match="negative"):
        fit_basis(given, weights=torch.full((5,), -1.0))
