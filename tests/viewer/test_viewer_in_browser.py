"""The page in a real browser: it loads, plays, and its controls change what is seen."""

from __future__ import annotations

import io
import os
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from dynhair.errors import DynhairError
from dynhair.viewer.motions import named_clips
from dynhair.viewer.run import open_server, run_viewer
from splat_files import read_splats
from tiny_avatars import make_avatar

if TYPE_CHECKING:
    from playwright.sync_api import Page as BrowserPage

GPU_LESS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox")
PICTURE = {"x": 0.0, "y": 160.0, "width": 640.0, "height": 440.0}  # of the page, beside its panel and its notices
PATIENCE = 60.0  # seconds; a machine without a GPU that is busy takes long


def browser_path() -> str:
    """Chromium or Chrome; without one, the test is skipped."""
    named = os.environ.get("DYNHAIR_CHROMIUM")
    found = named or next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        pytest.skip("no Chromium: install one, or name one by DYNHAIR_CHROMIUM")
    return found


def test_without_viser_the_error_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(DynhairError, match=r"pip install 'dynhair\[viewer\]'"):
        open_server(8080, "someone")


def test_what_is_no_avatar_is_refused_before_anything_is_served(tmp_path: Path) -> None:
    with pytest.raises(DynhairError):
        run_viewer(tmp_path / "nobody", browser=False)


@pytest.fixture
def address() -> Iterator[str]:
    """A viewer of a tiny avatar, drawing in a thread of its own."""
    pytest.importorskip("viser")
    from dynhair.viewer.server import Viewer

    avatar = make_avatar().eval().requires_grad_(False)
    assert avatar.recording is not None
    server = open_server(18080, "someone")
    viewer = Viewer(server, avatar, avatar.recording, named_clips(avatar.recording, None, avatar))
    failures: list[BaseException] = []

    def run() -> None:
        try:
            viewer.run()
        except BaseException as error:
            failures.append(error)

    loop = threading.Thread(target=run)
    loop.start()
    yield f"http://localhost:{server.get_port()}"
    viewer.stop()
    loop.join(PATIENCE)
    server.stop()
    assert not loop.is_alive()
    assert not failures


@pytest.fixture
def page(address: str) -> Iterator[BrowserPage]:
    """The viewer's page; at the end it has had no error, and has asked nothing of other hosts."""
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=browser_path(), args=GPU_LESS)
        page = browser.new_context(viewport={"width": 1000, "height": 640}).new_page()
        page.set_default_timeout(1000 * PATIENCE)
        errors: list[str] = []
        strangers: list[str] = []
        page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: strangers.append(request.url) if foreign(request.url, address) else None)
        page.goto(address)
        yield page
        browser.close()
        assert not errors
        assert not strangers


def foreign(url: str, address: str) -> bool:
    own = (address, address.replace("http", "ws"), "data:", "blob:")
    return not url.startswith(own)


def seen(page: BrowserPage) -> np.ndarray:
    """The page's picture now."""
    return np.asarray(Image.open(io.BytesIO(page.screenshot(clip=PICTURE))).convert("RGB"), float)  # pyright: ignore[reportArgumentType]


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Part of the pixels that differ visibly."""
    return float((np.abs(one - other).max(-1) > 12).mean())


def still(page: BrowserPage) -> np.ndarray:
    """The picture when it no longer changes, and shows somebody."""
    deadline, before = time.monotonic() + PATIENCE, seen(page)
    while time.monotonic() < deadline:
        page.wait_for_timeout(600)
        now = seen(page)
        if difference(before, now) == 0 and now.std() > 5:
            return now
        before = now
    raise AssertionError("the picture does not come to rest")


def changed(page: BrowserPage, before: np.ndarray) -> np.ndarray:
    """The picture once it is another."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        page.wait_for_timeout(200)
        now = seen(page)
        if difference(before, now) > 0.001:
            return now
    raise AssertionError("the picture has not changed")


def choose(page: BrowserPage, label: str, option: str) -> None:
    page.get_by_label(label, exact=True).first.click()
    page.get_by_role("option", name=option, exact=True).click()


def put(page: BrowserPage, label: str, value: str) -> None:
    """Type a value into the field beside a slider."""
    row = page.get_by_text(label, exact=True).locator("xpath=ancestor::*[.//input][1]")
    field = row.locator("input").last
    field.fill(value)
    field.press("Enter")


@pytest.mark.slow
def test_a_motion_plays_and_pauses(page: BrowserPage) -> None:
    rest = still(page)
    choose(page, "motion", "turn")
    page.get_by_role("button", name="Play").click()
    changed(page, rest)
    page.get_by_role("button", name="Pause").click()
    still(page)


@pytest.mark.slow
def test_controls_change_the_picture(page: BrowserPage) -> None:
    before = still(page)
    put(page, "cut off", "0.9")
    cut = changed(page, before)
    put(page, "brightness", "2.5")
    changed(page, cut)
    page.get_by_role("button", name="Reset").first.click()
    assert difference(still(page), before) < 0.001
    choose(page, "hair colour", "by speed")
    changed(page, before)


@pytest.mark.slow
def test_orbiting_with_the_mouse_changes_the_view(page: BrowserPage) -> None:
    before = still(page)
    page.mouse.move(200, 300)
    page.mouse.down()
    page.mouse.move(320, 320, steps=5)
    page.mouse.up()
    changed(page, before)


@pytest.mark.slow
def test_files_are_saved(page: BrowserPage, tmp_path: Path) -> None:
    still(page)
    with page.expect_download() as snapshot:
        page.get_by_role("button", name="Snapshot").click()
    snapshot.value.save_as(tmp_path / "snapshot.png")
    with Image.open(tmp_path / "snapshot.png") as image:
        assert image.mode == "RGBA"
    with page.expect_download() as splats:
        page.get_by_role("button", name="Splats").click()
    splats.value.save_as(tmp_path / "splats.ply")
    assert len(read_splats(tmp_path / "splats.ply").means) == 20 * 7 + 100


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")  # for a page that closes in the very moment it is sent to
def test_pages_come_and_go(page: BrowserPage, address: str) -> None:
    before = still(page)
    page.get_by_role("button", name="Play").click()
    other = page.context.new_page()
    other.goto(address)
    other.get_by_role("button", name="Pause").wait_for()  # the pages share what is on show
    other.close()
    changed(page, before)
    page.get_by_role("button", name="Pause").click()
    still(page)
