"""What a capture says of the hair's motion in each segment, worked out once for all that is held against it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.capture import Capture, HeadTrack, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.hair_motion import HairMotion, to_head_frame
from dynhair.evaluation.hair_samples import STRANDS, StrandSample
from dynhair.evaluation.hair_speed import HairSpeed
from dynhair.evaluation.settling import Stop, settling_time, sudden_stop
from dynhair.evaluation.strand_physics import StrandPhysics
from dynhair.evaluation.tip_motion import TipMotion
from dynhair.evaluation.truth import true_strands
from dynhair.strands import MeshDistance


class HeadObstacle:
    """The tracked mesh of head and body in the head's frame, frame by frame.

    Args:
        capture: whose mesh it is.
        segment: of the capture.
    """

    def __init__(self, capture: Capture, segment: Segment) -> None:
        self._capture, self._segment, self._track = capture, segment, capture.track(segment)
        self._mesh: MeshDistance | None = None

    def at(self, index: int) -> MeshDistance | None:
        """Move it to a frame of the segment; None where the capture has no mesh."""
        mesh = self._capture.mesh
        if mesh is None:
            return None
        world = torch.from_numpy(self._capture.vertices(self._segment.frames[index])).double()
        vertices = in_head(world, self._track, index).float()
        if self._mesh is None:
            self._mesh = MeshDistance(vertices, torch.from_numpy(mesh.faces))
        else:
            self._mesh.refit(vertices)
        return self._mesh


@dataclass(frozen=True)
class RestingHair:
    """A method's hair at rest, and how the truth's is compared with it.

    Attributes:
        strands: as a rigid hairstyle wears them, in the head's frame, metres; None for a method without strands.
        motion: compares displacements; None where the method has no strands or the capture no true ones.
        sample: number of strands that figures of physics and speed are taken of, the same for method and truth.
    """

    strands: Float[Tensor, "n l 3"] | None
    motion: HairMotion | None
    sample: int

    @classmethod
    def of(cls, strands: Float[Tensor, "n l 3"] | None, truth: Float[Tensor, "m p 3"] | None) -> RestingHair:
        """Prepare to compare hair with the truth, both at rest in the same frame; None where one has no strands."""
        motion = None if strands is None or truth is None else HairMotion(strands, truth)
        return cls(strands, motion, min([STRANDS, *(len(hair) for hair in (strands, truth) if hair is not None)]))


class TrueMotion:
    """The true strands of one segment, in the head's frame, and their figures.

    Args:
        capture: what is evaluated against.
        segment: of the capture.
        rest: what is compared.

    Attributes:
        strands: of every frame; None where the capture has none.
        physics: of the strands in all frames of a test segment.
        speed: likewise.
        tips: likewise.
        stop: at which the head suddenly rests; None where it does not.
        settling: time that the true hair takes after it, seconds; None where it does not settle, or there is none.

    Raises:
        DynhairError: there are other strands than in the segment of the hair at rest.
    """

    def __init__(self, capture: Capture, segment: Segment, rest: RestingHair) -> None:
        self.strands = true_strands(capture, segment)
        if self.strands is not None and rest.motion is not None:
            _require_same(self.strands, rest.motion, capture, segment)
        fps = capture.fps
        self.physics, self.speed, self.tips = StrandPhysics(fps), HairSpeed(fps), TipMotion(fps)
        self.stop: Stop | None = sudden_stop(capture.track(segment))
        self.settling: float | None = None
        if self.strands is None or segment.split != "test":
            return
        sample = StrandSample(self.strands.shape[1], rest.sample)
        for strands in self.strands:
            chosen = sample(strands)
            self.physics.add(chosen)
            self.speed.add(chosen.flatten(0, 1))
            self.tips.add(strands[:, -1])
        if self.stop is not None:
            self.settling = settling_time(self.tips.speeds, self.stop, fps)


def in_head(points: Float[Tensor, "*n 3"], track: HeadTrack, index: int) -> Float[Tensor, "*n 3"]:
    """World points in the head's frame of one frame of a track, on the CPU in float64."""
    rotation, translation = torch.from_numpy(track.rotations[index]), torch.from_numpy(track.translations[index])
    return to_head_frame(points.detach().cpu().double(), rotation, translation)


def _require_same(strands: Float[Tensor, "f m p 3"], motion: HairMotion, capture: Capture, segment: Segment) -> None:
    if strands.shape[1:3] != (motion.true_strands, motion.true_points):
        raise DynhairError(
            f"'{segment.name}' has {strands.shape[1]} true strands of {strands.shape[2]} points",
            path=capture.path,
            expected=f"the {motion.true_strands} of {motion.true_points} points that the first segment has",
        )
