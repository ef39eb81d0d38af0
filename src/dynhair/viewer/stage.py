"""What is on show and how it moves on, without any page."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float64

from dynhair.avatar import Avatar, Recording
from dynhair.viewer.live_head import LiveHead
from dynhair.viewer.motions import Clip
from dynhair.viewer.playback import Playback
from dynhair.viewer.posing import Poser, Shown
from dynhair.viewer.settings import LIVE, Settings


class Stage:
    """An avatar under the settings of a page, at any moment. All times are seconds on one monotonic clock.

    Args:
        avatar: on show.
        recording: of the avatar's person.
        clips: motions that can be played, by label.
        settings: to begin with.
        now: when it begins.
    """

    def __init__(
        self, avatar: Avatar, recording: Recording, clips: Mapping[str, Clip], settings: Settings, now: float
    ) -> None:
        self.settings = settings
        self._recording, self._clips = recording, clips
        self._history = avatar.hair.deformer.config.history
        self._poser = Poser(avatar)
        self._live = self._head_at_rest(now)
        self._playback = self._clip_begun(settings, now)

    @property
    def live(self) -> bool:
        """Whether the head is dragged."""
        return self.settings.motion == LIVE

    @property
    def playing(self) -> bool:
        """Whether a motion is played."""
        return not self.live and self._playback.playing

    @property
    def frames(self) -> int:
        """Length of the motion; 1 where the head is dragged."""
        return 1 if self.live else self._playback.frames

    def frame(self, now: float) -> int:
        """Where the motion stands."""
        return 0 if self.live else self._playback.frame(now)

    def adopt(self, settings: Settings, now: float) -> None:
        """Go over to other settings. Another motion begins at its beginning, and goes on playing if one was playing."""
        before, self.settings = self.settings, settings
        if settings.motion != before.motion:
            playing = self._playback.playing and before.motion != LIVE
            if self.live:
                self._live = self._head_at_rest(now)
            else:
                begun = self._clip_begun(settings, now)
                self._playback = begun.play(now) if playing else begun
        elif settings.speed != before.speed:
            self._playback = self._playback.at_speed(settings.speed, now)

    def play_or_pause(self, now: float) -> None:
        """Play the motion if it stands, and the other way round."""
        self._playback = self._playback.pause(now) if self._playback.playing else self._playback.play(now)

    def scrub(self, frame: int, now: float) -> None:
        """Stand at a frame of the motion."""
        self._playback = self._playback.scrub(frame, now)

    def aim(self, rotation: Float64[np.ndarray, "3 3"], translation: Float64[np.ndarray, " 3"], now: float) -> None:
        """Drag the head to a pose."""
        self._live.aim(rotation, translation, now)

    def wait(self, now: float) -> float | None:
        """Seconds until something looks different by itself; None for never."""
        return self._live.wait(now) if self.live else self._playback.wait(now)

    def shown(self, now: float) -> Shown:
        """What is on show; the same object as before where it looks the same.

        Raises:
            DynhairError: an edit does not fit the hair.
        """
        if not self.live:
            track = self._clips[self.settings.motion].track
            return self._poser.pose(track, self._playback.frame(now), self.settings, self.settings.motion)
        self._live.advance(now)
        rest = self._recording.rest.expression.double().numpy()
        track = self._live.track(rest, self._recording.gravity)
        return self._poser.pose(track, len(track.rotations) - 1, self.settings, (LIVE, self._live.steps))

    def rest_pose(self) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, " 3"]]:
        """The head's rotation and translation at rest."""
        rest = self._recording.rest
        return rest.rotation.double().numpy(), rest.translation.double().numpy()

    def _head_at_rest(self, now: float) -> LiveHead:
        return LiveHead(*self.rest_pose(), fps=self._recording.fps, history=self._history, now=now)

    def _clip_begun(self, settings: Settings, now: float) -> Playback:
        clip = self._clips.get(settings.motion)
        if clip is None:
            return Playback(1, self._recording.fps)
        return Playback(clip.frames, clip.track.fps, speed=settings.speed, since=now)
