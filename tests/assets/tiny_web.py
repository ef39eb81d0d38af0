"""A web server and a catalogue of the test's own."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from http.server import ThreadingHTTPServer

import pytest

from dynhair.assets import catalogue, verbs
from dynhair.assets.catalogue import Asset


@dataclass
class Web:
    """A server: what it serves by path, and what it was asked for."""

    server: ThreadingHTTPServer
    files: dict[str, bytes] = field(default_factory=dict)
    broken_off: set[str] = field(default_factory=set)
    requests: list[str] = field(default_factory=list)
    authorizations: list[str | None] = field(default_factory=list)
    meeting: threading.Barrier | None = None

    def url(self, path: str = "/", user: str = "") -> str:
        return f"http://{user}127.0.0.1:{self.server.server_port}{path}"

    def stop(self) -> None:
        self.server.shutdown()
        self.server.server_close()


class Shelf:
    """Takes the place of the catalogue."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.monkeypatch = monkeypatch

    def hold(self, *assets: Asset) -> None:
        for module in (catalogue, verbs):
            self.monkeypatch.setattr(module, "CATALOGUE", assets)
