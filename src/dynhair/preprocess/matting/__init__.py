"""Mattings of a person: functions from an image to the coverage of its pixels.

Each makes one pass over one image and keeps nothing of it, but those that run a network use the network's buffers: make
one for each thread.
"""

from dynhair.preprocess.matting.modnet import modnet_matting
from dynhair.preprocess.matting.networks import Matting, fast_matting, quality_matting
from dynhair.preprocess.matting.plate import plate_matting

__all__ = ["Matting", "fast_matting", "modnet_matting", "plate_matting", "quality_matting"]
