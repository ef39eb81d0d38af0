"""What a head without strands is trained by: images and the person's coverage, and nothing that knows of hair."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar import head_pose
from dynhair.baselines.strandless import StrandlessHead, StrandlessImages
from dynhair.capture import Capture, Segment
from dynhair.config import TrainingConfig
from dynhair.losses import PerceptualDistance, l1_loss, perceptual_crop_loss, random_crops, ssim_loss
from dynhair.training.batches import Batch


class StepResult(NamedTuple):
    """What one step computed.

    Attributes:
        loss: the weighted sum.
        terms: each term without its weight, detached.
        images: what the head looks like from the batch's cameras.
    """

    loss: Float[Tensor, ""]
    terms: dict[str, Tensor]
    images: StrandlessImages


class PhotometricObjective(nn.Module):
    """A head without strands under training and what it is compared with.

    The terms on images have the weights and the schedule of the avatar's joint training; coverage has that of the
    avatar's body. Poses are corrected frame by frame, as the avatar's are.

    Args:
        head: the model, on the device that it is to be trained on.
        capture: gives tracks.
        segments: the training segments.
        config: weights, iterations, seed.
        perceptual: what ``L_vgg`` is measured by; None leaves the term out.
    """

    def __init__(
        self,
        head: StrandlessHead,
        capture: Capture,
        segments: Sequence[Segment],
        config: TrainingConfig,
        perceptual: PerceptualDistance | None = None,
    ) -> None:
        super().__init__()
        self.head = head
        self.config = config
        self._perceptual = (perceptual,)  # not a part of what is trained and saved
        self._tracks = [capture.track(segment) for segment in segments]
        self._first_frame = [sum(segment.count for segment in segments[:number]) for number in range(len(segments))]
        # One parameter a frame, so that a step leaves the other frames' corrections and their momenta alone.
        self.pose_corrections = nn.ParameterList(
            nn.Parameter(torch.zeros(6, device=head.background.device)) for _ in range(sum(s.count for s in segments))
        )

    def parameter_groups(self) -> list[dict[str, Any]]:
        """Adam's groups: the head's, and the poses' corrections."""
        rate = self.config.rates.pose_correction
        corrections = {"params": list(self.pose_corrections), "lr": rate, "name": "pose_correction"}
        return [*self.head.parameter_groups(self.config), corrections]

    def forward(self, batch: Batch, step: int) -> StepResult:
        """Draw the batch's frame and compare it with the images."""
        config, weights = self.config, self.config.weights
        pose = head_pose(self._tracks[batch.segment], batch.index, self.head.background.device)
        posed = self.head.posed(pose.corrected(self.pose_corrections[self._first_frame[batch.segment] + batch.index]))
        images = self.head.draw(posed, batch.cameras)
        weighted = {
            "rgb": (weights.rgb, l1_loss(images.rgb, batch.rgb)),
            "ssim": (weights.ssim, ssim_loss(images.rgb, batch.rgb)),
            "coverage": (weights.body, l1_loss(images.alpha, batch.hair + batch.body)),
            **self.head.regularizers(config),
        }
        if self._perceptual[0] is not None and step % config.perceptual_every == 0:
            raised = step >= config.perceptual_raised_from * config.iterations
            weight = weights.perceptual_raised if raised else weights.perceptual
            person = (batch.hair + batch.body).cpu()
            generator = torch.Generator().manual_seed(config.seed * 1_000_003 + step)
            crops = random_crops(person, config.perceptual_crop, generator=generator)
            distance = perceptual_crop_loss(self._perceptual[0], images.rgb, batch.rgb, crops)
            weighted["perceptual"] = (config.perceptual_every * weight, distance)
        loss = torch.stack([weight * term for weight, term in weighted.values()]).sum()
        return StepResult(loss, {name: term.detach() for name, (_, term) in weighted.items()}, images)
