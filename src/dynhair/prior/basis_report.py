"""How much of strands a basis keeps: errors of reconstruction over the number of components, as figures and curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.prior.basis import StrandBasis
from dynhair.storage import atomic_file
from dynhair.strands import strand_lengths

COUNTS = (2, 4, 8, 10, 16, 24, 32, 48, 64)
_CHUNK = 4096
_LINES = ("-", "--", ":", "-.")  # told apart even where curves coincide
_COLOURS = ("#3b6fb6", "#d1495b", "#3a9d5d", "#f2a541", "#7d5ba6")


@dataclass(frozen=True)
class ReconstructionError:
    """How far strands lie from their own reconstructions.

    Attributes:
        strands: name of the set of strands.
        count: number of leading components.
        distance_mm: mean over all points after the roots, between corresponding points.
        angle_deg: mean over all segments, between corresponding segments' directions.
        length_ratio: mean of the reconstructions' lengths over mean of the strands' lengths.
    """

    strands: str
    count: int
    distance_mm: float
    angle_deg: float
    length_ratio: float


@torch.no_grad()
def reconstruction_errors(
    basis: StrandBasis,
    strands_by_set: Mapping[str, Float[Tensor, "_ 200 3"]],
    counts: Sequence[int] = COUNTS,
    radius: float = 0.09,
) -> list[ReconstructionError]:
    """Encode sets of strands and decode them again, with some of the components.

    Args:
        basis: what is judged.
        strands_by_set: in normal form, by the name of their set.
        counts: numbers of leading components; those that the basis does not have are left out.
        radius: of the scalp's sphere, metres, that turns scalp units into millimetres; the mean open head's if not
            given.

    Raises:
        DynhairError: a set has no strands.
    """
    errors = []
    for name, strands in strands_by_set.items():
        if not len(strands):
            raise DynhairError(f"the set `{name}` has no strands to reconstruct")
        for count in counts:
            if count > len(basis):
                continue
            sums = torch.zeros(4, dtype=torch.float64)
            for some in strands.split(_CHUNK):
                rebuilt = basis.decode(basis.encode(some)[:, :count])
                distances = torch.linalg.vector_norm(rebuilt - some, dim=-1)[:, 1:]
                angles = _angles(some.diff(dim=1), rebuilt.diff(dim=1))
                lengths = strand_lengths(some), strand_lengths(rebuilt)
                sums += torch.stack([distances.mean(1), angles.mean(1), *lengths]).sum(dim=1).cpu()
            distance, angle, length, rebuilt_length = sums.tolist()
            errors.append(
                ReconstructionError(
                    strands=name,
                    count=count,
                    distance_mm=1e3 * radius * distance / len(strands),
                    angle_deg=angle / len(strands),
                    length_ratio=rebuilt_length / length if length else 1.0,
                )
            )
    return errors


def plot_reconstruction(errors: Mapping[str, Sequence[ReconstructionError]], path: Path | str) -> None:
    """Plot errors over the number of components: a column of panels for each set, a curve for each basis.

    Args:
        errors: of several bases, by their names.
        path: the picture, in any format that Matplotlib tells by the extension.
    """
    from matplotlib.figure import Figure

    sets = list(dict.fromkeys(error.strands for rows in errors.values() for error in rows))
    figure = Figure(figsize=(1 + 3 * len(sets), 5.5), layout="constrained")
    panels = figure.subplots(2, len(sets), sharex=True, sharey="row", squeeze=False)
    for column, name in enumerate(sets):
        for index, (basis, rows) in enumerate(errors.items()):
            chosen = [error for error in rows if error.strands == name]
            counts = [error.count for error in chosen]
            look = {
                "color": _COLOURS[index % len(_COLOURS)],
                "linestyle": _LINES[index % len(_LINES)],
                "linewidth": 1.5,
                "label": basis,
            }
            panels[0, column].plot(counts, [error.distance_mm for error in chosen], **look)
            panels[1, column].plot(counts, [error.angle_deg for error in chosen], **look)
        panels[0, column].set_title(name, fontsize=9)
        panels[0, column].set_yscale("log")
        panels[1, column].set_xlabel("components")
    panels[0, 0].set_ylabel("points, mean distance in mm")
    panels[1, 0].set_ylabel("segments, mean angle in degrees")
    panels[0, 0].legend(fontsize=8, frameon=False)
    with atomic_file(path) as temporary:
        figure.savefig(temporary, dpi=130)


def _angles(one: Float[Tensor, "n s 3"], two: Float[Tensor, "n s 3"]) -> Float[Tensor, "n s"]:
    """Angles between vectors in degrees, exact for small ones."""
    sine = torch.linalg.vector_norm(torch.linalg.cross(one, two, dim=-1), dim=-1)
    return torch.atan2(sine, (one * two).sum(dim=-1)).rad2deg()
