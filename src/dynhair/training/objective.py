"""The joint objective: hair and head drawn together, against the images (paper, "Joint Training and Losses")."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar import Avatar, AvatarImages, StrandDeformer, head_pose
from dynhair.capture import Capture, Segment
from dynhair.config import TrainingConfig
from dynhair.losses import (
    Crop,
    PerceptualDistance,
    colour_consistency_loss,
    colour_gradient_loss,
    colour_neighbours,
    colour_spatial_loss,
    elastic_loss,
    l1_loss,
    orientation_loss,
    orientation_weight,
    perceptual_crop_loss,
    random_crops,
    reach_loss,
    sample_strand_points,
    segmentation_loss,
    segmentation_weight,
    ssim_loss,
)
from dynhair.losses.agreement import agreed
from dynhair.strands import Roots
from dynhair.training.batches import Batch
from dynhair.training.contact import SurfaceContact
from dynhair.training.surface import tracked_surface

SPATIAL_PARTS = 8
"""Steps that the pairs of the spatial colour term are shared out among: all of them each step would cost 4 ms."""

POINTS_A_PIXEL = 10
"""Strand points that the reach term sees for each pixel of a view."""

ROOT_POINTS = 3
"""Points of a strand that are not drawn to missing hair: the scalp holds them."""

SETTLING_EVERY, SETTLING_MOTIONS, SETTLING_STRANDS = 8, 4, 24
"""Every so many steps that many strands are seen to settle after several motions on end, with as much more weight."""

SQUARED_HARMONIC = 4 * math.pi
"""What a squared coefficient of degree 0 is more than the squared colour it stands for."""


class StepResult(NamedTuple):
    """What one step computed (a tuple, for data-parallel wrappers look inside what a module returns).

    Attributes:
        loss: the weighted sum.
        terms: each term without its weight, detached.
        images: what the avatar looks like from the batch's cameras.
    """

    loss: Float[Tensor, ""]
    terms: dict[str, Tensor]
    images: AvatarImages


class JointObjective(nn.Module):
    """The avatar under training and what it is compared with.

    Args:
        avatar: the model, on the device that it is to be trained on.
        capture: gives tracks and the tracked surface.
        segments: the training segments.
        points: where the head's last Gaussians lie on the tracked surface, which they then are held to; None for
            nowhere.
        config: weights, iterations, seed.
        perceptual: what ``L_vgg`` is measured by; None leaves the term out.
        balance: given the weight of all pixels of a mean, the factor that makes it this process's part of the mean over
            all processes.
    """

    def __init__(
        self,
        avatar: Avatar,
        capture: Capture,
        segments: Sequence[Segment],
        points: Roots | None,
        config: TrainingConfig,
        perceptual: PerceptualDistance | None = None,
        balance: Callable[[Tensor], Tensor] = torch.ones_like,
    ) -> None:
        super().__init__()
        self.avatar = avatar
        self.config = config
        self._balance = balance
        self._perceptual = (perceptual,)  # not a part of what is trained and saved
        self._capture = capture
        self._segments = segments
        self._tracks = [capture.track(segment) for segment in segments]
        with torch.no_grad():
            self._conditions = [avatar.conditions(track) for track in self._tracks]
        self._device = avatar.background.device
        self._contact = SurfaceContact(
            tracked_surface(capture),
            segments[0].start,
            points,
            config.penetration_points,
            body=config.body_collision,
            device=self._device,
        )
        self._first_frame = [sum(segment.count for segment in segments[:number]) for number in range(len(segments))]
        # One parameter a frame, so that a step leaves the other frames' corrections and their momenta alone.
        frames = sum(segment.count for segment in segments)
        self.pose_corrections = nn.ParameterList(
            nn.Parameter(torch.zeros(6, device=self._device)) for _ in range(frames)
        )
        # Fixed, as the deformer's addresses are: the canonical hair hardly moves, and a resumed run sees the same.
        self._neighbours = (
            colour_neighbours(self._hair_gaussians(), config.colour_neighbours).to(self._device)
            if config.weights.colour_spatial > 0
            else None
        )

    def forward(self, batch: Batch, step: int) -> StepResult:
        """Draw the batch's frame and compare it with the images."""
        config, weights = self.config, self.config.weights
        segment = self._segments[batch.segment]
        tracked_pose = head_pose(self._tracks[batch.segment], batch.index, self._device)
        pose = tracked_pose.corrected(self.pose_corrections[self._first_frame[batch.segment] + batch.index])
        window = self.avatar.window(self._conditions[batch.segment], batch.index)
        posed = self.avatar.posed(pose, window)
        generator = torch.Generator().manual_seed(config.seed * 1_000_003 + step)
        contact = self._contact.begin(segment.start + batch.index, posed.strands, generator)
        images = self.avatar.draw(posed, batch.cameras)

        rgb = agreed_colours(images, batch)
        terms = {
            "rgb": l1_loss(rgb, batch.rgb),
            "ssim": ssim_loss(rgb, batch.rgb),
            "segmentation": segmentation_loss(images.hair, batch.hair),
            "body": l1_loss(images.body, batch.body),
            "orientation": self._orientation(images, batch),
        }
        if not self.avatar.hair.deformer.config.inextensible:
            terms["elastic"] = elastic_loss(posed.strands, self.avatar.canonical_strands.detach())
        terms["penetration"], tracked = contact()
        if tracked is not None:
            terms["tracking"] = (posed.head.means[-len(tracked) :] - tracked).square().sum(-1).mean()
        if images.coarse is not None:
            terms["coarse"] = l1_loss(
                images.coarse, reduced(batch.rgb, (images.coarse.shape[1], images.coarse.shape[2]))
            )
        terms |= self._colour_terms(step)
        if weights.reach > 0 and images.depth is not None:
            points = sample_strand_points(posed.strands[:, ROOT_POINTS:], config.reach_points, generator=generator)
            missing = batch.hair - images.hair
            terms["reach"] = reach_loss(
                points,
                batch.cameras,
                missing,
                images.body,
                images.depth,
                samples=max(config.reach_points // POINTS_A_PIXEL, 1),
                generators=self._generators(batch, step),
            )
        deformer = self.avatar.hair.deformer
        if weights.settling > 0 and step % SETTLING_EVERY == 0 and isinstance(deformer, StrandDeformer):
            chosen = torch.randint(len(self._conditions), (SETTLING_MOTIONS,), generator=generator)
            motion = torch.cat([self._conditions[index] for index in chosen.tolist()])
            terms["settling"] = deformer.unsettled(motion, SETTLING_STRANDS, generator)
        perceptual, every = self._perceptual[0], config.perceptual_every
        if perceptual is not None and step % every == 0:
            terms["perceptual"] = perceptual_crop_loss(perceptual, rgb, batch.rgb, self._crops(batch, step))
        raised = step >= config.perceptual_raised_from * config.iterations
        decay = segmentation_weight(step, config.iterations, config.segmentation_warmup, config.segmentation_floor)
        scale = {
            "rgb": weights.rgb,
            "coarse": weights.rgb,
            "ssim": weights.ssim,
            "perceptual": every * (weights.perceptual_raised if raised else weights.perceptual),
            "segmentation": weights.segmentation * decay,
            "body": weights.body,
            "orientation": weights.orientation,
            "penetration": weights.penetration,
            "elastic": weights.elastic,
            "tracking": weights.tracking,
            "reach": weights.reach,
            "settling": SETTLING_EVERY * weights.settling,
            "colour_gradient": weights.colour_gradient / SQUARED_HARMONIC,
            "colour_spatial": weights.colour_spatial / SQUARED_HARMONIC,
            "colour_consistency": weights.colour_consistency / SQUARED_HARMONIC,
        }
        loss = torch.stack([scale[name] * term for name, term in terms.items()]).sum()
        return StepResult(loss, {name: term.detach() for name, term in terms.items()}, images)

    def _orientation(self, images: AvatarImages, batch: Batch) -> Float[Tensor, ""]:
        """The orientation term, a mean over pixels of which each process has its own number."""
        maps = images.hair, batch.hair, batch.coherence
        share = self._balance(orientation_weight(*maps).sum())
        return share * orientation_loss(images.orientation, batch.orientation, *maps)

    def _crops(self, batch: Batch, step: int) -> list[Crop]:
        """A random square in each view: each view has its own numbers, whichever process sees it."""
        people = (batch.hair + batch.body).cpu()  # places are counted, which a GPU would have to be waited for
        crops = []
        for person, generator in zip(people, self._generators(batch, step), strict=True):
            crops += random_crops(person[None], self.config.perceptual_crop, generator=generator)
        return crops

    def _generators(self, batch: Batch, step: int) -> list[torch.Generator]:
        """Random numbers of each view: the same ones whichever process sees it."""
        seed = (self.config.seed * 1_000_003 + step) * 1_009 + batch.first
        return [torch.Generator().manual_seed(seed + place) for place in range(len(batch.cameras))]

    def _colour_terms(self, step: int) -> dict[str, Tensor]:
        """Coherence of the hair's colours, where it has a weight."""
        weights, hair = self.config.weights, self.avatar.hair
        colours = hair.base_harmonic.view(3, len(hair.strands), -1)
        terms = {}
        if weights.colour_gradient > 0:
            terms["colour_gradient"] = colour_gradient_loss(colours)
        if self._neighbours is not None:
            part = step % SPATIAL_PARTS
            terms["colour_spatial"] = colour_spatial_loss(colours, self._neighbours, part=part, parts=SPATIAL_PARTS)
        if weights.colour_consistency > 0:
            terms["colour_consistency"] = colour_consistency_loss(colours)
        return terms

    def _hair_gaussians(self) -> Float[Tensor, "n l 3"]:
        """Where the canonical hair's Gaussians lie, head frame, metres."""
        strands = self.avatar.canonical_strands.detach()
        return (strands[:, 1:] + strands[:, :-1]) / 2


def agreed_colours(images: AvatarImages, batch: Batch) -> Float[Tensor, "v h w 3"]:
    """The avatar's colours where its labels are right, and the truth's where they are not.

    Where hair lies that should show skin, or skin that should be hair, a comparison of colours would paint each in the
    other's; the labels' own terms are there to move them. Labels are shares of hair, body and background, and what they
    have in common says how far a pixel's colours count.
    """
    return agreed(images.rgb, batch.rgb, (images.hair, images.body), (batch.hair, batch.body))


def reduced(images: Float[Tensor, "v h w 3"], size: tuple[int, int]) -> Float[Tensor, "v y x 3"]:
    """Images averaged to a smaller height and width."""
    return nn.functional.interpolate(images.movedim(-1, 1), size, mode="area").movedim(1, -1)
