"""Morphable face models: the open head that comes with the package, and its registration to landmarks."""

from dynhair.face.open_head import OpenHead
from dynhair.face.registration import Registration, register

__all__ = ["OpenHead", "Registration", "register"]
