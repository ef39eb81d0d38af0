"""The panel of the page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal

from dynhair.viewer.expression_sliders import ExpressionSlider
from dynhair.viewer.settings import COLOURS, DISPLAYS, LIVE, HairEdits, Settings
from dynhair.viewer.speed_colours import colour_bar

if TYPE_CHECKING:
    from viser import ClientHandle, GuiApi, GuiEvent, GuiInputHandle  # pyright: ignore[reportMissingImports]

Button = Literal["play", "rest", "snapshot", "splats"]

_DISPLAY_LABELS = dict(
    zip(("picture", "splats in the browser", "strands as lines in the browser"), DISPLAYS, strict=True)
)
_COLOUR_LABELS = dict(zip(("as recorded", "by speed"), COLOURS, strict=True))


class Controls:
    """Sliders, lists and buttons, the same for all pages.

    Args:
        gui: of the server.
        motions: labels, first the one that is chosen at first.
        expressions: coefficients that get a slider.
        changed: called when a value has changed.
        pressed: called with a button and the page where it was pressed.
        scrubbed: called with a frame when the user goes there.
    """

    def __init__(
        self,
        gui: GuiApi,
        motions: Sequence[str],
        expressions: Sequence[ExpressionSlider],
        *,
        changed: Callable[[], None],
        pressed: Callable[[Button, ClientHandle], None],
        scrubbed: Callable[[int], None],
    ) -> None:
        self._changed, self._pressed = changed, pressed
        self._status = gui.add_markdown("")
        with gui.add_folder("Motion"):
            self._motion = self._watched(gui.add_dropdown("motion", (*motions, LIVE), initial_value=motions[0]))
            self._play = self._button(gui, "Play", "play", "player-play")
            self._frame = gui.add_slider("frame", 0, 1, 1, 0)
            self._speed = self._watched(gui.add_slider("speed", 0.1, 2.0, 0.1, 1.0))
            self._rigid = self._watched(gui.add_checkbox("hold the hair rigid", False))
            self._rest = self._button(gui, "Head to rest", "rest", "home")
        with gui.add_folder("Display"):
            self._display = self._watched(gui.add_dropdown("draw", tuple(_DISPLAY_LABELS)))
            self._colours = self._watched(gui.add_dropdown("hair colour", tuple(_COLOUR_LABELS)))
            self._bar = gui.add_image(colour_bar(), format="png", visible=False)
        with gui.add_folder("Hair"):
            self._brightness = self._watched(gui.add_slider("brightness", 0.3, 2.5, 0.05, 1.0))
            self._trim = self._watched(gui.add_slider("cut off", 0.0, 0.9, 0.05, 0.0, hint="part of the length"))
            self._thin = self._watched(gui.add_slider("thin out", 0.0, 0.9, 0.05, 0.0, hint="part of the strands"))
            self._width = self._watched(gui.add_slider("width", 0.3, 3.0, 0.1, 1.0, hint="factor"))
            self._strength = self._watched(gui.add_slider("tint", 0.0, 1.0, 0.05, 0.0))
            self._tint = self._watched(gui.add_rgb("tint with", HairEdits.tint))
            self._resetting(gui, self._brightness, self._trim, self._thin, self._width, self._strength, self._tint)
        with gui.add_folder("Expression", expand_by_default=False, visible=bool(expressions)):
            self._expressions = {
                slider.index: self._watched(
                    gui.add_slider(slider.label, -slider.reach, slider.reach, slider.reach / 50, 0.0)
                )
                for slider in expressions
            }
            self._resetting(gui, *self._expressions.values())
        with gui.add_folder("Gravity", expand_by_default=False):
            self._forwards = self._watched(gui.add_slider("to the front", -90, 90, 5, 0, hint="degrees"))
            self._sideways = self._watched(gui.add_slider("to the side", -90, 90, 5, 0, hint="degrees"))
            self._resetting(gui, self._forwards, self._sideways)
        with gui.add_folder("Save"):
            self._button(gui, "Snapshot (PNG)", "snapshot", "camera")
            self._button(gui, "Splats (PLY)", "splats", "download")

        @self._frame.on_update
        async def _(event: GuiEvent[Any]) -> None:
            if event.client is not None:  # and not the clock
                scrubbed(int(self._frame.value))

    def settings(self) -> Settings:
        """What the controls say now."""
        edits = HairEdits(
            brightness=self._brightness.value,
            tint=self._tint.value,
            tint_strength=self._strength.value,
            trim=self._trim.value,
            thin=self._thin.value,
            width=self._width.value,
        )
        return Settings(
            motion=self._motion.value,
            speed=self._speed.value,
            rigid=self._rigid.value,
            display=_DISPLAY_LABELS[self._display.value],
            colours=_COLOUR_LABELS[self._colours.value],
            expression=tuple((index, slider.value) for index, slider in self._expressions.items() if slider.value),
            gravity=(float(self._forwards.value), float(self._sideways.value)),
            edits=edits,
        )

    def arrange(self, settings: Settings, frames: int) -> None:
        """Show what belongs to the settings, and as many frames as the motion has."""
        live = settings.motion == LIVE
        for handle in (self._play, self._frame, self._speed):
            handle.visible = not live
        self._rest.visible = live
        self._bar.visible = settings.colours == "speed"
        if not live:
            self._frame.max = max(frames - 1, 1)

    def show_frame(self, frame: int, playing: bool) -> None:
        """Show where the motion stands."""
        self._frame.value = frame
        if (self._play.label == "Pause") != playing:
            self._play.label, self._play.icon = ("Pause", "player-pause") if playing else ("Play", "player-play")

    def show_status(self, text: str) -> None:
        """Show a line above everything."""
        self._status.content = text

    def _watched(self, handle: Any) -> Any:
        @handle.on_update
        async def _(_: object) -> None:
            self._changed()

        return handle

    def _button(self, gui: GuiApi, label: str, button: Button, icon: Any) -> Any:
        handle = gui.add_button(label, icon=icon)

        @handle.on_click
        async def _(event: GuiEvent[Any]) -> None:
            if event.client is not None:
                self._pressed(button, event.client)

        return handle

    def _resetting(self, gui: GuiApi, *handles: GuiInputHandle[Any]) -> None:
        defaults = [handle.value for handle in handles]

        @gui.add_button("Reset", color="gray").on_click
        async def _(_: object) -> None:
            for handle, default in zip(handles, defaults, strict=True):
                handle.value = default
