"""LPIPS of whole images and of faces, by a network that another project has published."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import interpolate

from dynhair import threads
from dynhair.assets.catalogue import find_asset
from dynhair.errors import DynhairError
from dynhair.evaluation.face import FaceRegion
from dynhair.losses import PerceptualDistance
from dynhair.losses.perceptual import NetworkName

PERCEPTION_STRIDE = 6
"""Of the frames that are evaluated, LPIPS is taken of one in this many: the network takes as long as all else."""

VGG_IMAGES = 8
"""Images of a test segment of which LPIPS is taken with VGG16, spread over its frames and views: that network takes 19
times as long as AlexNet."""

LEAST_FACE = 64
"""Pixels; smaller faces are enlarged to it, as the network's last stage would see hardly anything of them."""

_TITLES: Mapping[NetworkName, str] = {"alexnet": "AlexNet", "vgg16": "VGG16"}

Features = list[Float[Tensor, "_ _ _ _"]]


@dataclass(frozen=True)
class Seen:
    """What the network sees in the views of a frame.

    Attributes:
        images: features of each view's whole image.
        faces: features of each view's face; None where it shows none.
    """

    images: tuple[Features, ...]
    faces: tuple[Features | None, ...]


@dataclass(frozen=True)
class Perception:
    """A network that compares images, or the reason why there is none.

    Attributes:
        distance: None where the network's weights could not be had.
        description: the network, its version and its file's checksum; or the reason.
    """

    distance: PerceptualDistance | None
    description: str

    @classmethod
    def published(cls, network: NetworkName = "alexnet") -> Perception:
        """LPIPS 0.1 with a network, downloaded if it is not in the cache; without it, the reason."""
        try:
            distance = PerceptualDistance.pretrained(network)
        except DynhairError as error:
            return cls(None, error.message.splitlines()[0].rstrip(":"))
        asset = find_asset(f"lpips-{network}")
        return cls(distance.eval(), f"LPIPS 0.1 with {_TITLES[network]} ({asset.name}, SHA-256 {asset.sha256})")

    def for_images(self, width: int, height: int) -> Perception:
        """The same, or the reason why it cannot see images of this size."""
        if self.distance is None:
            return self
        try:
            self.distance.features(torch.zeros(1, height, width, 3))
        except DynhairError as error:
            return Perception(None, error.message)
        return self

    def see(self, images: Float[Tensor, "v h w 3"], face: FaceRegion | None) -> Seen:
        """Run the network, the views side by side.

        Args:
            images: in [0, 1].
            face: where they show it.
        """
        distance = self._required()
        squares = (None,) * len(images) if face is None else face.squares
        seen: list[tuple[Features, Features | None]] = [([], None)] * len(images)

        def look(view: int) -> None:
            square = squares[view]
            with torch.no_grad():  # which another thread does not take over
                face = None if square is None else distance.features(enlarged(square.crop(images[view]))[None])
                seen[view] = distance.features(images[view][None]), face

        threads.run([partial(look, view) for view in range(len(images))])
        return Seen(tuple(image for image, _ in seen), tuple(face for _, face in seen))

    def compare(self, first: Seen, second: Seen) -> tuple[Float[Tensor, " v"], Float[Tensor, " v"]]:
        """LPIPS of the views' whole images, and of their faces: ``nan`` for a view that shows none."""
        distance = self._required()
        faces = [
            torch.full((1,), torch.nan) if a is None or b is None else distance.between(a, b)
            for a, b in zip(first.faces, second.faces, strict=True)
        ]
        images = [distance.between(a, b) for a, b in zip(first.images, second.images, strict=True)]
        return torch.cat(images), torch.cat(faces)

    def _required(self) -> PerceptualDistance:
        if self.distance is None:
            raise ValueError(self.description)
        return self.distance


def enlarged(face: Float[Tensor, "s s 3"]) -> Float[Tensor, "_ _ 3"]:
    """Enlarge a face to `LEAST_FACE` pixels (bicubic) if it is smaller."""
    if len(face) >= LEAST_FACE:
        return face
    larger = interpolate(face.permute(2, 0, 1)[None], size=(LEAST_FACE, LEAST_FACE), mode="bicubic")
    return larger[0].permute(1, 2, 0).clamp(0.0, 1.0)
