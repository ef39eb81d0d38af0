"""Whether a motion speaks of expressions as a head does."""

from __future__ import annotations

from dynhair.capture import ExpressionBasis, HeadTrack
from dynhair.errors import DynhairError


def require_expressions(track: HeadTrack, size: int, basis: ExpressionBasis | None) -> None:
    """Refuse to be driven by the coefficients of another face model.

    Args:
        track: that drives.
        size: number of coefficients that the head was trained with.
        basis: whose they are; None if that is not known.

    Raises:
        DynhairError: the track has others.
    """
    mend = "track the driving motion with the same face model"
    other, found = track.expression_basis, track.expressions.shape[1]
    if basis is not None and other is not None and not basis.matches(other):
        raise DynhairError(
            f"the driving motion's expressions are of the face model '{other.name}'",
            expected=f"those of '{basis.name}', as in the capture that the head was trained on",
            mend=mend,
        )
    if found != size:
        raise DynhairError(
            f"the driving motion has {found} expression coefficients",
            expected=f"{size}, as in the capture that the head was trained on",
            mend=mend,
        )
