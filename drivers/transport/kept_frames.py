"""Frames that are stamped when they come: they wait here until somebody takes them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from threading import Event, Lock, Thread
from typing import Generic, TypeVar

from drivers.transport.ports import TracedLine
from station.errors import InstrumentError, reason_of
from station.roles import Place

LOOK_S = 0.005
READ_SLICE_S = 0.2
MAX_FRAMES = 500_000
"""That nobody takes, about 100 MB: the oldest are dropped, which their own numbers show."""
MAX_SILENCE_S = 10.0
"""Real time without a sign of life of the reading thread."""

F = TypeVar("F")


class KeptFrames(TracedLine, ABC, Generic[F]):
    """What a line of unasked frames does on whatever it goes; `kind_of` tells kinds apart.

    A line calls `_begin_to_read` when it is open; its `_read` puts what comes to `_keep`, and
    leaves in `_dead` why nothing can come any more. A thread reads, or on virtual time whoever has
    written.
    """

    line = "the line"
    when_broken = "check the cable and the instrument's power, then start again"

    def __init__(self, place: Place, wire: str, kind_of: Callable[[F], int]) -> None:
        super().__init__(place)
        self._wire = place.clock.wire(wire)
        self._kind_of = kind_of
        self._frames: deque[F] = deque()
        self._frames_lock = Lock()
        self._dropped = 0
        self._closing = Event()
        self._dead: str | None = None
        self._reader = Thread(target=self._keep_reading, name=f"{place.name} reader", daemon=True)

    def take(self, *kinds: int) -> list[F]:
        """Return the received frames of these kinds, in order, and keep the others.

        Raises InstrumentError when the line is gone and nothing is left to take.
        """
        with self._frames_lock:
            taken = [frame for frame in self._frames if self._kind_of(frame) in kinds]
            if taken:
                kept = [frame for frame in self._frames if self._kind_of(frame) not in kinds]
                self._frames.clear()
                self._frames.extend(kept)
        if not taken:
            self._must_live()
        return taken

    def newest(self, kind: int) -> F | None:
        """Return the last received frame of a kind that nobody has taken yet, and keep it.

        Raises InstrumentError when the line is gone.
        """
        with self._frames_lock:
            newest_first = reversed(self._frames)
            newest = next((frame for frame in newest_first if self._kind_of(frame) == kind), None)
        if newest is None:
            self._must_live()
        return newest

    def wait_for(self, kind: int, deadline_s: float) -> list[F]:
        """Return the frames of a kind as soon as there are any, or none at run time.

        Raises InstrumentError when the line is gone.
        """
        while not (frames := self.take(kind)) and self._clock.now() < deadline_s:
            self._clock.sleep(LOOK_S)
        return frames

    def _begin_to_read(self) -> None:
        self._wire.open()
        self._traced("-", b"opened")
        if not self._wire.listen(lambda: self._read(LOOK_S)):
            self._reader.start()

    def close(self) -> None:
        """Close the line and end the reader; a line that is already gone is no error."""
        if not self._closing.is_set():
            self._traced("-", b"closed")
        self._closing.set()
        self._wire.close()
        if self._reader.is_alive():
            self._reader.join(2 * READ_SLICE_S)
        with suppress(OSError):
            self._shut()

    @abstractmethod
    def _shut(self) -> None:
        """Give back what the line goes over."""

    @abstractmethod
    def _read(self, within_s: float) -> bool:
        """Keep what has come, or comes within a real time; return whether there was anything."""

    def _keep_reading(self) -> None:
        with self._clock.pulse(f"the reader of {self._place.name}", MAX_SILENCE_S) as pulse:
            while not self._closing.is_set() and self._dead is None:
                self._read(READ_SLICE_S)
                pulse.beat()

    def _must_live(self) -> None:
        """Raise InstrumentError when the line is gone."""
        if self._dead is None and not self._reader.is_alive():
            self._read(0.0)  # nobody else would see that it was hung up
        if self._dead is not None:
            raise self._broken(self._dead)

    def _keep(self, frames: Iterable[F]) -> None:
        with self._frames_lock:
            self._frames.extend(frames)
            too_many = len(self._frames) - MAX_FRAMES
            if too_many <= 0:
                return
            for _ in range(too_many):
                self._frames.popleft()
            self._dropped += too_many
            first = self._dropped == too_many
        if first:
            self._place.note("frames-dropped", kept=MAX_FRAMES)

    def _died(self, error: Exception) -> bool:
        """Take note that nothing can come any more; return that there was nothing."""
        if not self._closing.is_set():
            self._dead = reason_of(error)
        self._wire.close()  # nor what is still on its way
        return False

    def _broken(self, why: str) -> InstrumentError:
        return self._fault(f"used {self.line}", f"the line broke ({why})", self.when_broken)
