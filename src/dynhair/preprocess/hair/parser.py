"""Face parsing: a network's labels of one picture, seen through a square around the face."""

from __future__ import annotations

import pickle
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float32, UInt8
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.preprocess.hair.bisenet import BiSeNet, fold_batch_norms
from dynhair.preprocess.landmarks.square import FaceSquare

UNKNOWN = 255
"""Label of pixels outside the crop."""
PARTS = ("other", "hair", "skin", "clothes")
"""What the classes of CelebAMask-HQ are gathered into; see :data:`PART_OF_CLASS`."""
HAIR = PARTS.index("hair")
PART_OF_CLASS = (0, 2, 2, 2, 2, 2, 2, 2, 2, 3, 2, 2, 2, 2, 2, 3, 3, 1, 3)
"""Background; skin, brows, eyes, glasses, ears; earring; nose, mouth, lips, neck; necklace, cloth; hair; hat."""
EYES, NOSE, MOUTH = (4, 5, 6), (10,), (11, 12, 13)
INPUT_SIDE = 512
CROP_SCALE = 1.35
"""Side of the crop in sides of the face square: twice the extent of the landmarks, as the training pictures had."""
_MEAN, _DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # ImageNet's


def crop_to_image(square: FaceSquare, scale: float, size: int, mirrored: bool = False) -> np.ndarray:
    """The affine map (2, 3) from pixels of a crop of ``size``^2 to pixels of the image, in OpenCV's coordinates.

    Args:
        square: where the face is.
        scale: side of the crop in sides of the square.
        size: pixels along the crop.
        mirrored: whether the crop's x axis runs against the square's.
    """
    step = square.side * scale / size
    x_axis = step * np.array([np.cos(square.angle), np.sin(square.angle)])
    y_axis = np.array([-x_axis[1], x_axis[0]])
    axes = np.stack([-x_axis if mirrored else x_axis, y_axis], axis=1)
    # OpenCV puts the centre of the first pixel at (0, 0)
    offset = np.asarray(square.centre, np.float64) - 0.5 - axes @ np.full(2, (size - 1) / 2)
    return np.column_stack([axes, offset])


def sample_crop(image: UInt8[np.ndarray, "h w 3"], to_image: np.ndarray, size: int) -> UInt8[np.ndarray, "s s 3"]:
    """Sample a crop; where it is coarser than the image, over areas instead of points. Black outside the image."""
    step = float(np.hypot(*to_image[:, 0]))
    if step > 1:
        height, width = image.shape[:2]
        small = (max(1, round(width / step)), max(1, round(height / step)))
        ratio = np.array([[small[0] / width], [small[1] / height]])
        image = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
        to_image = ratio * to_image
        to_image[:, 2] += ratio[:, 0] / 2 - 0.5
    return cv2.warpAffine(image, to_image, (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


@dataclass(frozen=True)
class FaceParse:
    """What the network sees in a crop.

    Attributes:
        probabilities: of the 19 classes of CelebAMask-HQ, on a grid over the crop.
        to_image: the affine map (2, 3) from that grid to the image, in OpenCV's coordinates.
    """

    probabilities: Float32[np.ndarray, "19 n n"]
    to_image: np.ndarray

    def parts(self, height: int, width: int) -> Float32[np.ndarray, "h w 4"]:
        """Probabilities of :data:`PARTS` in the image; all zero outside the crop."""
        # a part is as likely as its likeliest class: the network leaves a little to every class, and skin has fourteen
        part_of_class = np.asarray(PART_OF_CLASS)
        likeliest = np.stack([self.probabilities[part_of_class == i].max(axis=0) for i in range(len(PARTS))], axis=-1)
        return self._in_image(likeliest / likeliest.sum(axis=-1, keepdims=True), height, width)

    def labels(self, height: int, width: int) -> UInt8[np.ndarray, "h w"]:
        """The likeliest class of each pixel of the image; :data:`UNKNOWN` outside the crop."""
        stack = np.moveaxis(self.probabilities, 0, -1)
        groups = [self._in_image(stack[..., i : i + 4], height, width) for i in range(0, stack.shape[-1], 4)]
        everything = np.concatenate([g.reshape(height, width, -1) for g in groups], axis=-1)
        return np.where(everything.any(axis=-1), everything.argmax(axis=-1), UNKNOWN).astype(np.uint8)

    @property
    def shows_face(self) -> bool:
        """Whether eyes, nose and mouth were all found: otherwise the other labels deserve no trust either."""
        likeliest = self.probabilities.argmax(axis=0)
        return all(np.isin(likeliest, part).any() for part in (EYES, NOSE, MOUTH))

    def _in_image(self, values: np.ndarray, height: int, width: int) -> np.ndarray:
        return cv2.warpAffine(values, self.to_image, (width, height), flags=cv2.INTER_LINEAR)


class FaceParser:
    """BiSeNet as trained on CelebAMask-HQ.

    Args:
        weights: the state dict, or the file that holds it. (The training pictures are for non-commercial use.)

    Raises:
        DynhairError: the file cannot be read, or is no state dict of this network.
    """

    def __init__(self, weights: Mapping[str, Tensor] | Path) -> None:
        network = BiSeNet()
        try:
            state = _read_state(weights) if isinstance(weights, Path) else weights
            network.load_state_dict(state)
        except RuntimeError as error:
            raise DynhairError(
                f"not the weights of the face parser ({str(error).splitlines()[0]})",
                path=weights if isinstance(weights, Path) else None,
                expected="the state dict of BiSeNet with a ResNet-18 and 19 classes",
            ) from None
        # 0.21 s a picture on one thread instead of 0.26 s with contiguous channels, 0.33 s without folding
        self._network = fold_batch_norms(network)
        self._network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]

    def parse(
        self,
        image: UInt8[np.ndarray, "h w 3"],
        square: FaceSquare,
        *,
        scale: float = CROP_SCALE,
        mirrored: bool = False,
    ) -> FaceParse:
        """Parse the square crop around a face.

        Args:
            image: RGB.
            square: where the face is.
            scale: side of the crop in sides of the square.
            mirrored: show the network the mirror image; the result is mirrored back.
        """
        crop = sample_crop(image, crop_to_image(square, scale, INPUT_SIDE, mirrored), INPUT_SIDE)
        mean, deviation = (torch.tensor(v).view(1, 3, 1, 1) for v in (_MEAN, _DEVIATION))
        with torch.inference_mode():
            x = torch.from_numpy(crop).permute(2, 0, 1)[None] / 255
            x = ((x - mean) / deviation).contiguous(memory_format=torch.channels_last)
            probabilities = self._network(x)[0].softmax(dim=0).contiguous().numpy()
        grid = probabilities.shape[-1]
        return FaceParse(probabilities, crop_to_image(square, scale, grid, mirrored))


def network_hair(parser: FaceParser, image: UInt8[np.ndarray, "h w 3"], square: FaceSquare) -> UInt8[np.ndarray, "h w"]:
    """The hair's coverage as the parser alone sees it; zero outside its crop around the face."""
    probability = parser.parse(image, square).parts(*image.shape[:2])[..., HAIR]
    return np.rint(255 * probability).astype(np.uint8)


def _read_state(path: Path) -> Mapping[str, Tensor]:
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise DynhairError("the file is missing", path=path) from None
    except (OSError, EOFError, pickle.UnpicklingError, zipfile.BadZipFile) as error:
        raise DynhairError(f"not readable as a state dict ({str(error).splitlines()[0]})", path=path) from None
    if not isinstance(state, Mapping):
        raise DynhairError(f"holds a {type(state).__name__}", path=path, expected="a state dict")
    return state
