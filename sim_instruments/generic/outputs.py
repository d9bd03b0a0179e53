"""What a device outputs by a clock of its own, run after run, in a thread of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from sim_instruments.instrument import Setting

MAX_AHEAD_S = 60.0


class Ahead:
    """How many outputs are computed some way ahead, as if nothing would change.

    Each time twice as many as before, up to `most`; from `first` on again after a change.
    """

    def __init__(self, first: int, most: int) -> None:
        self._first, self._most = first, most
        self._next = first

    def forget(self) -> None:
        """Begin with the first number again."""
        self._next = self._first

    def count(self, interval_s: float, at_least: int = 1) -> int:
        """Return how many to compute now."""
        count = max(at_least, min(self._next, int(MAX_AHEAD_S / interval_s)))
        self._next = min(2 * self._next, self._most)
        return count


class OutputModel(ABC):
    """A device that outputs once it is told to, until it is stopped, or begins another run.

    Truth (`simulator` mapping): `clock_error` of its clock: by how much its intervals are too long.
    """

    def __init__(self, setting: Setting, latency_s: float) -> None:
        self._stretch = 1.0 + setting.truth.quantity("clock_error", "1")
        self._latency_s = latency_s
        self._name, self._clock, self._faults = setting.name, setting.clock, setting.faults
        self._lock = setting.world.lock
        self._closed = False
        self._run = 0

    @abstractmethod
    def _goes_on(self) -> bool:
        """Return whether there is another output."""

    @abstractmethod
    def _next_s(self) -> float:
        """Return when to look for the next output."""

    @abstractmethod
    def _due(self) -> Callable[[], object] | None:
        """Return what sends the next output, without the lock; None where nothing is sent."""

    def close(self) -> None:
        """End the output for good; the thread ends when it next looks."""
        self._closed = True

    def _begin(self) -> None:
        """Begin a run; the one before it ends."""
        self._run += 1
        number = self._run

        def output() -> float | None:
            with self._lock:
                if self._closed or number != self._run or not self._goes_on():
                    return None
                send = self._due()
            if send is not None:
                send()
            return self._next_s()

        # The first run has the device's own name, for the order among equal times.
        name = self._name if number == 1 else f"{self._name} {number}"
        self._clock.repeat(name, self._next_s(), output)
