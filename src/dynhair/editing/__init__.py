"""Edits of an avatar's hairstyle, strand by strand; they follow the strands through every motion."""

from dynhair.editing.canonical_hair import CanonicalHair
from dynhair.editing.edited_hair import EditedHair
from dynhair.editing.edits import Brightness, Edit, Thin, Tint, Trim, Width, edits_from_json
from dynhair.editing.hair_look import HairLook

__all__ = [
    "Brightness",
    "CanonicalHair",
    "Edit",
    "EditedHair",
    "HairLook",
    "Thin",
    "Tint",
    "Trim",
    "Width",
    "edits_from_json",
]
