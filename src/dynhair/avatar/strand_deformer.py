"""Hair that moves by learned dynamics of its strands: a deformer with memory, beyond the paper's and beyond modes."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import interpolate

from dynhair.avatar.deformer import HairDeformer
from dynhair.avatar.strand_dynamics import (
    FPS,
    HIDDEN,
    POINTS,
    HeadMotions,
    RestingStrands,
    StrandDynamics,
    StrandStates,
    velocity_between,
)
from dynhair.config import DeformerConfig
from dynhair.motion import GRAVITY, signal_names
from dynhair.strands import resample_strands
from dynhair.strands.spreading import farthest_points

NEAREST = 4
"""Guides that a strand follows."""

SOFTENING = 0.005
"""Metres: of guides closer than that, none counts for much more than another."""

HANGING = 0.02
"""Radians, and parts of gravity: a motion that begins closer to rest begins with resting hair."""

GRADED = 1.5
"""Seconds of a window, its last, through which gradients go. Hair forgets: of trained dynamics, cosines between these
gradients and those through 2.2 s were 0.998 and more, and through one second 0.93 and more."""

SETTLING = 2.0
"""Seconds that hair is given to settle on a head that is held otherwise."""


class StrandDeformer(HairDeformer):
    """Displacements by :class:`StrandDynamics` of guides, which the other strands follow.

    The guides are strands that lie evenly in the hair. They move from rest through all frames of a window; a strand
    follows the guides that run closest to it. The dynamics begin, unless the configuration says otherwise, from what
    simulated hair has taught.

    A window begins with hair that has settled, on a head that was held still as it is in the first frame.

    Args:
        canonical: canonical strands in the head frame, metres.
        config: sizes, and what the hair sees.
        fps: frames a second of the motions.
    """

    guides: Tensor
    followed: Tensor
    shares: Tensor
    along: Tensor

    def __init__(self, canonical: Float[Tensor, "n l 3"], config: DeformerConfig, fps: float = FPS) -> None:
        super().__init__(canonical, config)
        self.pace = FPS / fps
        self.graded, self.settling = max(1, round(GRADED * fps)), max(4, round(SETTLING * fps))
        knots = resample_strands(canonical, POINTS)
        chosen = farthest_points(canonical.mean(1), config.guides)
        guides = knots[chosen]
        distances, followed = (torch.cdist(knots.flatten(1), guides.flatten(1)) / POINTS**0.5).topk(
            min(NEAREST, len(guides)), largest=False
        )
        shares = 1 / (distances.square() + SOFTENING**2)
        self.register_buffer("guides", guides, persistent=False)
        self.register_buffer("followed", followed, persistent=False)
        self.register_buffer("shares", shares / shares.sum(1, keepdim=True), persistent=False)
        along = interpolate(torch.eye(POINTS)[None], self.points, mode="linear", align_corners=True)[0].T
        self.register_buffer("along", along.to(canonical), persistent=False)
        roots = canonical[:, 0].mean(0)
        self.dynamics = StrandDynamics.taught() if config.taught else StrandDynamics(POINTS, HIDDEN, torch.zeros(3))
        with torch.no_grad():
            self.dynamics.neck.add_(roots.to(self.dynamics.neck))
        self.dynamics.to(canonical)

    def parameters_by_rate(self) -> dict[str, list[nn.Parameter]]:
        """As :meth:`HairDeformer.parameters_by_rate`: dynamics that are taught already learn slowly."""
        return {"dynamics": list(self.parameters())}

    def begun(self, window: Float[Tensor, "t c"]) -> Float[Tensor, "s c"]:
        """A window from its last frame before the motion, in which the head holds still.

        Frames before a motion repeat its first one.
        """
        differs = (window != window[0]).any(1)
        first = int(differs.int().argmax()) if bool(differs.any()) else len(window)
        moving = [name in ("omega", "alpha") for name in signal_names(self.config) for _ in range(3)]
        held = torch.where(torch.tensor(moving, device=window.device), 0.0, window[:1])
        return torch.cat([held, window[first:]])

    def resting(self) -> RestingStrands:
        """What the dynamics know of the guides before they move."""
        return self.dynamics.resting(self.guides[None])

    def states(
        self, window: Float[Tensor, "t c"], start: StrandStates | None = None, guides: RestingStrands | None = None
    ) -> StrandStates:
        """The guides at the end of a window.

        Args:
            window: conditions of frames, oldest first, as :meth:`begun` has them.
            start: of the guides in the first of them; if None, they hang from a head that is held so.
            guides: as :meth:`resting` says; worked out if None.
        """
        guides = self.resting() if guides is None else guides
        start = self._hanging(window[:1], guides) if start is None else start
        if len(window) == 1:
            return start
        return self._last(self.dynamics.moved(guides, self._head(window), start, pace=self.pace))

    def unsettled(self, motion: Float[Tensor, "t c"], count: int, generator: torch.Generator) -> Float[Tensor, ""]:
        """How far strands still are from rest when, after a motion, the head has been at rest for `SETTLING`.

        Gradients are of these alone: from wherever the dynamics have taken a strand, they are to bring it back.

        Args:
            motion: conditions, however long.
            count: guides that are looked at.
            generator: on the CPU, draws them.

        Returns:
            Mean distance over the last quarter of the frames at rest, metres.
        """
        chosen = torch.randperm(len(self.guides), generator=generator)[:count]
        strands = self.dynamics.resting(self.guides[chosen.to(self.guides.device)][None])
        with torch.no_grad():
            start = self._last(self.dynamics.moved(strands, self._head(motion), pace=self.pace))
        still = self._head(motion.new_zeros(self.settling, motion.shape[1]))
        moved = self.dynamics.moved(strands, still, start, pace=self.pace)
        return moved[0, -(self.settling // 4) :].norm(dim=-1).mean()

    def _last(self, moved: Float[Tensor, "m f n k 3"]) -> StrandStates:
        """Strands in the last of two or more frames."""
        return StrandStates(moved[:, -1], velocity_between(moved[:, -2], moved[:, -1], self.pace))

    def _hanging(self, held: Float[Tensor, "1 c"], guides: RestingStrands) -> StrandStates:
        """The guides when they have settled; a head close to rest has resting hair."""
        still = torch.zeros_like(self.guides)[None]
        if bool(held.abs().amax() < HANGING):
            return StrandStates(still, still)
        with torch.no_grad():
            head = self._head(held.expand(self.settling, -1))
            settled = self.dynamics.moved(guides, head, pace=self.pace)[:, -1]
        return StrandStates(settled, still)

    def following(self, guides: StrandStates) -> Float[Tensor, "n k 3"]:
        """Displacements of all strands at a guide's places along them, by those of the guides."""
        return (guides.placed[0, self.followed] * self.shares[..., None, None]).sum(1)

    def forward(self, window: Float[Tensor, "t c"]) -> Float[Tensor, "n l 3"]:
        """As :meth:`HairDeformer.forward`; gradients go back by `GRADED`."""
        window = self.begun(window)
        before, guides = max(len(window) - self.graded, 1), self.resting()
        with torch.no_grad():
            start = self.states(window[:before], guides=guides)
        states = self.states(window[before - 1 :], start, guides)
        return torch.einsum("lk,nkc->nlc", self.along, self.following(states))

    def _head(self, window: Float[Tensor, "t c"]) -> HeadMotions:
        """What the window's columns say of the head's motion; what the hair does not see is nothing."""
        parts = dict(zip(signal_names(self.config), window[None].split(3, -1), strict=True))
        none = torch.zeros_like(window[None, :, :3])
        omega, alpha, pull, turn = (parts.get(name, none) for name in ("omega", "alpha", "pull", "turn"))
        return HeadMotions(omega, alpha, turn, GRAVITY * pull)
