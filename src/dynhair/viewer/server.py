"""The viewer itself: one loop that poses and draws, and pages that look."""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import torch
from scipy.spatial.transform import Rotation

from dynhair.avatar import Avatar, PosedAvatar, Recording
from dynhair.errors import DynhairError
from dynhair.threads import large_pieces
from dynhair.viewer.browser_scene import BrowserScene
from dynhair.viewer.controls import Button, Controls
from dynhair.viewer.expression_sliders import expression_sliders
from dynhair.viewer.motions import Clip
from dynhair.viewer.page import Page
from dynhair.viewer.saving import snapshot, splat_file
from dynhair.viewer.speed_colours import coloured_by_speed
from dynhair.viewer.stage import Stage
from dynhair.viewer.viewpoint import field_of_view

if TYPE_CHECKING:
    from viser import ClientHandle, TransformControlsHandle, ViserServer  # pyright: ignore[reportMissingImports]

STATUS_EVERY = 0.5  # seconds
FRAME_EVERY = 0.1  # seconds; between two places of the slider that shows the frame
MEASURED = 2.0  # seconds, over which the frame rate is taken
GIZMO_SIZE = 0.16  # metres; its arrows reach out of the hair


class Viewer:
    """An avatar on pages.

    What the pages do only leaves a note and wakes the loop; the loop alone touches the avatar and draws. It draws what
    is newest when it comes to it, and sleeps until something is due.

    Args:
        server: that serves the pages.
        avatar: on show.
        recording: of the avatar's person.
        clips: motions by label; the first is on show at first.
    """

    def __init__(self, server: ViserServer, avatar: Avatar, recording: Recording, clips: Mapping[str, Clip]) -> None:
        self._server, self._avatar = server, avatar
        self._wake, self._stopped = threading.Event(), False
        self._notes: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._pages: dict[int, Page] = {}
        self._coloured: tuple[object, PosedAvatar | None] = (None, None)
        self._sent: deque[float] = deque()
        self._size = ""
        self._status_at = self._frame_at = 0.0
        self._scene = BrowserScene(server.scene, avatar, recording.camera)
        self._scene_has: tuple[PosedAvatar | None, str] = (None, "")
        recorded = [clip.track for clip in clips.values() if clip.recorded]
        self._controls = Controls(
            server.gui,
            tuple(clips),
            expression_sliders(avatar, recorded),
            changed=self._wake.set,
            pressed=lambda button, client: self._note(lambda: self._press(button, client)),
            scrubbed=lambda frame: self._note(lambda: self._stage.scrub(frame, time.monotonic())),
        )
        self._stage = Stage(avatar, recording, clips, self._controls.settings(), time.monotonic())
        self._gizmo = self._added_gizmo()
        self._controls.arrange(self._stage.settings, self._stage.frames)
        self._look_from(recording)

        @server.on_client_connect
        async def _(client: ClientHandle) -> None:
            client.camera.on_update(self._woken)
            self._wake.set()

    def run(self) -> None:
        """Draw until :meth:`stop`."""
        with torch.inference_mode(), large_pieces():
            while not self._stopped:
                self._wake.wait(self._wait(time.monotonic()))
                self._wake.clear()
                while not self._notes.empty():
                    self._notes.get()()
                try:
                    self._show()
                except DynhairError as error:
                    self._controls.show_status(f"**{error.message}**")

    def stop(self) -> None:
        """End :meth:`run`, from any thread."""
        self._stopped = True
        self._wake.set()

    def _note(self, action: Callable[[], None]) -> None:
        """Have the loop do something."""
        self._notes.put(action)
        self._wake.set()

    async def _woken(self, _: object) -> None:
        self._wake.set()

    def _wait(self, now: float) -> float | None:
        """Seconds until something is due by itself; None where the loop may sleep until it is woken."""
        if not self._pages:
            return None
        due = [self._stage.wait(now), *(page.wait(now) for page in self._pages.values())]
        return min((seconds for seconds in due if seconds is not None), default=None)

    def _show(self) -> None:
        """Bring everything up to date for whoever looks."""
        clients = self._server.get_clients()
        self._pages = {id: self._pages.get(id) or Page(client, self._server) for id, client in clients.items()}
        if not self._pages:
            return
        begin = time.monotonic()
        self._adopt(begin)
        stage, settings = self._stage, self._stage.settings
        posed = self._posed(begin)
        posing = time.monotonic() - begin
        if posed is not self._scene_has[0] or settings.display != self._scene_has[1]:
            sent = self._scene.show(posed, settings.display)
            self._scene_has = posed, settings.display
            if sent:
                self._sent.append(time.monotonic())
                self._size = f"{sent / 1e6:.1f} MB a frame"
        for page in self._pages.values():
            if settings.display != "image":
                page.clear(self._avatar)
            elif page.show(self._avatar, posed, posing):
                self._sent.append(time.monotonic())
                self._size = f"{page.size[0]} x {page.size[1]} pixels"
        self._report()
        now = time.monotonic()
        if not stage.playing or now - self._frame_at > FRAME_EVERY:
            self._controls.show_frame(stage.frame(begin), stage.playing)
            self._frame_at = now

    def _adopt(self, now: float) -> None:
        settings, stage = self._controls.settings(), self._stage
        if settings == stage.settings:
            return
        other = settings.motion != stage.settings.motion
        stage.adopt(settings, now)
        self._controls.arrange(settings, stage.frames)
        if other:
            self._gizmo_to_rest()

    def _posed(self, now: float) -> PosedAvatar:
        """What is on show, in its colours; the same object as before where it looks the same."""
        shown = self._stage.shown(now)
        if shown is not self._coloured[0] or self._coloured[1] is None:
            posed = shown.avatar if shown.speeds is None else coloured_by_speed(shown.avatar, shown.speeds)
            self._coloured = shown, posed
            return posed
        return self._coloured[1]

    def _report(self) -> None:
        """Say how large what is seen is, and how often it changes."""
        now = time.monotonic()
        resting = self._wait(now) is None
        if now - self._status_at < STATUS_EVERY and not resting:
            return
        self._status_at = now
        while self._sent and now - self._sent[0] > MEASURED:
            self._sent.popleft()
        rate = ""
        if len(self._sent) > 2 and not resting:
            each = (len(self._sent) - 1) / len(self._pages)
            rate = f"{each / (self._sent[-1] - self._sent[0]):.0f} frames/s, "
        self._controls.show_status(rate + self._size)

    def _press(self, button: Button, client: ClientHandle) -> None:
        now = time.monotonic()
        if button == "play":
            self._stage.play_or_pause(now)
        elif button == "rest":
            self._gizmo_to_rest()
            self._stage.aim(*self._stage.rest_pose(), now)
        elif button == "snapshot":
            page = self._pages.get(client.client_id)
            if page is not None:
                image = snapshot(self._avatar, self._posed(now), page.viewpoint)
                client.send_file_download("avatar.png", image, save_immediately=True)
        elif button == "splats":
            splats = splat_file(self._avatar, self._posed(now))
            client.send_file_download("avatar.ply", splats, save_immediately=True)

    def _look_from(self, recording: Recording) -> None:
        """Begin in front of the face."""
        camera, start = recording.camera, self._server.initial_camera
        start.position, start.look_at = camera.centre.numpy(), recording.rest.translation.numpy()
        start.fov = field_of_view(camera)
        self._server.scene.set_up_direction("+y")

    def _added_gizmo(self) -> TransformControlsHandle:
        gizmo = self._server.scene.add_transform_controls(
            "/head", GIZMO_SIZE, disable_sliders=True, depth_test=False, line_width=3.0, opacity=0.8, visible=False
        )

        @gizmo.on_update
        async def _(_: object) -> None:
            rotation = Rotation.from_quat(gizmo.wxyz, scalar_first=True).as_matrix()
            self._note(lambda: self._stage.aim(rotation, gizmo.position, time.monotonic()))

        return gizmo

    def _gizmo_to_rest(self) -> None:
        rotation, translation = self._stage.rest_pose()
        self._gizmo.wxyz = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
        self._gizmo.position = translation
        self._gizmo.visible = self._stage.live
