"""What a clock and a wire promise, whichever kind they are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from threading import Thread
from typing import Protocol

from station.clock.pulse import Pulse, Quiet


class ClockError(Exception):
    """Time was used in a way that cannot work, or every thread waits for another."""


class ClockStopped(Exception):
    """The clock ended while a thread slept on it; the thread should return."""


class ParticipantThread:
    """A thread that takes part in time from before its start until its function returns."""

    def __init__(self, name: str, body: Callable[[], None]) -> None:
        self.name = name
        self._body = body
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self.failure: BaseException | None = None

    def _run(self) -> None:
        try:
            self._body()
        except ClockStopped:
            pass
        except BaseException as error:  # a thread has nobody to raise to: kept for who joins
            self.failure = error

    def begin(self) -> None:
        """Start the thread."""
        self._thread.start()

    def join(self, timeout_s: float | None = None) -> None:
        """Wait in real time until the thread has ended; raise what ended it, if anything did."""
        self._thread.join(timeout_s)
        if self.failure is not None:
            raise self.failure

    @property
    def alive(self) -> bool:
        """Whether the thread still runs."""
        return self._thread.is_alive()


class Attendant(Protocol):
    """A server's side of one connection that is read by whoever writes on it."""

    name: str
    """The instrument that it answers for."""

    def look(self) -> bool:
        """Read and answer what has come, or comes in a moment; return whether it may go on so."""

    def dismissed(self) -> None:
        """Note that nobody reads the connection any more; the server does so again itself."""


class FarEnd(Protocol):
    """What a wire of a recorded transcript gives a client in place of a port."""

    @property
    def is_connection(self) -> bool:
        """Whether what was on its way ends with the port: a network connection."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """Return what has come; OSError where the line broke."""
        ...

    def messages(self) -> list[bytes]:
        """Return each message that has come; OSError where the line broke."""
        ...

    def write(self, data: bytes) -> None:
        """Take a message of the client."""
        ...

    def close(self) -> None:
        """Let the client go."""
        ...


class Wire(ABC):
    """Count what is in flight between one client and one server, in units both sides can count.

    The unit is a byte on byte streams and a frame on CAN. On a real clock nothing is counted.
    """

    @abstractmethod
    def open(self) -> None:
        """Say that a client in this process listens on the wire."""

    def when_opened(self, act: Callable[[], None]) -> bool:
        """Have something done in the thread of a client that opens the wire, and return True.

        False where a clock does not do so: the server then sees for itself who comes.
        """
        return False

    @abstractmethod
    def close(self) -> None:
        """Say that the client is gone; what was in flight is forgotten."""

    def port(self) -> FarEnd | None:
        """Return the far end where it is in this process, None where a client opens a real line.

        Raises OSError where nobody answers.
        """
        return None

    @abstractmethod
    def sent(self, units: int) -> None:
        """Say, before writing them, that the client writes `units`."""

    @abstractmethod
    def wait(self, deadline_s: float) -> bool:
        """Give up the turn until an answer lies ready (True) or run time is `deadline_s` (False).

        On a real clock this returns True at once: there the blocking read itself is the wait.
        """

    @abstractmethod
    def received(self) -> None:
        """Say that the client has taken its answer and listens no more."""

    @abstractmethod
    def listen(self, read: Callable[[], bool]) -> bool:
        """Have a stream read in the thread that has written to it, and return True.

        `read` takes what has come, or comes in a moment, and returns whether there was anything.
        False where a clock does not do so: the client then reads in a thread of its own.
        """

    @abstractmethod
    def picked_up(self, units: int) -> None:
        """Say that the client has taken `units` of a stream."""

    @abstractmethod
    def serving(self, units: int) -> AbstractContextManager[None]:
        """Take `units` off the wire as the server, and be the running participant until exit."""

    @abstractmethod
    def attend(self, attendant: Attendant) -> bool:
        """Have requests read and answered in the thread that sends them, and return True.

        Said inside `serving`, by a server that answers at once. False where a clock does not, or
        where the request came from elsewhere: the server then goes on to read by itself.
        """

    @abstractmethod
    def answered(self, units: int) -> None:
        """Say, inside `serving` and after writing them, that an answer of `units` lies ready."""

    @abstractmethod
    def streamed(self, units: int) -> None:
        """Say, before writing them, that the server writes `units` of a stream."""

    @abstractmethod
    def written(self) -> None:
        """Say, after writing them, that they can be read."""


class Clock(ABC):
    """Run time in seconds, the same for steps, drivers, transports, interlocks and simulators."""

    interruption: BaseException | None = None
    """What `interrupt` asks for, until the main participant takes it up."""
    ends_prompt: Callable[[], None] | None = None
    """Wakes the main thread from a read of the terminal, while a person is asked there."""

    @abstractmethod
    def now(self) -> float:
        """Return run time in s."""

    @abstractmethod
    def sleep_until(self, time_s: float) -> None:
        """Sleep until run time `time_s`; raises ClockStopped when the clock is stopped."""

    def sleep(self, seconds: float) -> None:
        """Sleep for `seconds` of run time."""
        self.sleep_until(self.now() + seconds)

    @abstractmethod
    def participant(self, name: str) -> AbstractContextManager[None]:
        """Make this thread take part in time until exit."""

    @abstractmethod
    def start(self, name: str, body: Callable[[], None]) -> ParticipantThread:
        """Start a thread that takes part in time, known to the clock before this returns."""

    def repeat(self, name: str, first_s: float, step: Callable[[], float | None]) -> None:
        """Have `step` done at run time `first_s`, and then whenever it says, until it says None.

        It takes part in time as `name`, and must not wait in itself.
        """

        def body() -> None:
            due_s: float | None = first_s
            while due_s is not None:
                self.sleep_until(due_s)
                due_s = step()

        self.start(name, body)

    @abstractmethod
    def lock(self, name: str) -> AbstractContextManager[object]:
        """Return a lock whose waiting does not hold up time."""

    @abstractmethod
    def wire(self, address: str) -> Wire:
        """Return the wire of a server's address; both of its ends get the same one."""

    @abstractmethod
    def waiting_for_person(self) -> AbstractContextManager[None]:
        """Say that this thread waits for a human being, who may take any time."""

    @abstractmethod
    def real_timeout_s(self, run_seconds: float) -> float:
        """Return how long a blocking read may take in real time for `run_seconds` of run time."""

    @abstractmethod
    def patience_s(self, run_seconds: float) -> float:
        """Return the run time to wait for what should take `run_seconds`.

        Where time runs faster than real, a partner in another process still needs its real time.
        """

    def raise_failure(self) -> None:  # noqa: B027  (real time never stands still)
        """Raise the error of a time that stands still, wherever this thread is."""

    def holding_s(self, run_seconds: float) -> float:
        """Return the run time that data may wait in memory: `run_seconds`, or less.

        Where time runs by itself this is less than 0.1 s of real time, which is all that a killed
        process may lose.
        """
        return run_seconds

    def pulse(self, name: str, longest_silence_s: float) -> Pulse:
        """Return the sign of life of this thread, which asking for the time and sleeping give.

        `longest_silence_s` is real time. Virtual time, which sees itself when it stands still,
        looks at none.
        """
        return Pulse(name, longest_silence_s)

    def allow(self, seconds: float) -> AbstractContextManager[None]:
        """Declare that until exit this thread's signs of life may take `seconds` of real time."""
        return nullcontext()

    def expect(self, seconds: float) -> None:  # noqa: B027  (as `pulse`)
        """Declare that this thread's very next sign of life may take `seconds` of real time."""

    def quiet_pulses(self) -> tuple[Quiet, ...]:
        """Return who has given no sign of life for longer than it may, as far as looks show it."""
        return ()

    def raise_interruption(self) -> None:  # noqa: B027  (virtual time does so where it passes)
        """Raise what `interrupt` asks for where the main thread comes back from a long wait."""

    def interrupt(self, error: BaseException | None) -> None:
        """Raise `error` in the main participant at its next sleep or prompt; None takes it back."""
        self.interruption = error
        if error is not None and self.ends_prompt is not None:
            self.ends_prompt()

    @abstractmethod
    def stop(self) -> None:
        """End every sleep of threads that were started by `start` with ClockStopped."""
