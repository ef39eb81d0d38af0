"""Measures how a method's hair moves in one segment: against the truth where there is one, and by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.camera import Camera
from dynhair.evaluation.definitions import (
    MOTION,
    PENETRATION_FIGURES,
    PHYSICS_FIGURES,
    PHYSICS_TRUTH,
    SPEED_FIGURES,
    SPEED_TRUTH,
    STRAND_FIGURES,
    TRUTH_FIGURES,
)
from dynhair.evaluation.figures import FigureSums
from dynhair.evaluation.hair_motion import tip_error_mm
from dynhair.evaluation.hair_samples import POINTS, PointSample, StrandSample, hair_gaussians
from dynhair.evaluation.hair_speed import HairSpeed
from dynhair.evaluation.series import Series
from dynhair.evaluation.settling import Stop, settling_time
from dynhair.evaluation.strand_contact import Penetration, Stretch
from dynhair.evaluation.strand_physics import StrandPhysics
from dynhair.evaluation.swing import phase_lag_ms
from dynhair.evaluation.tip_motion import TipMotion
from dynhair.evaluation.true_motion import RestingHair, TrueMotion
from dynhair.strands import Obstacle

NO_STRANDS = "the method has no strands"
NO_TRUE_STRANDS = "the capture holds no true strands"
NOT_CONSECUTIVE = "only every few frames of a training segment are evaluated"


@dataclass(frozen=True)
class PosedHair:
    """A method's hair in one frame, in the head's frame, metres.

    Attributes:
        strands: None for a method without.
        points: the positions of all Gaussians of a method without strands; None for one with.
    """

    strands: Float[Tensor, "n l 3"] | None
    points: Float[Tensor, "g 3"] | None = None


class MotionMeter:
    """Adds a segment's frames, from its first, and hands over sums when it is done.

    Args:
        fps: frames per second.
        rest: the method's hair at rest.
        truth: the segment's true motion; None where nothing is held against the hair.
        stop: at which the head suddenly rests; None where it does not.
        sums: of the segment.
        series: of the segment.
        consecutive: whether all frames of the segment will be added.
    """

    def __init__(
        self,
        fps: float,
        rest: RestingHair,
        truth: TrueMotion | None,
        stop: Stop | None,
        sums: FigureSums,
        series: Series,
        *,
        consecutive: bool,
    ) -> None:
        self._fps, self._rest, self._consecutive = fps, rest, consecutive
        self._truth, self._stop, self._sums, self._series = truth, stop, sums, series
        self._physics, self._speed, self._tips = StrandPhysics(fps), HairSpeed(fps), TipMotion(fps)
        self._penetration = Penetration()
        self._stretch = None if rest.strands is None else Stretch(rest.strands)
        self._strand_sample = None if rest.strands is None else StrandSample(len(rest.strands), rest.sample)
        self._point_sample: PointSample | None = None
        self._frames, self._met = 0, 0

    def choose_points(
        self, means: Float[Tensor, "g 3"], hair: Bool[Tensor, "v h w"] | None, cameras: Sequence[Camera]
    ) -> None:
        """Choose which Gaussians of a method without strands are hair, in the segment's first frame.

        Args:
            means: of all, world, metres.
            hair: the truth's silhouettes; None where the capture has none.
            cameras: of the frame.
        """
        chosen = None if hair is None else hair_gaussians(means, hair, cameras)
        if chosen is not None and len(chosen):
            self._point_sample = PointSample(chosen, self._rest.sample * POINTS)
            return
        why = "the capture has no hair masks" if hair is None else "no Gaussian lies in the hair of the first frame"
        self._sums.explain(why, *SPEED_FIGURES)

    def add(self, index: int, hair: PosedHair, obstacle: Obstacle | None) -> None:
        """Measure a frame.

        Args:
            index: its place in the segment.
            hair: of the method.
            obstacle: head and body in the head's frame; None where they are not known.
        """
        self._frames += 1
        if hair.strands is None:
            if self._consecutive and hair.points is not None and self._point_sample is not None:
                self._speed.add(self._point_sample(hair.points))
            return
        assert self._strand_sample is not None
        assert self._stretch is not None
        chosen = self._strand_sample(hair.strands)
        self._stretch.add(hair.strands)
        if obstacle is not None:
            self._penetration.add(chosen.float(), obstacle)
            self._met += 1
        tips = self._add_error(index, hair.strands)
        if self._consecutive:
            self._physics.add(chosen)
            self._speed.add(chosen.flatten(0, 1))
            self._tips.add(tips)

    def finish(self) -> None:
        """Hand over what was measured, and say what was not."""
        sums, truth, pairs = self._sums, self._truth, max(self._frames - 1, 0)
        self._explain()
        if self._consecutive:
            sums.pool(PHYSICS_FIGURES, self._physics, StrandPhysics.figures, pairs)
            sums.pool(SPEED_FIGURES, self._speed, HairSpeed.figures, pairs)
            if truth is not None and truth.strands is not None:
                sums.pool(PHYSICS_TRUTH, truth.physics, StrandPhysics.figures, pairs)
                sums.pool(SPEED_TRUTH, truth.speed, HairSpeed.figures, pairs)
                self._series.set("tip_speed_truth", truth.tips.speeds)
            if self._rest.strands is not None:
                self._series.set("tip_speed", self._tips.speeds)
            self._add_swing()
        sums.pool(PENETRATION_FIGURES, self._penetration, Penetration.figures, self._met)
        if self._stretch is not None:
            sums.pool(("stretch",), self._stretch, lambda stretch: (stretch.rms(),), self._frames)

    def _add_error(self, index: int, strands: Float[Tensor, "n l 3"]) -> Float[Tensor, "m 3"]:
        """Compare displacements with the truth's.

        Returns:
            The tips whose motion is followed: where the truth's would be taken, or else the strands' own.
        """
        motion, truth = self._rest.motion, self._truth
        if motion is None or truth is None or truth.strands is None:
            return strands[:, -1]
        true = truth.strands[index]
        self._sums.add_motion(*motion.errors(strands, true))
        tips = motion.tips(strands)
        error = tip_error_mm(tips, true[:, -1])
        self._sums.add_value("tip_error_mm", error)
        self._series.record("tip_error_mm", index, error)
        return tips

    def _add_swing(self) -> None:
        """What is known when the whole segment has been seen."""
        sums, truth, stop = self._sums, self._truth, self._stop
        if stop is not None and self._rest.strands is not None:
            sums.add_optional("settling_s", settling_time(self._tips.speeds, stop, self._fps))
        if truth is None or truth.strands is None:
            return
        sums.add_optional("settling_s_truth", truth.settling)
        if self._rest.motion is not None:
            sums.add_optional("phase_lag_ms", phase_lag_ms(self._tips.path, truth.tips.path, self._fps))

    def _explain(self) -> None:
        """Say why figures may have no value, the reason that counts most last."""
        sums = self._sums
        sums.explain("no strand point is inside head or body", "penetration_depth_mm")
        sums.explain("the truth's hair does not swing, or the method's does so otherwise", "phase_lag_ms")
        settles = "the hair does not move, or does not settle, after the stop"
        no_stop = "the head does not stop suddenly and rest"
        sums.explain(settles if self._stop is not None else no_stop, "settling_s", "settling_s_truth")
        if not self._consecutive:
            sums.explain(
                NOT_CONSECUTIVE, *SPEED_FIGURES, *PHYSICS_FIGURES, *TRUTH_FIGURES, "phase_lag_ms", "settling_s"
            )
        if not self._met:
            sums.explain("the capture has no mesh of head and body", *PENETRATION_FIGURES)
        if self._truth is None or self._truth.strands is None:
            sums.explain(NO_TRUE_STRANDS, MOTION, "tip_error_mm", "phase_lag_ms", *TRUTH_FIGURES)
        if self._rest.strands is None:
            sums.explain(NO_STRANDS, *STRAND_FIGURES)
