"""Signs of life that threads give by themselves, and who has given none for too long."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock

MAX_BETWEEN_LOOKS_S = 1.0
"""A look counts no more than this: a process that was stopped for a while has missed no beat."""


class Pulse:
    """The sign of life of one thread; a context that ends with the thread's work.

    The clock beats it whenever the thread asks for the time or sleeps.
    """

    __slots__ = ("beats", "ended", "expected", "longest_silence_s", "name")

    def __init__(self, name: str, longest_silence_s: float) -> None:
        self.name = name
        self.longest_silence_s = longest_silence_s
        """Real time."""
        self.beats = 0
        self.ended = False
        self.expected = (-1, 0.0)
        """After which beat a longer silence was declared, and how long."""

    def beat(self) -> None:
        """Give a sign of life."""
        self.beats += 1

    @contextmanager
    def allow(self, seconds: float) -> Iterator[None]:
        """Declare that until exit each sign may take up to `seconds` of real time to come."""
        before = self.longest_silence_s
        self.beats += 1
        self.longest_silence_s = max(before, seconds)
        try:
            yield
        finally:
            self.beats += 1
            self.longest_silence_s = before

    def expect(self, seconds: float) -> None:
        """Declare that the very next sign may take up to `seconds` of real time to come."""
        self.beats += 1
        self.expected = (self.beats, seconds)

    def silence_allowed_s(self) -> float:
        """Return how long the present silence may last, real time in s."""
        after, seconds = self.expected
        return max(self.longest_silence_s, seconds if after == self.beats else 0.0)

    def end(self) -> None:
        """From now on no sign is expected any more."""
        self.ended = True

    def __enter__(self) -> Pulse:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


@dataclass(frozen=True)
class Quiet:
    """A thread that has given no sign of life for longer than it may; real time in s."""

    name: str
    for_s: float

    def __str__(self) -> str:
        return f"{self.name} did not respond for {self.for_s:.0f} s"


class Pulses:
    """All pulses of a run, as a thread that looks at them now and again sees them."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._seen: dict[Pulse, tuple[int, float]] = {}
        """The beats at the last look, and how long they have been the same, by pulse."""
        self._looked_s = 0.0

    def add(self, pulse: Pulse) -> None:
        """Expect signs of life from now on."""
        with self._lock:
            self._seen[pulse] = (-1, 0.0)

    def look(self, now_s: float) -> tuple[Quiet, ...]:
        """Return who has been silent for longer than it may at real time `now_s`."""
        with self._lock:
            passed_s = min(now_s - self._looked_s, MAX_BETWEEN_LOOKS_S)
            self._looked_s = now_s
            for pulse, (beats, silent_s) in list(self._seen.items()):
                if pulse.ended:
                    del self._seen[pulse]
                elif pulse.beats != beats:
                    self._seen[pulse] = (pulse.beats, 0.0)
                else:
                    self._seen[pulse] = (beats, silent_s + passed_s)
            return tuple(
                Quiet(pulse.name, silent_s)
                for pulse, (_, silent_s) in self._seen.items()
                if silent_s > pulse.silence_allowed_s()
            )
