"""Edits of an avatar's hairstyle, strand by strand; they follow the strands through every motion."""

from dynhair.editing.hair_look import HairLook

__all__ = ["HairLook"]
