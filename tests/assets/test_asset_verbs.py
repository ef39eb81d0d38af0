"""The command line's verbs, and the catalogue itself."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tiny_archives import NETWORK, asset, sha256
from tiny_web import Shelf, Web

from dynhair.assets import fetch_assets, list_assets, print_path
from dynhair.assets.catalogue import CATALOGUE
from dynhair.assets.places import PypiArchive, WebArchive, WebFolder
from dynhair.assets.sources import Source
from dynhair.errors import DynhairError


@pytest.fixture
def two_assets(web: Web, shelf: Shelf, cache: Path) -> tuple[Path, Path]:
    """Two assets, ``tiny`` and ``other``; their paths."""
    web.files = {"/net": NETWORK, "/other": b"other"}
    tiny = asset(Source(WebFolder(web.url()), "net"))
    other = asset(Source(WebFolder(web.url()), "other"), content=b"other", name="other")
    shelf.hold(tiny, other)
    return cache / tiny.filename, cache / other.filename


def test_the_list_tells_what_is_fetched(two_assets: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    fetch_assets(("other",))
    capsys.readouterr()
    list_assets()
    rows = {row.split()[1]: row for row in capsys.readouterr().out.splitlines() if row.startswith("│")}
    assert all(word in rows["tiny"] for word in ("testing", "2.4 kB", "CC0", "no"))
    assert all(word in rows["other"] for word in ("testing", "5 bytes", "CC0", "yes"))


def test_all_are_fetched_by_default(two_assets: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    fetch_assets()
    assert all(path.exists() for path in two_assets)
    answer = capsys.readouterr()
    assert answer.out == f"tiny: {two_assets[0]}\nother: {two_assets[1]}\n"
    assert "licence: CC0" in answer.err


def test_the_path_alone_is_printed(two_assets: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    print_path("tiny")
    assert capsys.readouterr().out == f"{two_assets[0]}\n"
    assert two_assets[0].read_bytes() == NETWORK


def test_a_file_is_for_one_asset(two_assets: tuple[Path, Path], tmp_path: Path) -> None:
    given = tmp_path / "given"
    given.write_bytes(b"other")
    for names in ((), ("tiny", "other")):
        with pytest.raises(DynhairError, match="one name"):
            fetch_assets(names, given)
    fetch_assets(("other",), given)
    assert [path.exists() for path in two_assets] == [False, True]


def test_names_are_checked_before_anything_is_fetched(two_assets: tuple[Path, Path]) -> None:
    with pytest.raises(DynhairError, match="huge"):
        fetch_assets(("tiny", "huge"))
    assert not two_assets[0].exists()


def test_the_catalogue_pins_everything() -> None:
    assert {entry.name for entry in CATALOGUE} == {
        "face-landmarker",
        "selfie-segmentation",
        "isnet",
        "bisenet-celebamask",
        "lpips-vgg16",
        "lpips-alexnet",
        "inception-fid",
    }
    for entry in CATALOGUE:
        pins = [entry.sha256]
        for source in entry.sources:
            place = source.place
            if isinstance(place, WebFolder):
                assert place.url.startswith("https://")
                assert place.url.endswith("/")
            else:
                pins.append(place.sha256)
                assert isinstance(place, PypiArchive) or place.url.startswith("https://")
        assert isinstance(entry.sources[-1].place, PypiArchive | WebArchive)
        assert all(re.fullmatch("[0-9a-f]{64}", pin) for pin in pins)
        assert len({*pins}) == len(pins)


def test_the_same_bytes_have_the_same_name() -> None:
    names = [asset(content=content).filename for content in (b"a", b"a", b"b")]
    assert names[0] == names[1] == f"tiny-{sha256(b'a')[:12]}.bin"
    assert names[2] != names[0]
