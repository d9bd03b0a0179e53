"""One run as the panel shows it, read from its growing files, and its news to browsers.

Any number of viewers share it, those of one language its texts; they get server-sent events, few
streams at a time to one computer.
"""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from secrets import token_hex
from threading import Lock
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from station.clock import boot_seconds
from station.control.run_reader import DAMAGE, RunReader
from station.panel.translating import LIVE, STATE, translated
from station.record.run_list import again, title_of
from station.record.series import RunSeries
from station.texts import ENGLISH, IN_ENGLISH, Texts

LOOKS_EVERY_S = 0.1
"""Real time between two looks at the files, however many viewers there are."""
PLOTS_EVERY_S = 0.5
PLOTS_WITHIN_S = 0.5
"""Real time for one look at the raw files: what else the page shows does not wait for them."""
WHOLE = json.dumps({"message": ""})
SAID = {"state": STATE, "live": LIVE, "unreadable": ("message",)}
"""Under which names the news hold texts that people read."""


class RunWatch:
    """What a run's files say, as numbered versions of JSON texts."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._reader = RunReader(folder)
        self._series = RunSeries(folder)
        self._of_plan = {"again": again(folder), "title": title_of(folder)}
        self._lock = Lock()
        self._looked_s = self._plotted_s = float("-inf")
        self._key = token_hex(4)
        self._texts = {"state": "", "live": "", "plots": "", "unreadable": WHOLE}
        self._versions = dict.fromkeys(self._texts, 0)
        self._translated: dict[tuple[str, str], tuple[int, str]] = {}
        """Version and text of each kind of news in each language but English."""

    def news(self, seen: dict[str, int], texts: Texts = IN_ENGLISH) -> Iterator[tuple[str, str]]:
        """Yield each kind of news that is new since `seen`, with its text."""
        with self._lock:
            now_s = boot_seconds()
            if now_s - self._looked_s >= LOOKS_EVERY_S:
                self._looked_s = now_s
                self._look(now_s)
            for name, version in self._versions.items():
                if version > seen.get(name, 0):
                    seen[name] = version
                    yield name, self._text(name, texts)

    def _text(self, name: str, texts: Texts) -> str:
        """Return news in a language; whoever asks first has them translated for all."""
        language, version = texts.languages[0], self._versions[name]
        if language == ENGLISH or name not in SAID:
            return self._texts[name]
        if self._translated.get((name, language), (0, ""))[0] != version:
            data = translated(json.loads(self._texts[name]), texts, SAID[name])
            self._translated[name, language] = version, json.dumps(data, allow_nan=False)
        return self._translated[name, language][1]

    def _look(self, now_s: float) -> None:
        """Read what was added; a folder that cannot be read is said to be so."""
        damage = ""
        looks = (
            self._reader.read,
            self._look_at_state,
            lambda: self._look_at_plots(now_s),
            self._reader.refuse_altered,
        )
        for look in looks:
            try:
                look()
            except DAMAGE as error:
                gone = not self.folder.is_dir()
                why = "its folder is not there any more" if gone else str(error)
                damage = damage or f"{self.folder.name} cannot be read: {why}"
        self._put("unreadable", {"message": damage})

    def _look_at_state(self) -> None:
        self._put("state", {**self._reader.state(), **self._of_plan})
        self._put("live", self._reader.live())

    def _look_at_plots(self, now_s: float) -> None:
        if now_s - self._plotted_s >= PLOTS_EVERY_S and self._series.look(PLOTS_WITHIN_S):
            self._plotted_s = now_s
            self._put("plots", self._series.data())

    def mark(self, seen: dict[str, int]) -> str:
        """Return a word for what was seen, for a browser that comes again."""
        return ":".join([self._key, *(str(seen.get(name, 0)) for name in self._versions)])

    def seen_at(self, mark: str) -> dict[str, int]:
        """Return what was seen at a mark; nothing where this panel did not give it."""
        key, *numbers = mark.split(":")
        if key != self._key:
            return {}
        try:
            return {name: int(n) for name, n in zip(self._versions, numbers, strict=True)}
        except ValueError:  # others than there are, or no numbers
            return {}

    def _put(self, name: str, data: Any) -> None:
        text = json.dumps(data, allow_nan=False)
        if text != self._texts[name]:
            self._texts[name] = text
            self._versions[name] += 1


BEAT_S = 1.0
MAX_STREAMS = 3
"""That stay open. A browser opens six connections to a server, and an abort needs one of them."""
AGAIN_MS = 1000


class Streams:
    """The open streams; a further one gives its news and ends, and its browser soon comes again."""

    def __init__(self) -> None:
        self._open: Counter[str] = Counter()

    async def news(self, request: Request, watch: RunWatch, texts: Texts) -> AsyncIterator[str]:
        """Yield what is new since the browser's last event, for as long as it listens."""
        client = request.client.host if request.client else ""
        seen = watch.seen_at(request.headers.get("last-event-id", ""))
        stays = self._open[client] < MAX_STREAMS
        self._open[client] += stays
        since_beat_s = BEAT_S
        try:
            yield f"retry: {AGAIN_MS}\n\n"
            while not await request.is_disconnected():
                for name, text in await run_in_threadpool(lambda: list(watch.news(seen, texts))):
                    yield f"id: {watch.mark(seen)}\nevent: {name}\ndata: {text}\n\n"
                if since_beat_s >= BEAT_S:
                    yield "event: beat\ndata: {}\n\n"
                    since_beat_s = 0.0
                if not stays:
                    return
                await asyncio.sleep(LOOKS_EVERY_S)
                since_beat_s += LOOKS_EVERY_S
        finally:
            self._open[client] -= stays
