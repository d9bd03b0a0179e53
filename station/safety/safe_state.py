"""The safe state of a bench: ordered, bounded, and verified by reading back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from station.clock import Clock

DEFAULT_WITHIN_S = 60.0
ATTEMPTS = 2


class SafetyReading(Protocol):
    """What an instrument reads back of its safe state."""

    @property
    def safe(self) -> bool:
        """Whether it is at rest."""
        ...

    @property
    def read_back(self) -> str:
        """What it said, for a person."""
        ...


@runtime_checkable
class MadeSafe(Protocol):
    """An instrument that can harm, and how it is brought to rest."""

    def make_safe(self, deadline_s: float) -> None:
        """Bring the instrument to rest before run time `deadline_s`."""
        ...

    def read_safety(self) -> SafetyReading:
        """Read back whether it is at rest."""
        ...


@dataclass(frozen=True)
class SafeOutcome:
    """How one instrument came to rest: verified or not, what it read back, and the time it took."""

    instrument: str
    verified: bool
    read_back: str
    took_s: float

    def to_data(self) -> dict[str, Any]:
        """Return the outcome as plain data."""
        return {
            "instrument": self.instrument,
            "verified": self.verified,
            "read_back": self.read_back,
            "took_s": round(self.took_s, 6),
        }


def make_bench_safe(
    instruments: Mapping[str, object], order: Sequence[tuple[str, float]], clock: Clock
) -> list[SafeOutcome]:
    """Bring every opened instrument that can harm to rest, in the bench's order, and verify each.

    `order` holds (instance or role, seconds allowed); what it does not name comes last. One
    instrument that fails never keeps another from being made safe.
    """
    outcomes: list[SafeOutcome] = []
    done: set[str] = set()
    for wanted, within_s in [*order, ("", DEFAULT_WITHIN_S)]:
        for name, instrument in instruments.items():
            named = wanted in (name, name.split(".")[0], "")
            if named and name not in done and isinstance(instrument, MadeSafe):
                done.add(name)
                outcomes.append(_make_one_safe(name, instrument, within_s, clock))
    return outcomes


def _make_one_safe(name: str, instrument: MadeSafe, within_s: float, clock: Clock) -> SafeOutcome:
    began_s = clock.now()
    said = "nothing was read back"
    for _ in range(ATTEMPTS):
        try:
            instrument.make_safe(began_s + within_s)
            reading = instrument.read_safety()
        except Exception as error:  # whatever it is, the next instrument must still be made safe
            said = str(error)
            continue
        said = reading.read_back
        if reading.safe:
            return SafeOutcome(name, True, said, clock.now() - began_s)
    return SafeOutcome(name, False, said, clock.now() - began_s)
