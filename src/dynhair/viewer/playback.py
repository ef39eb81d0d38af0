"""The clock of a motion that plays in a loop."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Playback:
    """Where a motion stands. All times are seconds on one monotonic clock, which the caller reads.

    Attributes:
        frames: length of the motion.
        fps: frames of the motion per second.
        playing: whether time passes.
        speed: of playback; 1 is the recorded speed.
        since: when the motion stood at ``position``.
        position: frames from the beginning, not wrapped and not rounded.
    """

    frames: int
    fps: float
    playing: bool = False
    speed: float = 1.0
    since: float = 0.0
    position: float = 0.0

    def frame(self, now: float) -> int:
        """Index of the frame that is to be seen."""
        return math.floor(self._position(now)) % self.frames

    def play(self, now: float) -> Playback:
        """Go on from where it stands."""
        return replace(self._stopped(now), playing=True)

    def pause(self, now: float) -> Playback:
        """Stay where it stands."""
        return replace(self._stopped(now), playing=False)

    def scrub(self, frame: int, now: float) -> Playback:
        """Stay at a frame."""
        return replace(self, playing=False, since=now, position=float(min(max(frame, 0), self.frames - 1)))

    def at_speed(self, speed: float, now: float) -> Playback:
        """Go on at another speed."""
        return replace(self._stopped(now), speed=speed)

    def wait(self, now: float) -> float | None:
        """Seconds until the next frame is due; None while nothing moves."""
        if not self.playing or self.speed <= 0:
            return None
        position = self._position(now)
        return (math.floor(position) + 1 - position) / (self.fps * self.speed)

    def _position(self, now: float) -> float:
        passed = (now - self.since) * self.fps * self.speed if self.playing else 0.0
        # a frame is due at its very instant, though products of floats fall short of whole numbers
        return self.position + passed + 1e-6

    def _stopped(self, now: float) -> Playback:
        return replace(self, since=now, position=(self._position(now) - 1e-6) % self.frames)
