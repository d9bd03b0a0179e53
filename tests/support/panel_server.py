"""A panel that listens on a free port of this computer, in a thread of the test."""

from __future__ import annotations

import json
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any

import uvicorn
from for_people import SCRIPTS, need_sentences

from station.cli.starting import DetachedRuns
from station.clock import RealClock
from station.panel.access import Access, Role
from station.panel.app import Panel

HOSTS = ("127.0.0.1", "localhost")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@dataclass
class Served:
    """A panel that answers at an address."""

    url: str
    runs: Path
    server: uvicorn.Server
    thread: Thread

    def get(self, path: str, **headers: str) -> tuple[int, Any]:
        """Return status and text of a page."""
        return self._answer(urllib.request.Request(self.url + path, headers=headers))

    def post(self, path: str, data: Any, **headers: str) -> tuple[int, Any]:
        """Return status and text of an action, as of a page of the panel but for `headers`."""
        own = {"Origin": self.url, "Content-Type": "application/json", **headers}
        body = json.dumps(data).encode()
        return self._answer(urllib.request.Request(self.url + path, body, own))

    def _answer(self, request: urllib.request.Request) -> tuple[int, Any]:
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                status, text = answer.status, answer.read().decode(errors="replace")
        except urllib.error.HTTPError as error:
            status, text = error.code, error.read().decode()
        if "/static/" not in request.full_url:
            need_sentences(SCRIPTS.sub("", text), request.full_url)
        return status, text

    def stop(self) -> None:
        """End the panel."""
        self.server.should_exit = self.server.force_exit = True
        self.thread.join(10.0)


def begin(runs: Path, port: int, tokens: dict[Role, str] | None = None) -> Served:
    """Begin to serve, and return once the panel answers."""
    app = Panel(runs, Access(HOSTS, tokens or {}), DetachedRuns(runs)).app()
    server = uvicorn.Server(uvicorn.Config(app, "127.0.0.1", port, log_level="critical"))
    thread = Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started and thread.is_alive():
        RealClock().sleep(0.02)
    return Served(f"http://127.0.0.1:{port}", runs, server, thread)


@contextmanager
def panel(runs: Path, tokens: dict[Role, str] | None = None) -> Iterator[Served]:
    """Serve the panel on the runs below a folder."""
    served = begin(runs, free_port(), tokens)
    try:
        yield served
    finally:
        served.stop()
