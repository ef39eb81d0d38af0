"""Procedural hairstyles: any number of plausible grooms on any head, for a hair prior to learn from."""

from dynhair.hairstyles.families import FAMILIES, HELD_OUT, random_style
from dynhair.hairstyles.hairstyle import grow_hairstyle
from dynhair.hairstyles.head_field import HeadField
from dynhair.hairstyles.heads import random_head
from dynhair.hairstyles.style import Style

__all__ = ["FAMILIES", "HELD_OUT", "HeadField", "Style", "grow_hairstyle", "random_head", "random_style"]
