"""The shape basis: strands as a few coefficients, by principal components of many hairstyles' strands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.strands import ScalpFrame, resample_strands

POINTS = 200  # of a strand in normal form
_COORDINATES = 3 * (POINTS - 1)

Form = Literal["points", "fourier", "segments"]


def normal_form(strands: Float[Tensor, "n l 3"], frame: ScalpFrame) -> Float[Tensor, "n 200 3"]:
    """Bring strands of a head into normal form: relative to their roots, in scalp units, 200 points at equal steps."""
    return resample_strands((strands - strands[:, :1]) / frame.radius, POINTS)


@dataclass(frozen=True, eq=False)
class StrandBasis:
    """A linear code of strands in normal form.

    A strand is ``mean + coefficients @ components`` and its root exactly 0, whatever the coefficients. Components are
    in the order of the variance that they explain, so that any leading part of them is a basis of its own.

    Attributes:
        mean: of the training strands: coordinates of the points after the root, point by point.
        components: what each coefficient adds.
        projection: rows that yield the coefficients of a strand less the mean.
        deviation: standard deviation of each coefficient over the training strands; their means are 0.
    """

    mean: Float[Tensor, "597"]
    components: Float[Tensor, "k 597"]
    projection: Float[Tensor, "k 597"]
    deviation: Float[Tensor, " k"]
    _rows: dict[int, tuple[Tensor, Tensor]] = field(default_factory=dict, init=False, repr=False)

    def __len__(self) -> int:
        return len(self.components)

    def encode(self, strands: Float[Tensor, "*n 200 3"]) -> Float[Tensor, "*n k"]:
        """Find the coefficients whose strands come nearest to given ones.

        Nearest by least squares, in the measure in which the basis was fitted (`BasisFit.fit`), among the strands of
        this basis; the components are orthonormal in it, so that leading coefficients are also the best on their own.

        Args:
            strands: in normal form; roots are not looked at.
        """
        return (strands[..., 1:, :].flatten(-2) - self.mean.to(strands)) @ self.projection.to(strands).T

    def decode(self, coefficients: Float[Tensor, "*n k"], points: int = POINTS) -> Float[Tensor, "*n p 3"]:
        """Turn coefficients into strands.

        Args:
            coefficients: of any number of leading components.
            points: of each strand, at equal steps along the normal form's parameter. Fewer than 200 cost less: what
                lies between is never computed. Linear interpolation where a step falls between two of the 200 points.

        Raises:
            DynhairError: more coefficients than the basis has, or fewer than two points.
        """
        used = coefficients.shape[-1]
        if used > len(self):
            raise DynhairError(f"a basis of {len(self)} components cannot decode {used} coefficients")
        mean, components = self._at(points)
        decoded = mean.to(coefficients) + coefficients @ components[:used].to(coefficients)
        return decoded.unflatten(-1, (points, 3))

    def to(self, target: torch.device | torch.dtype | str) -> StrandBasis:
        """Move to another device or precision."""
        return StrandBasis(**{name: value.to(target) for name, value in self.to_state().items()})

    def to_state(self) -> dict[str, Tensor]:
        """Name the tensors that make up the basis, for storing."""
        return {name: getattr(self, name) for name in ("mean", "components", "projection", "deviation")}

    @classmethod
    def from_state(cls, state: Mapping[str, Tensor]) -> StrandBasis:
        """Make a basis of stored tensors.

        Raises:
            DynhairError: a tensor is missing, is not finite, or its shape is another.
        """
        count = len(state["components"]) if "components" in state else 0
        rows = (count, _COORDINATES)
        expected = {"mean": (_COORDINATES,), "components": rows, "projection": rows, "deviation": (count,)}
        for name, shape in expected.items():
            if name not in state or tuple(state[name].shape) != shape or not bool(state[name].isfinite().all()):
                raise DynhairError(
                    f"the strand basis has no usable `{name}`", expected=f"finite numbers in the shape {shape}"
                )
        return cls(**{name: state[name] for name in expected})

    def _at(self, points: int) -> tuple[Tensor, Tensor]:
        """Mean and components at fewer or more points, root included, with all points' coordinates in a row."""
        if points < 2:
            raise DynhairError(f"strands cannot be decoded to {points} points", expected="at least 2")
        if points not in self._rows:
            stacked = torch.cat([self.mean[None], self.components]).unflatten(1, (POINTS - 1, 3))
            stacked = torch.nn.functional.pad(stacked, (0, 0, 1, 0))
            places = torch.linspace(0, POINTS - 1, points, dtype=torch.float64, device=stacked.device)
            before = places.long().clamp_max(POINTS - 2)
            weights = (places - before).to(stacked)[:, None]
            rows = stacked[:, before] * (1 - weights) + stacked[:, before + 1] * weights
            self._rows[points] = rows[0].flatten(), rows[1:].flatten(1)
        return self._rows[points]


class BasisFit:
    """Principal components of strands that come batch by batch.

    Only sums and products of coordinates are kept, in float64: memory does not grow with the number of strands.
    """

    def __init__(self) -> None:
        self._weight = 0.0
        self._sum = torch.zeros(_COORDINATES, dtype=torch.float64)
        self._products = torch.zeros(_COORDINATES, _COORDINATES, dtype=torch.float64)

    def add(self, strands: Float[Tensor, "n 200 3"], weights: Float[Tensor, " n"] | None = None) -> None:
        """Take in strands.

        Args:
            strands: in normal form.
            weights: of each strand, not negative; all 1 if not given.

        Raises:
            DynhairError: strands or weights are not finite, are not in normal form, or a weight is negative.
        """
        if tuple(strands.shape[1:]) != (POINTS, 3) or not bool(strands.isfinite().all()) or bool(strands[:, 0].any()):
            raise DynhairError("strands of a basis must be in normal form", expected="finite (n, 200, 3), roots at 0")
        rows = strands[:, 1:].flatten(1).detach().cpu().double()
        weighted = rows
        if weights is not None:
            if not bool((weights.isfinite() & (weights >= 0)).all()):
                raise DynhairError("a strand's weight must be finite and not negative")
            weighted = rows * weights.detach().cpu().double()[:, None]
        self._weight += float(len(rows) if weights is None else weights.double().sum())
        self._sum += weighted.sum(dim=0)
        self._products += weighted.T @ rows

    def fit(self, count: int, form: Form = "points") -> StrandBasis:
        """Find the components that explain most of the strands' variance.

        The form is the measure of what is a small error. All are linear in the points, so that each gives a basis of
        the same kind; with all 597 components they are the same.

        - ``points``: the points' distances.
        - ``fourier``: real and imaginary parts of the real Fourier transform of the points after the root
          (Im2Haircut). As distances, but that any frequency other than 0 counts half; hardly ever does it matter.
        - ``segments``: differences between successive points, which makes much of direction and curl. On procedural
          hairstyles of families that were never seen, it loses in distance with any count, and from 16 components on
          in the segments' directions too.

        Args:
            count: number of components, up to 597.
            form: ``points``: the points' distances. ``fourier``: real and imaginary parts of the real Fourier
                transform of the points after the root (Im2Haircut): as distances, but a frequency other than 0 counts
                half. ``segments``: differences between successive points, which makes much of direction and curl.

        Raises:
            DynhairError: no strands were added, or the count or the form does not exist.
        """
        if self._weight <= 0:
            raise DynhairError("a basis cannot be fitted without strands")
        if not 0 < count <= _COORDINATES:
            raise DynhairError(f"a basis cannot have {count} components", expected=f"1 to {_COORDINATES}")
        mean = self._sum / self._weight
        covariance = self._products / self._weight - torch.outer(mean, mean)
        forwards = torch.kron(_transform(form), torch.eye(3, dtype=torch.float64))
        variances, axes = torch.linalg.eigh(forwards @ covariance @ forwards.T)
        axes = axes.flip(1)[:, :count].T
        components = torch.linalg.solve(forwards, axes.T).T
        # The sign of an eigenvector is anyone's choice: a component's largest coordinate is made positive.
        largest = components.gather(1, components.abs().argmax(dim=1, keepdim=True))
        return StrandBasis(
            mean=mean.float(),
            components=(components * largest.sign()).float(),
            projection=(axes @ forwards * largest.sign()).float(),
            deviation=variances.flip(0)[:count].clamp_min(0).sqrt().float(),
        )


def fit_basis(
    strands: Float[Tensor, "n 200 3"],
    weights: Float[Tensor, " n"] | None = None,
    count: int = 64,
    form: Form = "points",
) -> StrandBasis:
    """Fit a basis to strands that are all at hand; see :class:`BasisFit`."""
    fit = BasisFit()
    fit.add(strands, weights)
    return fit.fit(count, form)


def _transform(form: Form) -> Float64[Tensor, "199 199"]:
    """The square matrix that takes one coordinate of the points after the root into a form."""
    identity = torch.eye(POINTS - 1, dtype=torch.float64)
    if form == "points":
        return identity
    if form == "segments":
        return torch.diff(identity, dim=0, prepend=torch.zeros(1, POINTS - 1, dtype=torch.float64))
    if form == "fourier":
        spectrum = torch.fft.rfft(identity, dim=0, norm="ortho")
        return torch.cat([spectrum.real, spectrum.imag[1:]])  # frequency 0 has no imaginary part
    raise DynhairError(f"no strand basis has the form `{form}`", expected=" or ".join(get_args(Form)))
