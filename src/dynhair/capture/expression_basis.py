"""Whose expression coefficients: numbers that pose one face model mean nothing to another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynhair.errors import DynhairError


@dataclass(frozen=True)
class ExpressionBasis:
    """The expressions that coefficients are of.

    Attributes:
        name: of the face model, as `dynhair.face.FaceModel` has it.
        names: of the coefficients, in order, distinct, and empty for a coefficient that has none; no names at all if
            they are not told.
    """

    name: str
    names: tuple[str, ...] = ()

    def matches(self, other: ExpressionBasis) -> bool:
        """Whether coefficients of one can stand for those of the other, as far as both tell."""
        if self.name != other.name or (self.names and other.names and len(self.names) != len(other.names)):
            return False
        pairs = zip(self.names, other.names, strict=False)
        return all(own == others for own, others in pairs if own and others)

    def require_size(self, count: int, path: Path | None = None) -> None:
        """Make sure that there are as many coefficients as names, if there are names.

        Args:
            count: number of coefficients.
            path: of the file that names them, for the error.

        Raises:
            DynhairError: there are more or fewer.
        """
        if self.names and len(self.names) != count:
            raise DynhairError(
                f"`expression_basis` has {len(self.names)} names, and `exp_coeff` has {count} coefficients",
                path=path,
                expected=f"{count} names, or none",
                mend="name the coefficients of the face model that the head was tracked with, or leave `names` out",
            )

    def to_json(self) -> dict[str, Any]:
        """Return it as ``capture.json`` holds it."""
        return {"name": self.name, **({"names": list(self.names)} if self.names else {})}
