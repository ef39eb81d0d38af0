"""Hair masks: by a face parser alone, by a classifier that it teaches, or made elsewhere."""

from dynhair.preprocess.hair.classifier import HairClassifier
from dynhair.preprocess.hair.given import LIP_HAIR, read_hair_mask
from dynhair.preprocess.hair.labels import PaintedView, TeachingView, confident_labels, facing
from dynhair.preprocess.hair.parser import FaceParse, FaceParser, network_hair
from dynhair.preprocess.hair.teaching import HairTeacher

__all__ = [
    "LIP_HAIR",
    "FaceParse",
    "FaceParser",
    "HairClassifier",
    "HairTeacher",
    "PaintedView",
    "TeachingView",
    "confident_labels",
    "facing",
    "network_hair",
    "read_hair_mask",
]
