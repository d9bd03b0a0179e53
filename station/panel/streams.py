"""News of a run as server-sent events, few streams at a time to one computer."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from station.panel.watching import LOOKS_EVERY_S, RunWatch

BEAT_S = 1.0
MAX_STREAMS = 3
"""That stay open. A browser opens six connections to a server, and an abort needs one of them."""
AGAIN_MS = 1000


class Streams:
    """The open streams; a further one gives its news and ends, and its browser soon comes again."""

    def __init__(self) -> None:
        self._open: Counter[str] = Counter()

    async def news(self, request: Request, watch: RunWatch) -> AsyncIterator[str]:
        """Yield what is new since the browser's last event, for as long as it listens."""
        client = request.client.host if request.client else ""
        seen = watch.seen_at(request.headers.get("last-event-id", ""))
        stays = self._open[client] < MAX_STREAMS
        self._open[client] += stays
        since_beat_s = BEAT_S
        try:
            yield f"retry: {AGAIN_MS}\n\n"
            while not await request.is_disconnected():
                for name, text in await run_in_threadpool(lambda: list(watch.news(seen))):
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
