"""Errors of reconstruction, written down anew, and their plot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from dynhair.errors import DynhairError
from dynhair.prior import POINTS, StrandBasis, fit_basis
from dynhair.prior.basis_report import plot_reconstruction, reconstruction_errors


def walks(count: int, seed: int = 0) -> torch.Tensor:
    """Random walks smoothed into strands."""
    generator = torch.Generator().manual_seed(seed)
    knots = torch.randn(count, 3, 8, generator=generator, dtype=torch.float64).cumsum(dim=2)
    fine = torch.nn.functional.interpolate(knots, POINTS, mode="linear", align_corners=True).mT
    return fine - fine[:, :1]


def basis() -> StrandBasis:
    return fit_basis(walks(100), count=9).to(torch.float64)


def test_errors_are_those_of_their_definitions() -> None:
    given = walks(30, seed=1)
    (error,) = reconstruction_errors(basis(), {"walks": given}, counts=(4,), radius=0.1)
    rebuilt = basis().decode(basis().encode(given)[:, :4]).numpy()
    truth = given.numpy()
    assert error.distance_mm == pytest.approx(100 * np.linalg.norm(rebuilt - truth, axis=2)[:, 1:].mean())
    one, two = np.diff(truth, axis=1), np.diff(rebuilt, axis=1)
    norms = np.linalg.norm(one, axis=2), np.linalg.norm(two, axis=2)
    angles = np.degrees(np.arccos(((one * two).sum(axis=2) / norms[0] / norms[1]).clip(-1, 1)))
    assert error.angle_deg == pytest.approx(angles.mean(), abs=1e-5)
    assert error.length_ratio == pytest.approx(norms[1].sum() / norms[0].sum())
    assert (error.strands, error.count) == ("walks", 4)


def test_more_components_lose_less_and_too_many_are_left_out() -> None:
    errors = reconstruction_errors(basis(), {"a": walks(100), "b": walks(20, seed=2)}, counts=(2, 4, 8, 16))
    assert [(error.strands, error.count) for error in errors] == [(s, c) for s in "ab" for c in (2, 4, 8)]
    own = [error.distance_mm for error in errors if error.strands == "a"]
    assert own == sorted(own, reverse=True)


def test_errors_are_plotted(tmp_path: Path) -> None:
    errors = {"points": reconstruction_errors(basis(), {"a": walks(10), "b": walks(10, seed=2)}, counts=(2, 4, 8))}
    plot_reconstruction(errors, tmp_path / "plot.png")
    with Image.open(tmp_path / "plot.png") as picture:
        assert np.asarray(picture.convert("L")).std() > 5
    assert [path.name for path in tmp_path.iterdir()] == ["plot.png"]


def test_a_set_without_strands_is_refused() -> None:
    with pytest.raises(DynhairError, match="`none` has no strands"):
        reconstruction_errors(basis(), {"none": walks(3)[:0]})
