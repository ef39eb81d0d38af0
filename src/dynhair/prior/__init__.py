"""The learned prior of hairstyles."""

from dynhair.prior.basis import POINTS, BasisFit, StrandBasis, fit_basis, normal_form

__all__ = ["POINTS", "BasisFit", "StrandBasis", "fit_basis", "normal_form"]
