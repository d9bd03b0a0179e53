"""Real time, or real time multiplied for simulators in another process; the computer's own clocks.

The computer's clocks are for folder names, locks and heartbeats; never for raw data.
"""

from __future__ import annotations

import ctypes
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from datetime import UTC, date, datetime
from threading import Event, Lock, current_thread, get_ident, main_thread

from station.clock.base import Attendant, Clock, ClockStopped, ParticipantThread, Wire
from station.clock.pulse import Pulse, Pulses, Quiet

TIME_ERROR = 5
"""What adjtimex(2) answers while nothing keeps the system clock right."""
TIMEX_BYTES = 1024
"""More than the kernel's struct timex; all zeros, it asks and sets nothing."""


def utc_now() -> datetime:
    """Return the time of day in UTC, as the computer believes it."""
    return datetime.now(UTC)


def local_time() -> datetime:
    """Return the time of day where the bench stands."""
    return utc_now().astimezone()


def utc_today() -> date:
    """Return today's date in UTC."""
    return utc_now().date()


def boot_seconds() -> float:
    """Return seconds that never run backwards, for intervals of real time; sleep counts, too."""
    if sys.platform == "linux":
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    return time.monotonic()


def system_clock_synchronised() -> bool | None:
    """Return whether something, such as NTP, keeps the computer's time of day right.

    None where the system does not say: asked of the kernel on Linux only.
    """
    if sys.platform != "linux":
        return None
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(TIMEX_BYTES))
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != TIME_ERROR


INTERRUPT_SLICE_S = 0.05
PULSE_SLICE_S = 1.0
"""Who sleeps gives a sign of life at least so often."""
REAL_PATIENCE_S = 0.5
MAX_IN_MEMORY_S = 0.0737
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
        self._wire = RealWire()
        self._pulses = Pulses()
        self._pulse_of: dict[int, Pulse] = {}

    def now(self) -> float:
        """Return run time in s."""
        if (pulse := self._pulse_of.get(get_ident())) is not None:
            pulse.beats += 1
        return (time.monotonic() - self._monotonic_zero) * self.speed

    def sleep_until(self, time_s: float) -> None:
        """Sleep until run time `time_s`, or raise what `interrupt` or `stop` asks for."""
        main = current_thread() is main_thread()
        pulsing = get_ident() in self._pulse_of
        while True:
            if main:
                self.raise_interruption()
            left = (time_s - self.now()) / self.speed
            if left <= 0:
                return
            if main:
                # In slices: a signal handler may only set an attribute, it cannot notify.
                time.sleep(min(left, INTERRUPT_SLICE_S))
            elif self._stopped.wait(min(left, PULSE_SLICE_S) if pulsing else left):
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
        """Expect no sign of life of this thread; real time goes on."""
        with self.allow(math.inf):
            yield

    def real_timeout_s(self, run_seconds: float) -> float:
        """Return the same span in real time, at least half a second where time runs faster."""
        return self.patience_s(run_seconds) / self.speed

    def patience_s(self, run_seconds: float) -> float:
        """Return the same span, at least half a second of real time where time runs faster."""
        return run_seconds if self.speed == 1.0 else max(run_seconds, REAL_PATIENCE_S * self.speed)

    def holding_s(self, run_seconds: float) -> float:
        """Return the same span, but less than 0.1 s of real time."""
        return min(run_seconds, MAX_IN_MEMORY_S * self.speed)

    def pulse(self, name: str, longest_silence_s: float) -> Pulse:
        """Return the sign of life of this thread; a later one takes the place of an earlier."""
        pulse = Pulse(name, longest_silence_s)
        if (before := self._pulse_of.get(get_ident())) is not None:
            before.end()
        self._pulse_of[get_ident()] = pulse
        self._pulses.add(pulse)
        return pulse

    def allow(self, seconds: float) -> AbstractContextManager[None]:
        """Declare that until exit this thread's signs of life may take `seconds` of real time."""
        pulse = self._pulse_of.get(get_ident())
        return nullcontext() if pulse is None else pulse.allow(seconds)

    def expect(self, seconds: float) -> None:
        """Declare that this thread's very next sign of life may take `seconds` of real time."""
        if (pulse := self._pulse_of.get(get_ident())) is not None:
            pulse.expect(seconds)

    def quiet_pulses(self) -> tuple[Quiet, ...]:
        """Return who has given no sign of life for longer than it may, as far as looks show it."""
        return self._pulses.look(time.monotonic())

    def raise_interruption(self) -> None:
        """Raise what `interrupt` asks for, in the main thread."""
        if self.interruption is not None and current_thread() is main_thread():
            error, self.interruption = self.interruption, None
            if error is not None:
                raise error

    def stop(self) -> None:
        """End the sleeps of all other threads."""
        self._stopped.set()
