"""Lines of an instrument that can hold its input: what follows a wait is taken after it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from threading import Lock
from typing import Any

from sim_instruments.wire.requests import Conversation, LineServer


class HeldLineServer(LineServer):
    """Answer parts of lines in the order they came, none while the instrument holds its input.

    `parts` cuts a line behind each command that may hold what follows; `held_s` returns for how
    long nothing more is taken, 0 where it is taken now.
    """

    def __init__(
        self,
        *place: Any,
        parts: Callable[[bytes], list[bytes]],
        held_s: Callable[[], float],
        **options: Any,
    ) -> None:
        super().__init__(*place, **options)
        self._parts, self._held_s = parts, held_s
        self._turn = Lock()
        self._held: deque[tuple[Conversation, bytes]] = deque()

    def requests(self, talk: Conversation, data: bytes) -> Iterator[bytes]:
        """Yield each part of the lines that are whole."""
        for line in super().requests(talk, data):
            yield from self._parts(line)

    def _answer(self, talk: Conversation, request: bytes) -> None:
        with self._turn:
            self._held.append((talk, request))
            if len(self._held) == 1:
                self._take()

    def _resume(self) -> None:
        with self._turn, suppress(OSError):  # who sent it may have hung up
            self._take()

    def _take(self) -> None:
        """Answer what is there; where the instrument holds it, come back later."""
        while self._held:
            with self._lock:
                wait_s = self._held_s()
            if wait_s > 0:
                self.later(wait_s, self._resume)
                return
            super()._answer(*self._held.popleft())
