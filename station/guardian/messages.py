"""What a run and its guardians say to one another: one JSON object a line.

A word that a process does not know is passed over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

BEAT = "beat"
"""A sign of life, in every direction."""
WATCH = "watch"
"""From the run, with `instruments`: these are to be made safe from now on."""
LOCKS = "locks"
"""From the run, with the names of locks in `keys` and the locked files: hold them, too."""
PEER = "peer"
"""From the run, with a socket and the `pid` at its other end: the other guardian."""
HAND_OVER = "hand-over"
"""From the run, with `why`: it has let go of the instruments, not all of which are safe."""
DISMISS = "dismiss"
"""From the run: it has made the bench safe itself."""
WAITS = "waits"
"""From one guardian to the other: it goes on trying, and has told the operator so."""
DONE = "done"
"""From one guardian to the other: nothing is left to be done."""
BEATS_EVERY_S = 1.0
LOOKS_EVERY_S = 0.25
SILENT_FOR_S = 5.0


@dataclass(frozen=True)
class Instructions:
    """The first line: everything that a guardian needs when nobody can be asked any more.

    `bench` is the path of the resolved bench file, `instruments` are those whose drivers must be
    ready, `addresses` replace those of the bench file; `speed` and `epoch_unix` are the run's time.
    The guardian of rank 0 acts first, that of rank 1 when the first is gone or stands still.
    `world` sets the instruments of a simulated bench apart from others that report the same.
    """

    folder: str
    bench: str
    instruments: Sequence[str]
    addresses: Mapping[str, str]
    runner_pid: int
    speed: float
    epoch_unix: float
    rank: int = 0
    world: str = ""

    def to_data(self) -> dict[str, Any]:
        """Return the instructions as plain data."""
        return asdict(self)


def said(what: str, **details: Any) -> dict[str, Any]:
    """Return a message."""
    return {"say": what, **details}


class Silence:
    """For how long somebody has said nothing.

    Looks are counted, not seconds: whoever stood still itself, or slept with the whole computer,
    has missed nothing that does not wait to be read.
    """

    def __init__(self) -> None:
        self._looks = 0

    @property
    def seconds(self) -> float:
        """Real time in s."""
        return self._looks * LOOKS_EVERY_S

    def heard(self) -> None:
        """Begin anew."""
        self._looks = 0

    def look(self) -> None:
        """Count a look, none sooner than `LOOKS_EVERY_S` after the one before."""
        self._looks += 1


class Looks:
    """When the next look is due; one that is late is not made up for."""

    def __init__(self) -> None:
        from station.clock import boot_seconds

        self._now = boot_seconds
        self._last_s = boot_seconds()

    def due(self) -> bool:
        """Whether `LOOKS_EVERY_S` have passed since the last look; this is then the next."""
        if self._now() - self._last_s < LOOKS_EVERY_S:
            return False
        self._last_s = self._now()
        return True
