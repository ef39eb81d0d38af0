"""How alike images look, as a whole and in their hair, to networks and to FLIP's model of the eye.

For the figures of the hair, the images of method and truth are both multiplied by the truth's hair mask, so that they
are black outside of it; they are not cropped. A view without hair is left out. The truth is looked at once, whatever is
then held against it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair import threads
from dynhair.assets.catalogue import find_asset
from dynhair.errors import DynhairError
from dynhair.evaluation.fid import FID_IMAGES, FidSums
from dynhair.evaluation.figures import FigureSums
from dynhair.evaluation.flip import flip_between, flip_views
from dynhair.evaluation.inception import ASSET, InceptionNetwork
from dynhair.evaluation.perception import PERCEPTION_STRIDE, VGG_IMAGES, Perception
from dynhair.evaluation.truth import TrueFrame

FID_FIGURES = ("fid", "hair_fid")
VGG_FIGURES = ("lpips_vgg", "hair_lpips_vgg")
APPEARANCE_FIGURES = ("flip", "hair_lpips", *VGG_FIGURES, *FID_FIGURES)
_HAIR = ("hair_lpips", "hair_lpips_vgg", "hair_fid")


@dataclass(frozen=True)
class Appearance:
    """The networks, each of which may be missing.

    Attributes:
        alexnet: LPIPS with it.
        vgg: LPIPS with VGG16.
        inception: of the Frechet inception distance; None where its weights could not be had.
        inception_description: the network, or why there is none.
    """

    alexnet: Perception
    vgg: Perception
    inception: InceptionNetwork | None
    inception_description: str

    @classmethod
    def published(cls) -> Appearance:
        """The published networks, downloaded if they are not in the cache; without them, the reasons."""
        network, description = None, f"Inception v3 for FID ({ASSET}, SHA-256 {find_asset(ASSET).sha256})"
        try:
            network = InceptionNetwork.pretrained()
        except DynhairError as error:
            description = error.message.splitlines()[0].rstrip(":")
        return cls(Perception.published(), Perception.published("vgg16"), network, description)

    @classmethod
    def quick(cls) -> Appearance:
        """AlexNet alone: the larger networks take longer to fetch than all else to measure."""
        reason = "left out of a quick evaluation"
        return cls(Perception.published(), Perception(None, f"VGG16: {reason}"), None, f"Inception v3: {reason}")

    def for_images(self, width: int, height: int) -> Appearance:
        """The same, without the networks that cannot see images of this size."""
        return Appearance(
            self.alexnet.for_images(width, height),
            self.vgg.for_images(width, height),
            self.inception,
            self.inception_description,
        )

    @property
    def description(self) -> str:
        """The networks, or why there are none."""
        return "; ".join((self.alexnet.description, self.vgg.description, self.inception_description))


@dataclass(frozen=True)
class Look:
    """What is seen of some views of a frame, for one figure.

    Attributes:
        views: that are looked at.
        seen: of these, in the form of the figure's eye.
    """

    views: Sequence[int]
    seen: Any


@dataclass(frozen=True)
class TrueAppearance:
    """The truth of one frame, as it is seen.

    Attributes:
        looks: by name of figure; those not asked for in this frame are missing.
        hair: the truth's hair mask; None where the capture has none.
    """

    looks: Mapping[str, Look]
    hair: Float[Tensor, "v h w"] | None


class AppearanceTruths:
    """The truth of one segment, taken frame by frame from its first.

    Args:
        appearance: the networks.
        frames: of the segment, that will be evaluated.
        test: whether training held the segment out; of others the larger networks see nothing.

    Attributes:
        missing: why figures cannot be measured, by name.
    """

    def __init__(self, appearance: Appearance, frames: int, *, test: bool) -> None:
        self.missing: dict[str, str] = {}
        self._frames, self._next = frames, 0
        self._figures = {name: figure for name, figure in _figures(appearance).items() if test or not figure.images}
        if not test:
            self._explain("taken of test segments alone", *VGG_FIGURES, *FID_FIGURES)
        if appearance.alexnet.distance is None:
            self._explain(appearance.alexnet.description, "hair_lpips")
        if appearance.vgg.distance is None:
            self._explain(appearance.vgg.description, *VGG_FIGURES)
        if appearance.inception is None:
            self._explain(appearance.inception_description, *FID_FIGURES)

    def frame(self, truth: TrueFrame) -> TrueAppearance:
        """Look at the next frame that is evaluated."""
        number, self._next = self._next, self._next + 1
        shown = None if truth.hair is None else truth.hair.flatten(1).any(dim=1).tolist()
        if shown is None:
            self._explain("the capture has no hair masks", *_HAIR)
        looks = {}
        for name, figure in self._figures.items():
            views = figure.views(number, len(truth.rgb), self._frames)
            if name in _HAIR:
                views = [view for view in views if shown is not None and shown[view]]
            if views:
                looks[name] = Look(views, figure.see(_framed(name, truth.rgb, truth.hair_coverage, views)))
        return TrueAppearance(looks, truth.hair_coverage)

    def compare(self, name: str, truth: Look, rgb: Float[Tensor, "v h w 3"], hair: Tensor | None) -> Any:
        """Look at a method's images as at the truth's.

        Returns:
            Of a Frechet distance, what was seen; of other figures, one value for each view looked at.
        """
        figure = self._figures[name]
        seen = figure.see(_framed(name, rgb, hair, truth.views))
        return seen if figure.compare is None else figure.compare(seen, truth.seen)

    def _explain(self, reason: str, *names: str) -> None:
        self.missing.update({name: reason for name in names if name not in self.missing})


class AppearanceMeter:
    """Adds a segment's frames to sums, from its first.

    Args:
        truths: what the images are held against.
        sums: of the segment.

    Attributes:
        fids: the features behind the Frechet distances, by figure.
    """

    def __init__(self, truths: AppearanceTruths, sums: FigureSums) -> None:
        self.fids: Mapping[str, FidSums] = {name: FidSums() for name in FID_FIGURES}
        self._truths, self._sums = truths, sums

    def add(self, truth: TrueAppearance, rgb: Float[Tensor, "v h w 3"]) -> None:
        """Look at a frame of the method.

        Args:
            truth: of the frame.
            rgb: the method's images in [0, 1].
        """
        for name, reason in self._truths.missing.items():
            self._sums.explain(reason, name)
        for name, look in truth.looks.items():
            seen = self._truths.compare(name, look, rgb, truth.hair)
            if name in FID_FIGURES:
                self.fids[name].add(seen, look.seen)
                continue
            values = torch.full((len(rgb),), torch.nan)
            values[list(look.views)] = seen.to(values)
            self._sums.add(name, values)


def spread_views(number: int, views: int, frames: int, images: int) -> list[int]:
    """Spread a number of images evenly over a segment's frames, turning through the views.

    Args:
        number: of the frame.
        views: of each frame.
        frames: of the segment.
        images: that are wanted in all; all there are, if these are fewer.

    Returns:
        The views of this frame that are taken.
    """
    total = frames * views
    images = min(images, total)

    def before(image: int) -> int:
        return image * images // total

    places = {view: number * views + (view + number) % views for view in range(views)}
    return [view for view, place in places.items() if before(place + 1) > before(place)]


@dataclass(frozen=True)
class _Figure:
    """How a figure looks at images.

    Attributes:
        see: images (v, h, w, 3) to what is compared.
        compare: two of these to a value for each view; None for a Frechet distance.
        images: of a test segment, that are looked at; None for all views of one frame in `PERCEPTION_STRIDE`.
    """

    see: Callable[[Tensor], Any]
    compare: Callable[[Any, Any], Tensor] | None
    images: int | None = None

    def views(self, number: int, views: int, frames: int) -> list[int]:
        if self.images is None:
            return [] if number % PERCEPTION_STRIDE else list(range(views))
        return spread_views(number, views, frames, self.images)


def _figures(appearance: Appearance) -> dict[str, _Figure]:
    """The figures for which there is all that they need."""
    figures = {"flip": _Figure(flip_views, flip_between)}
    if appearance.alexnet.distance is not None:
        figures["hair_lpips"] = _lpips(appearance.alexnet)
    if appearance.vgg.distance is not None:
        figures.update(dict.fromkeys(VGG_FIGURES, _lpips(appearance.vgg, VGG_IMAGES)))
    if appearance.inception is not None:
        see = partial(_features, appearance.inception)
        figures.update(dict.fromkeys(FID_FIGURES, _Figure(see, None, FID_IMAGES)))
    return figures


def _lpips(perception: Perception, images: int | None = None) -> _Figure:
    return _Figure(
        lambda rgb: perception.see(rgb, None), lambda first, second: perception.compare(first, second)[0], images
    )


def _features(network: InceptionNetwork, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v f"]:
    """The network's features, the views side by side."""
    seen: list[Tensor] = [images] * len(images)

    def look(view: int) -> None:
        with torch.no_grad():  # which another thread does not take over
            seen[view] = network(images[view][None])

    threads.run([partial(look, view) for view in range(len(images))])
    return torch.cat(seen)


def _framed(
    name: str, rgb: Float[Tensor, "v h w 3"], hair: Float[Tensor, "v h w"] | None, views: Sequence[int]
) -> Float[Tensor, "_ h w 3"]:
    """The views a figure looks at; black outside the hair if it is a figure of that."""
    chosen = rgb[list(views)]
    return chosen if name not in _HAIR or hair is None else chosen * hair[list(views), :, :, None]
