"""The cache: fetched once, verified at every use, whole or absent."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pooch
import pytest
from tiny_archives import NETWORK, asset, sha256
from tiny_web import Shelf, Web

from dynhair.assets import asset_path, fetch, is_fetched
from dynhair.assets.cache import cache_folder
from dynhair.assets.places import WebFolder
from dynhair.assets.sources import Source
from dynhair.errors import DynhairError


@pytest.fixture
def two_mirrors(web: Web, shelf: Shelf) -> Web:
    """An asset with an official address and a mirror; neither serves it yet."""
    shelf.hold(asset(*(Source(WebFolder(web.url(f"/{place}/")), "net") for place in ("official", "mirror"))))
    return web


def test_an_asset_is_downloaded_once_and_used_offline(two_mirrors: Web, cache: Path) -> None:
    two_mirrors.files["/official/net"] = NETWORK
    assert not is_fetched("tiny")
    path = asset_path("tiny")
    two_mirrors.stop()
    assert asset_path("tiny") == path == fetch("tiny")
    assert is_fetched("tiny")
    assert two_mirrors.requests == ["/official/net"]
    assert path.read_bytes() == NETWORK
    assert path.suffix == ".bin"
    assert list(cache.iterdir()) == [path]


@pytest.mark.parametrize("official", [None, b"another file"])
def test_the_mirror_helps_out(two_mirrors: Web, cache: Path, official: bytes | None) -> None:
    if official is not None:
        two_mirrors.files["/official/net"] = official
    two_mirrors.files["/mirror/net"] = NETWORK
    assert asset_path("tiny").read_bytes() == NETWORK
    assert two_mirrors.requests == ["/official/net", "/mirror/net"]
    assert len(list(cache.iterdir())) == 1


def test_failures_say_what_was_tried_and_how_to_mend_it(two_mirrors: Web, cache: Path) -> None:
    two_mirrors.files["/mirror/net"] = b"another file"
    with pytest.raises(DynhairError) as caught:
        asset_path("tiny")
    text = str(caught.value)
    assert f"{two_mirrors.url('/official/net')}: 404" in text
    assert f"{two_mirrors.url('/mirror/net')}: has SHA-256 {sha256(b'another file')}" in text
    assert f"SHA-256 {sha256(NETWORK)}, {len(NETWORK)} bytes" in text
    assert "dynhair assets fetch tiny --file FILE" in text
    assert list(cache.iterdir()) == []


def test_without_a_connection_the_reason_is_named(two_mirrors: Web, cache: Path) -> None:
    two_mirrors.stop()
    with pytest.raises(DynhairError, match="refused"):
        asset_path("tiny")
    assert not is_fetched("tiny")


def test_a_download_that_breaks_off_leaves_nothing(two_mirrors: Web, cache: Path) -> None:
    two_mirrors.files["/official/net"] = NETWORK
    two_mirrors.broken_off.add("/official/net")
    with pytest.raises(DynhairError, match="official"):
        asset_path("tiny")
    assert list(cache.iterdir()) == []


def test_an_interrupted_download_leaves_nothing(two_mirrors: Web, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(self: pooch.HTTPDownloader, url: str, output_file: str, pooch: None) -> None:
        Path(output_file).write_bytes(NETWORK[:10])
        raise KeyboardInterrupt

    monkeypatch.setattr(pooch.HTTPDownloader, "__call__", interrupted)
    with pytest.raises(KeyboardInterrupt):
        asset_path("tiny")
    assert list(cache.iterdir()) == []


@pytest.mark.parametrize("damage", [NETWORK[:-1], NETWORK[:-1] + b"?", b""])
def test_a_damaged_file_is_noticed_and_replaced(two_mirrors: Web, cache: Path, damage: bytes) -> None:
    two_mirrors.files["/official/net"] = NETWORK
    path = asset_path("tiny")
    path.write_bytes(damage)
    assert not is_fetched("tiny")
    assert asset_path("tiny").read_bytes() == NETWORK


def test_a_damaged_file_is_never_handed_out(two_mirrors: Web, cache: Path) -> None:
    two_mirrors.files["/official/net"] = NETWORK
    asset_path("tiny").write_bytes(b"damaged")
    del two_mirrors.files["/official/net"]
    with pytest.raises(DynhairError, match="tiny is damaged"):
        asset_path("tiny")


def test_two_at_once_get_the_same_file(two_mirrors: Web, cache: Path) -> None:
    two_mirrors.files["/official/net"] = NETWORK
    two_mirrors.meeting = Barrier(2)  # neither is answered before both have asked
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(asset_path, ["tiny", "tiny"])
    assert first == second
    assert first.read_bytes() == NETWORK
    assert list(cache.iterdir()) == [first]


def test_a_file_given_by_hand_needs_no_connection(two_mirrors: Web, cache: Path, tmp_path: Path) -> None:
    given = tmp_path / "given"
    given.write_bytes(NETWORK)
    assert fetch("tiny", given).read_bytes() == NETWORK
    given.unlink()
    assert asset_path("tiny").read_bytes() == NETWORK
    assert two_mirrors.requests == []


def test_a_wrong_file_given_by_hand_is_refused(two_mirrors: Web, cache: Path, tmp_path: Path) -> None:
    given = tmp_path / "given"
    given.write_bytes(b"another file")
    with pytest.raises(DynhairError) as caught:
        fetch("tiny", given)
    assert sha256(b"another file") in caught.value.message
    assert sha256(NETWORK) in str(caught.value.expected)
    assert not cache.exists()
    assert given.read_bytes() == b"another file"


@pytest.mark.parametrize("given", ["missing", "."])
def test_a_file_given_by_hand_must_be_readable(two_mirrors: Web, cache: Path, tmp_path: Path, given: str) -> None:
    with pytest.raises(DynhairError, match="not readable"):
        fetch("tiny", tmp_path / given)


def test_an_unknown_name_lists_the_names(two_mirrors: Web, cache: Path, tmp_path: Path) -> None:
    for call in (asset_path, fetch, is_fetched):
        with pytest.raises(DynhairError, match="expected: tiny"):
            call("huge")


def test_a_cache_that_cannot_be_written_is_named(
    two_mirrors: Web, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("DYNHAIR_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(DynhairError, match="DYNHAIR_CACHE"):
        asset_path("tiny")


def test_the_cache_is_the_systems_unless_chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("DYNHAIR_CACHE", raising=False)
    assert cache_folder() == pooch.os_cache("dynhair")
    monkeypatch.setenv("DYNHAIR_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
