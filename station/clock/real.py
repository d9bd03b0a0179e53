"""Real time, or real time multiplied for simulators in another process."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from threading import Event, Lock, current_thread, main_thread

from station.clock.base import Attendant, Clock, ClockStopped, ParticipantThread, Wire

INTERRUPT_SLICE_S = 0.05
REAL_PATIENCE_S = 0.5
LONGEST_IN_MEMORY_S = 0.0737
"""Real time; no multiple of a reading period, as the other period of looking."""


class RealWire(Wire):
    """A wire that counts nothing: real time waits for nobody."""

    def open(self) -> None:
        """Count nothing."""

    def close(self) -> None:
        """Count nothing."""

    def sent(self, units: int) -> None:
        """Count nothing."""

    def wait(self, deadline_s: float) -> bool:
        """Return at once: the blocking read is the wait."""
        return True

    def received(self) -> None:
        """Count nothing."""

    def listen(self, read: Callable[[], bool]) -> bool:
        """Leave each client to its own thread."""
        return False

    def picked_up(self, units: int) -> None:
        """Count nothing."""

    def serving(self, units: int) -> AbstractContextManager[None]:
        """Run the body as it is."""
        return nullcontext()

    def attend(self, attendant: Attendant) -> bool:
        """Leave each server to its own threads."""
        return False

    def answered(self, units: int) -> None:
        """Count nothing."""

    def streamed(self, units: int) -> None:
        """Count nothing."""

    def written(self) -> None:
        """Count nothing."""


class RealClock(Clock):
    """Run time from the computer's clock, `speed` times as fast, zero at `epoch_unix`.

    Without an epoch, run time begins at zero now and follows the monotonic clock, so that a jump
    of the system clock changes nothing. With one, two processes share the same run time.
    """

    def __init__(self, speed: float = 1.0, epoch_unix: float | None = None) -> None:
        self.speed = speed
        unix, monotonic = time.time(), time.monotonic()
        self.epoch_unix = unix if epoch_unix is None else epoch_unix
        self._monotonic_zero = monotonic - (unix - self.epoch_unix)
        self._stopped = Event()
        self._interruption: BaseException | None = None
        self._wire = RealWire()

    def now(self) -> float:
        """Return run time in s."""
        return (time.monotonic() - self._monotonic_zero) * self.speed

    def sleep_until(self, time_s: float) -> None:
        """Sleep until run time `time_s`, or raise what `interrupt` or `stop` asks for."""
        main = current_thread() is main_thread()
        while True:
            if main and self._interruption is not None:
                error, self._interruption = self._interruption, None
                raise error
            left = (time_s - self.now()) / self.speed
            if left <= 0:
                return
            if main:
                # In slices: a signal handler may only set an attribute, it cannot notify.
                time.sleep(min(left, INTERRUPT_SLICE_S))
            elif self._stopped.wait(left):
                raise ClockStopped

    def participant(self, name: str) -> AbstractContextManager[None]:
        """Do nothing: in real time every thread takes part."""
        return nullcontext()

    def start(self, name: str, body: Callable[[], None]) -> ParticipantThread:
        """Start a thread named `name`."""
        thread = ParticipantThread(name, body)
        thread.begin()
        return thread

    def lock(self, name: str) -> AbstractContextManager[object]:
        """Return an ordinary lock."""
        return Lock()

    def wire(self, address: str) -> Wire:
        """Return the wire that counts nothing."""
        return self._wire

    @contextmanager
    def waiting_for_person(self) -> Iterator[None]:
        """Do nothing: real time goes on."""
        yield

    def real_timeout_s(self, run_seconds: float) -> float:
        """Return the same span in real time, at least half a second where time runs faster."""
        return self.patience_s(run_seconds) / self.speed

    def patience_s(self, run_seconds: float) -> float:
        """Return the same span, at least half a second of real time where time runs faster."""
        return run_seconds if self.speed == 1.0 else max(run_seconds, REAL_PATIENCE_S * self.speed)

    def holding_s(self, run_seconds: float) -> float:
        """Return the same span, but less than 0.1 s of real time."""
        return min(run_seconds, LONGEST_IN_MEMORY_S * self.speed)

    def interrupt(self, error: BaseException | None) -> None:
        """End the main thread's sleep, now or next, with `error`."""
        self._interruption = error

    def stop(self) -> None:
        """End the sleeps of all other threads."""
        self._stopped.set()
