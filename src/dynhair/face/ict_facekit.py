"""ICT-FaceKit's face model, light version (MIT licence), from a folder of OBJ files.

Li et al., "Learning Formation of Physically-Based Face Attributes", CVPR 2020.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynhair.errors import DynhairError
from dynhair.face.foreign import BLENDSHAPES, foreign_model
from dynhair.face.model import FaceModel
from dynhair.face.wavefront import read_triangles, read_vertices

# Skin, sockets, mouth, teeth and eyeballs; behind them in the files lie shells for a shader: tear fluid, lashes, shade.
VERTICES = 24591
METRES = 0.01

_ONE = "jawForward jawLeft jawOpen jawRight mouthClose mouthFunnel mouthLeft mouthPucker mouthRight mouthRollLower"
_ONE += " mouthRollUpper mouthShrugLower mouthShrugUpper"
_TWO = "browDown browInnerUp browOuterUp cheekPuff cheekSquint eyeBlink eyeLookDown eyeLookIn eyeLookOut eyeLookUp"
_TWO += " eyeSquint eyeWide mouthDimple mouthFrown mouthLowerDown mouthPress mouthSmile mouthStretch mouthUpperUp"
_TWO += " noseSneer"
# ARKit's names, but that browInnerUp and cheekPuff have two sides here; and the files they are in.
FILES = {name: f"{name}.obj" for name in _ONE.split()}
FILES |= {f"{name}{side}": f"{name}_{side[0]}.obj" for name in _TWO.split() for side in ("Left", "Right")}
EXPRESSIONS = tuple(sorted(FILES))

# Multi-PIE's 68 points, which iBUG's follow: from the project's README, with its jawlines on the bone.
_JAW = (1278, 1272, 12, 1834, 243, 781, 2199, 1447, 966, 3661, 4390, 3022, 2484, 4036, 2253, 3490, 3496)
_BROWS = (268, 493, 1914, 2044, 1401, 3615, 4240, 4114, 2734, 2509)
_NOSE = (978, 4527, 4942, 4857, 1140, 2075, 1147, 4269, 3360)
_EYES = (1507, 1542, 1537, 1528, 1518, 1511, 3742, 3751, 3756, 3721, 3725, 3732)
_OUTER_LIPS = (5708, 5695, 2081, 0, 4275, 6200, 6213, 6346, 6461, 5518, 5957, 5841)
_INNER_LIPS = (5702, 5711, 5533, 6216, 6207, 6470, 5517, 5966)
LANDMARKS68 = (*_JAW, *_BROWS, *_NOSE, *_EYES, *_OUTER_LIPS, *_INNER_LIPS)


def ict_facekit(folder: Path) -> FaceModel:
    """Read the folder FaceXModel of ICT-FaceKit, in a few seconds.

    Its neutral head is the average; its identities are principal components of light-stage scans. The origin is the
    files': 13 cm behind the tip of the nose, at its height.

    Raises:
        DynhairError: a file is missing or is not the model's.
    """
    neutral = folder / "generic_neutral_mesh.obj"
    if not neutral.is_file():
        raise DynhairError(
            "there is no generic_neutral_mesh.obj",
            path=folder,
            expected="the folder FaceXModel of ICT-FaceKit",
            mend="clone https://github.com/ICT-VGL/ICT-FaceKit and name its folder FaceXModel",
        )
    identities = sorted(folder.glob("identity[0-9][0-9][0-9].obj"))
    if not identities:
        raise DynhairError("there is no identity000.obj", path=folder, expected="the whole folder FaceXModel")
    mean = read_vertices(neutral, VERTICES)
    triangles = read_triangles(neutral)

    def modes(paths: list[Path]) -> np.ndarray:
        return METRES * np.stack([read_vertices(path, VERTICES) - mean for path in paths])

    return foreign_model(
        folder,
        name="ICT-FaceKit",
        mean=METRES * mean,
        identity_modes=modes(identities),
        expression_modes=modes([folder / FILES[name] for name in EXPRESSIONS]),
        expression_names=EXPRESSIONS,
        faces=triangles[(triangles < VERTICES).all(1)],
        landmarks68=np.array(LANDMARKS68),
        **BLENDSHAPES,
    )
