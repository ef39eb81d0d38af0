"""The viewer as a command: open an avatar, serve its page until it is interrupted."""

from __future__ import annotations

import contextlib
import io
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from dynhair.avatar import Avatar
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.threads import keep_large_blocks
from dynhair.training.recording import recording_of
from dynhair.training.run import avatar_folder, trained_capture
from dynhair.viewer.motions import named_clips

if TYPE_CHECKING:
    from viser import ViserServer  # pyright: ignore[reportMissingImports]

HOST = "127.0.0.1"
"""Other machines see the page through a tunnel of the user's own: nobody else shall."""


def run_viewer(
    avatar: Path | str,
    *,
    capture: Path | str | None = None,
    port: int = 8080,
    browser: bool = True,
    console: Console | None = None,
) -> None:
    """Serve a page on which an avatar is looked at, moved and edited live, until Ctrl-C.

    The page is served to this machine alone, and needs no network.

    Args:
        avatar: the avatar's folder, or its run's.
        capture: whose motions can be played; the avatar's own when left out, if that is still there.
        port: of the page; the next free one is taken where it is in use.
        browser: open the page.
        console: where the address goes; standard output when left out.

    Raises:
        DynhairError: viser is not installed, or the avatar or the capture cannot be read.
    """
    path, console = Path(avatar), console or Console()
    keep_large_blocks()
    with console.status("opening the avatar"):
        loaded, recording = Avatar.load(avatar_folder(path)).frozen(), recording_of(path)
        clips = named_clips(recording, _capture(path, capture), loaded)
        server = open_server(port, path.name)
        from dynhair.viewer.server import Viewer

        viewer = Viewer(server, loaded, recording, clips)
    address = f"http://localhost:{server.get_port()}"
    console.print(f"{path.name} is on show at {address} (Ctrl-C ends it)", highlight=False, soft_wrap=True)
    if browser:
        webbrowser.open(address)
    try:
        viewer.run()
    except KeyboardInterrupt:
        console.print("the page is closed")
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def open_server(port: int, label: str) -> ViserServer:
    """Start what serves pages, without its banner.

    Args:
        port: the next free one is taken where it is in use.
        label: above the page's panel.

    Raises:
        DynhairError: viser is not installed.
    """
    try:
        import viser  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise DynhairError(
            "the viewer needs viser, which is not installed", mend="pip install 'dynhair[viewer]'"
        ) from error
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(HOST, port, label, verbose=False)
    server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
    return server


def _capture(path: Path, given: Path | str | None) -> Capture | None:
    """The capture whose motions can be played, if there is one."""
    if given is not None:
        return Capture.open(given, cache_bytes=0)
    with contextlib.suppress(DynhairError):
        return Capture.open(trained_capture(path), cache_bytes=0)
    return None
