"""The safe state of a bench: ordered, bounded, and verified by reading back."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from station.clock import Clock
from station.roles.base import MadeSafe

Result = TypeVar("Result")
DEFAULT_WITHIN_S = 60.0
HURRIED_WITHIN_S = 5.0
ATTEMPTS = 2


class Hurried(Exception):
    """A person asked a second time to end the run while an instrument was brought to rest."""


class Hurry:
    """The wish that a bench come to rest faster: waits become shorter, nothing is left out."""

    def __init__(self, clock: Clock) -> None:
        self.asked = False
        self._clock = clock

    def ask(self) -> None:
        """End the wait under way, once, and shorten those that follow."""
        if not self.asked:
            self.asked = True
            self._clock.interrupt(Hurried())


def unhurried(act: Callable[[], Result]) -> Result:
    """Do something short to its end, though somebody is in a hurry: that is said once."""
    while True:
        try:
            return act()
        except Hurried:
            continue


def can_harm(driver: object) -> bool:
    """Whether a driver is of an instrument that can harm; a factory may be, until it is opened."""
    return not isinstance(driver, type) or issubclass(driver, MadeSafe)


def not_off(instruments: Mapping[str, object]) -> str:
    """Return which opened instruments that can harm read back as not safe, empty where none does.

    Raises InstrumentError where one does not answer.
    """
    read = [
        (n, instrument.read_safety())
        for n, instrument in instruments.items()
        if isinstance(instrument, MadeSafe)
    ]
    return "; ".join(f"{name}: {reading.read_back}" for name, reading in read if not reading.safe)


@dataclass(frozen=True)
class SafeOutcome:
    """How one instrument came to rest: verified or not, what it read back, and the time it took.

    `skipped` says which wait was cut short because a person was in a hurry; `used` is False for an
    instrument outside the plan, which was read and never commanded. `read_s` is the run time of the
    reading. `doubted`: it reads back as safe itself, and a witness contradicts it.
    """

    instrument: str
    verified: bool
    read_back: str
    took_s: float
    skipped: str = ""
    used: bool = True
    read_s: float = math.nan
    doubted: bool = False

    def to_data(self) -> dict[str, Any]:
        """Return the outcome as plain data."""
        return {
            "instrument": self.instrument,
            "verified": self.verified,
            "read_back": self.read_back,
            "took_s": round(self.took_s, 6),
            **({"skipped": self.skipped} if self.skipped else {}),
            **({} if self.used else {"used": False}),
            **({"doubted": True} if self.doubted else {}),
        }


def make_bench_safe(
    instruments: Mapping[str, object],
    order: Sequence[tuple[str, float]],
    clock: Clock,
    hurry: Hurry | None = None,
) -> list[SafeOutcome]:
    """Bring every opened instrument that can harm to rest, in the bench's order, and verify each.

    `order` holds (instance or role, seconds allowed); what it does not name comes last. One
    instrument that fails never keeps another from being made safe. `hurry` shortens the waits.
    """
    outcomes: list[SafeOutcome] = []
    done: set[str] = set()
    for wanted, within_s in [*order, ("", DEFAULT_WITHIN_S)]:
        for name, instrument in instruments.items():
            named = wanted in (name, name.split(".")[0], "")
            if named and name not in done and isinstance(instrument, MadeSafe):
                done.add(name)
                outcomes.append(
                    _make_one_safe(name, instrument, within_s, clock, hurry or Hurry(clock))
                )
    return outcomes


def _make_one_safe(
    name: str, instrument: MadeSafe, within_s: float, clock: Clock, hurry: Hurry
) -> SafeOutcome:
    began_s = clock.now()
    sentence, skipped = "nothing was read back", ""
    attempts = ATTEMPTS
    while attempts:
        attempts -= 1
        allowed_s = within_s
        if hurry.asked and within_s > HURRIED_WITHIN_S:
            allowed_s = HURRIED_WITHIN_S
            skipped = f"it was given {allowed_s:g} s to come to rest instead of {within_s:g} s"
        try:
            instrument.make_safe(clock.now() + allowed_s)
            reading = instrument.read_safety()
            safe, sentence = reading.safe, reading.read_back
        except Hurried:  # comes once: the same again, with less time to wait
            attempts += 1
            continue
        except Exception as error:  # whatever it is, the next instrument must still be made safe
            sentence = str(error)
            continue
        if safe:
            now_s = clock.now()
            return SafeOutcome(name, True, sentence, now_s - began_s, skipped, read_s=now_s)
    return SafeOutcome(name, False, sentence, clock.now() - began_s, skipped)
