"""The wire that carries the bench's trigger from the one output that drives it to whoever listens.

A listener has a latency of its own; the line has none.
"""

from __future__ import annotations

from collections.abc import Callable

Edge = Callable[[float], None]


class TriggerLine:
    """A line that is low or high; who listens is told of each edge and its time, in s.

    Whoever drives it holds the lock of the world, and so does a listener while it is told.
    """

    def __init__(self) -> None:
        self.high = False
        self._on_rise: list[Edge] = []
        self._on_fall: list[Edge] = []

    def listen(self, on_rise: Edge, on_fall: Edge | None = None) -> None:
        """Have rising edges told from now on, and falling ones where wished, in order of asking."""
        self._on_rise.append(on_rise)
        if on_fall is not None:
            self._on_fall.append(on_fall)

    def rise(self, time_s: float) -> None:
        """Go high at a time; a line that is high already has no edge."""
        if not self.high:
            self.high = True
            for told in self._on_rise:
                told(time_s)

    def fall(self, time_s: float) -> None:
        """Go low at a time; a line that is low already has no edge."""
        if self.high:
            self.high = False
            for told in self._on_fall:
                told(time_s)
