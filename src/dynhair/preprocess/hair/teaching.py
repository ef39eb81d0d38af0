"""A face parser teaches a classifier of the capture's own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from dynhair.errors import DynhairError
from dynhair.preprocess.hair.classifier import HairClassifier
from dynhair.preprocess.hair.labels import (
    PaintedView,
    TeachingView,
    confident_labels,
    faces_camera,
    painted_labels,
)
from dynhair.preprocess.hair.network import HairNetwork
from dynhair.preprocess.hair.parser import FaceParser
from dynhair.preprocess.hair.patches import LabelledView, PatchSource

LEAST_VIEWS = 4
"""Views that show the face, below which nothing is taught without painted examples."""
BATCH = 8
VIEW_COST = 12
"""How many training steps take as long as finding the labels of a view."""


class HairTeacher:
    """Teaches classifiers from views that show the face from the front.

    A parser trained on portraits fails on profiles, on backs of heads and on long hair, but is very good on the views
    it was trained for. Its sure labels there say how this person's hair, skin and clothes look; a small network that
    sees only their colour and texture then finds them in every view.

    Args:
        parser: of faces.
        views: views that are learnt from; further samples are not looked at.
        steps: of training.
        seed: of everything random.
    """

    def __init__(self, parser: FaceParser, *, views: int = 64, steps: int = 600, seed: int = 0) -> None:
        self._parser, self._views, self._steps, self._seed = parser, views, steps, seed

    def teach(
        self,
        samples: Iterable[TeachingView],
        *,
        examples: Sequence[PaintedView] = (),
        progress: Callable[[int, int], None] = lambda done, steps: None,
    ) -> HairClassifier:
        """Train a classifier.

        Args:
            samples: spread over time and cameras, in the order in which they are to be tried; those that do not show
                the face from the front are passed over.
            examples: views painted by hand; half of the training is then on them.
            progress: called with what is done and all there is to do, in units of a training step.

        Raises:
            DynhairError: too few views show the face, or no hair was found in them.
        """
        labelling = self._views * VIEW_COST
        total = labelling + self._steps
        taught, looked_at = self._label(samples, lambda views: progress(views * VIEW_COST, total))
        if len(taught) < LEAST_VIEWS and not examples:
            raise DynhairError(
                f"{len(taught)} of {looked_at} views show the face well enough to find the hair from it",
                expected=f"{LEAST_VIEWS} or more views with the face seen from the front",
                mend="paint the hair of a few views, or give hair masks made elsewhere",
            )
        painted = [LabelledView(view.image, view.mask, painted_labels(view)) for view in examples]
        rng = np.random.default_rng(self._seed)
        sources = [PatchSource(views, rng) for views in (taught, painted) if views]
        sources = [source for source in sources if source.teaches]
        if not sources:
            raise DynhairError(
                f"the labels of {len(taught)} views and {len(painted)} painted ones do not hold both hair and others",
                expected="views with hair, skin and clothes in sight",
                mend="paint the hair of a few views, or give hair masks made elsewhere",
            )
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self._seed)
            network = _train(HairNetwork(), sources, self._steps, lambda step: progress(labelling + step, total))
            return HairClassifier(network)

    def _label(self, samples: Iterable[TeachingView], done: Callable[[int], None]) -> tuple[list[LabelledView], int]:
        taught: list[LabelledView] = []
        looked_at = 0
        for view in samples:
            looked_at += 1
            labels = confident_labels(self._parser, view) if faces_camera(view) else None
            if labels is not None:
                taught.append(LabelledView(view.image, view.mask, labels))
                done(len(taught))
            if len(taught) == self._views:
                break
        return taught, looked_at


def _train(network: HairNetwork, sources: list[PatchSource], steps: int, done: Callable[[int], None]) -> HairNetwork:
    rate = 5e-3
    optimizer = torch.optim.AdamW(network.parameters(), rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, total_steps=steps)
    network.train()
    for step in range(steps):
        batches = [source.batch(BATCH // len(sources)) for source in sources]
        colours, coverage, known = (torch.from_numpy(np.concatenate(part)) for part in zip(*batches, strict=True))
        loss = _loss(network(colours.permute(0, 3, 1, 2)), coverage, known)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        done(step + 1)
    return network.eval()


def _loss(logits: Tensor, coverage: Tensor, known: Tensor) -> Tensor:
    entropy = functional.binary_cross_entropy_with_logits(logits, coverage, reduction="none")
    return (known * entropy).sum() / known.sum().clamp_min(1)
