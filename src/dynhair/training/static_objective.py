"""The static stage's objective: hair at rest against its views (paper, ``L_static``; supplement B)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from dynhair.config import StaticConfig
from dynhair.losses import (
    PerceptualDistance,
    direction_loss,
    grows_in_front,
    l1_loss,
    length_loss,
    lpips_loss,
    pca_consistency_loss,
    penetration_loss,
    sample_strand_points,
    segmentation_loss,
    segmentation_weight,
    shape_loss,
    smoothness_loss,
    ssim_loss,
)
from dynhair.prior.basis import StrandBasis
from dynhair.strands import resample_strands, root_neighbours
from dynhair.training.rest_scene import RestScene
from dynhair.training.static_model import Paint
from dynhair.training.static_scene import PaintedImages, render_painted_hair
from dynhair.training.static_views import RestViews

_NEIGHBOURS = 4
_CHECKED_POINTS = 2000
_COARSE, _MIDDLE = 0.25, 0.55
_SMALLEST = 64
_WINDOW = 128
_HAIR = 0.5


class StaticStep(NamedTuple):
    """What one step computed.

    Attributes:
        loss: the weighted sum.
        terms: each term without its weight, detached.
        images: what the hair looks like in the step's views.
    """

    loss: Float[Tensor, ""]
    terms: dict[str, Tensor]
    images: PaintedImages


class StaticObjective:
    """Strands compared with the rest views.

    Args:
        scene: the rest frame.
        roots: of the strands, head frame, metres.
        width: of a strand, metres.
        basis: in whose coefficients the hair in front is compared with that behind.
        background: colour behind everything.
        perceptual: what ``L_vgg`` is measured by; None leaves the term out.
        config: weights, views a step.
        seed: of views and points drawn.
    """

    def __init__(
        self,
        scene: RestScene,
        roots: Float[Tensor, "n 3"],
        width: float,
        basis: StrandBasis,
        background: Float[Tensor, "3"],
        perceptual: PerceptualDistance | None,
        config: StaticConfig,
        seed: int,
    ) -> None:
        self.scene, self.width, self.config, self.seed = scene, width, config, seed
        self._basis, self._background, self._perceptual = basis, background, perceptual
        self._neighbours: Int[Tensor, "n k"] = root_neighbours(roots, min(_NEIGHBOURS, len(roots) - 1))
        self._front: Bool[Tensor, " n"] = grows_in_front(roots, scene.frame.centre)
        longer = max(scene.views.hair.shape[1:])
        self._sizes = [scene.views.resized(max(longer // part, _SMALLEST)) for part in (4, 2)] + [scene.views]

    def __call__(self, strands: Float[Tensor, "n l 3"], paint: Paint, step: int, iterations: int) -> StaticStep:
        """Draw strands in some of the views and compare.

        Images begin small: a silhouette pulls on strands that are within a pixel or two of it.

        Args:
            strands: head frame, metres.
            paint: colours.
            step: steps done; it decides the views and their size.
            iterations: steps in all.
        """
        weights = self.config.weights
        views = self._views(step, iterations)
        colours = paint.segments(strands.shape[1] - 1)
        images = render_painted_hair(strands, self.width, self.scene.body, views.cameras, colours, paint.body)
        rgb = images.rgb + (1 - images.alpha)[..., None] * self._background
        generator = torch.Generator().manual_seed(self.seed * 1_000_003 + step)
        points = sample_strand_points(strands, _CHECKED_POINTS, generator=generator)
        terms = {
            "rgb": l1_loss(rgb, views.rgb),
            "ssim": ssim_loss(rgb, views.rgb),
            "segmentation": segmentation_loss(images.coverage, views.hair, excess=weights.segmentation_excess),
            "orientation": direction_loss(images.direction, images.coverage, views.direction),
            "penetration": penetration_loss(points, self.scene.obstacle),
            "shape": shape_loss(strands, self._neighbours),
            "smoothness": smoothness_loss(strands, self._neighbours),
            "length": length_loss(strands, self._neighbours),
            "pca": self._consistency(strands),
        }
        if self._perceptual is not None:
            shown, seen = self._windows(rgb, views, generator)
            terms["perceptual"] = lpips_loss(self._perceptual, shown, seen)
        decay = segmentation_weight(step, iterations)
        scale = {name: getattr(weights, name) for name in terms} | {"segmentation": weights.segmentation * decay}
        loss = torch.stack([scale[name] * term for name, term in terms.items()]).sum()
        return StaticStep(loss, {name: term.detach() for name, term in terms.items()}, images)

    def _consistency(self, strands: Tensor) -> Tensor:
        shapes = resample_strands((strands - strands[:, :1]) / self.scene.frame.radius, 200)
        coefficients = self._basis.encode(shapes)
        # The hair behind, which fewer views see, is to follow the hair in front.
        return pca_consistency_loss(coefficients[self._front].detach(), coefficients[~self._front])

    def _windows(
        self, rgb: Float[Tensor, "v h w 3"], views: RestViews, generator: torch.Generator
    ) -> tuple[Float[Tensor, "v y x 3"], Float[Tensor, "v y x 3"]]:
        """A window about a random pixel of hair in each view: LPIPS of whole images would take most of the time."""
        height, width = views.hair.shape[1:]
        drawn, seen = [], []
        for image, truth, hair in zip(rgb, views.rgb, views.hair, strict=True):
            places = torch.nonzero(hair > _HAIR)
            place = int(torch.randint(max(len(places), 1), (1,), generator=generator))
            row, column = places[place].tolist() if len(places) else (height // 2, width // 2)
            top = min(max(row - _WINDOW // 2, 0), max(height - _WINDOW, 0))
            left = min(max(column - _WINDOW // 2, 0), max(width - _WINDOW, 0))
            drawn.append(image[top : top + _WINDOW, left : left + _WINDOW])
            seen.append(truth[top : top + _WINDOW, left : left + _WINDOW])
        return torch.stack(drawn), torch.stack(seen)

    def _views(self, step: int, iterations: int) -> RestViews:
        """The views of a step: all of them in turn, in an order that is shuffled for each turn."""
        done = step / iterations
        views = self._sizes[(done >= _COARSE) + (done >= _MIDDLE)]
        count = min(self.config.views, len(views))
        first = step * count
        chosen = [self._order(place // len(views))[place % len(views)] for place in range(first, first + count)]
        return views[chosen]

    def _order(self, turn: int) -> list[int]:
        generator = torch.Generator().manual_seed(self.seed * 1_000_003 + turn)
        return torch.randperm(len(self.scene.views), generator=generator).tolist()
