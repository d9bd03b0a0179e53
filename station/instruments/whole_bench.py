"""Read everything on the bench that can harm, also what a plan does not use, and command nothing.

What a run uses is read over its open lines. What it does not use is taken by its lock, opened,
asked who it is and how it stands, and closed again. No driver commands anything while it is opened
or read.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from station import registry
from station.clock import Clock, RealClock
from station.errors import Aborted, BenchEnergised, InstrumentError, InstrumentInUse, reason_of
from station.instruments.beside import Beside
from station.instruments.instrument_locks import InstrumentLocks
from station.instruments.opening import LOOK, Identified, open_one, take_lock
from station.roles.base import MadeSafe
from station.roles.role import energised_states
from station.safety.safe_state import Hurried, SafeOutcome, can_harm

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.instruments.trace import Trace

WITHIN_S = 10.0
"""Real time for all of them together; a dead address costs its connect deadline, 2 s."""
SILENT = "does not answer"
IN_USE = "in use by "


@dataclass(frozen=True)
class LeftOut:
    """An instrument that can harm and was not read: why in a few words, and all that is known."""

    instrument: str
    why: str
    said: str

    def to_data(self) -> dict[str, str]:
        """Return it as plain data."""
        return {"instrument": self.instrument, "why": self.why, "said": self.said}


@dataclass(frozen=True)
class BenchReading:
    """How the instruments that can harm stand: the run's, those outside it, those left out."""

    used: Sequence[SafeOutcome] = ()
    outside: Sequence[SafeOutcome] = ()
    left_out: Sequence[LeftOut] = ()

    @property
    def energised(self) -> list[SafeOutcome]:
        """What the run does not use and is not at rest."""
        return [reading for reading in self.outside if not reading.verified]

    def refuse_energised(self) -> None:
        """Raise BenchEnergised that names every instrument outside the plan that is energised."""
        if self.energised:
            raise BenchEnergised(
                [
                    f"{reading.instrument}, which this plan does not use: {reading.read_back}"
                    for reading in self.energised
                ]
            )

    def to_data(self) -> dict[str, Any]:
        """Return the reading as plain data; whoever looks for what is unsafe reads `outcomes`."""
        return {
            "outcomes": [reading.to_data() for reading in (*self.used, *self.energised)],
            "outside": [reading.to_data() for reading in self.outside],
            "left_out": [left.to_data() for left in self.left_out],
        }


def read_used(instruments: Mapping[str, object], clock: Clock) -> list[SafeOutcome]:
    """Read whether the run's instruments that can harm are energised or move; nothing is refused.

    The steps bring them to rest before they use them, and the end of the run proves that they are.
    Raises InstrumentError.
    """
    outcomes = []
    for name, instrument in instruments.items():
        if isinstance(instrument, MadeSafe):
            began_s = clock.now()
            rests, sentence = state_of(name, instrument)
            outcomes.append(SafeOutcome(name, rests, sentence, clock.now() - began_s))
    return outcomes


def state_of(name: str, instrument: MadeSafe) -> tuple[bool, str]:
    """Return whether an open instrument is at rest, and in words how it stands.

    By its output and its motion, as interlocks look at them; by its whole rest where it has none.
    """
    read = getattr(instrument, "read_quantity", None)
    states = dict(sorted(energised_states(name).items()))
    if read is None or not states:
        reading = instrument.read_safety()
        return reading.safe, reading.read_back
    words = {quantity: str(read(quantity)) for quantity in states}
    rests = all(words[quantity] != state for quantity, state in states.items())
    return rests, ", ".join(f"{quantity} {word}" for quantity, word in words.items())


def bystanders_of(bench: Bench, used: Collection[str]) -> list[str]:
    """Return the instruments of a bench that can harm and are not among those `used`.

    What is reached over another's line has no rest of its own.
    """
    return [
        name
        for name, entry in bench.instruments.items()
        if name not in used and not entry.shares and _may_harm(entry.driver)
    ]


def _may_harm(driver: str) -> bool:
    try:
        return can_harm(registry.load(registry.DRIVERS, driver))
    except Exception:  # a driver that cannot be loaded: reading it says so by name
        return True


@dataclass
class UnusedInstruments:
    """The instruments of a bench outside a run, and how they are read.

    `holder` is the name under which other processes see who reads; `own` are the locks that this
    process has already, None on a bench that is simulated in it, where nothing is locked.
    """

    bench: Bench
    addresses: Mapping[str, str]
    clock: Clock
    holder: str
    own: InstrumentLocks | None = None
    trace: Trace | None = None

    def __post_init__(self) -> None:
        self._beside: Beside[SafeOutcome | LeftOut | None] = Beside(self._read_one, keeps=False)

    def read(
        self,
        used: Collection[str],
        waiting: Clock | None = None,
        only: Sequence[str] | None = None,
    ) -> BenchReading:
        """Read every instrument that can harm and is not `used`; never raises for one of them.

        On a real clock all are read at once, and what has not answered after 10 s is left out.
        `waiting` is the clock whose interruptions end this early; without it nothing does. `only`
        these are read where it is given.
        """
        names = bystanders_of(self.bench, used) if only is None else only
        if isinstance(self.clock, RealClock):
            by_address: dict[str, list[str]] = {}
            for name in names:
                by_address.setdefault(self._address(name).strip().lower(), []).append(name)
            readings = self._beside.do(list(by_address.values()), WITHIN_S, partial(wait, waiting))
        else:  # one participant at a time: this one
            readings = {name: self._read_one(name) for name in names}
        read, left_out = [], []
        for name in names:
            reading = readings.get(name)
            if isinstance(reading, SafeOutcome):
                read.append(reading)
            elif isinstance(reading, LeftOut):
                left_out.append(reading)
            elif name not in readings:
                sentence = f"{name}: it did not answer within {WITHIN_S:g} s"
                left_out.append(LeftOut(name, SILENT, sentence))
        return BenchReading(outside=read, left_out=left_out)

    def _address(self, name: str) -> str:
        return self.addresses.get(name, self.bench.instruments[name].address or "")

    def _read_one(self, name: str) -> SafeOutcome | LeftOut | None:
        """Lock, open, identify, read, close; None where it cannot harm after all."""
        while True:
            try:
                return self._read_or_raise(name)
            except Aborted:
                raise
            except Hurried:  # comes once; a reading is short, and is not left out
                continue
            except InstrumentError as error:
                return LeftOut(name, why_left_out(error), str(error))
            except Exception as error:  # a fault of one driver keeps no other from being read
                return LeftOut(name, "cannot be read", f"{name}: {reason_of(error)}")

    def _read_or_raise(self, name: str) -> SafeOutcome | LeftOut | None:
        began_s = self.clock.now()
        address = self._address(name)
        locks = None
        if self.own is not None and address and not self.own.holds(address):
            locks = InstrumentLocks(f"{LOOK} by {self.holder}", self.own.world)
        try:
            if locks is not None:
                take_lock(locks, name, address)
            probe = open_one(name, self.bench, self.addresses, self.clock, trace=self.trace)
            if probe.identified is None:
                return LeftOut(name, SILENT, probe.said)
            try:
                return self._read_found(name, probe.identified, probe.ok, probe.said, began_s)
            finally:
                with suppress(Exception):
                    probe.identified.instrument.close()
        finally:
            if locks is not None:
                locks.release()

    def _read_found(
        self, name: str, identified: Identified, ok: bool, said: str, began_s: float
    ) -> SafeOutcome | LeftOut | None:
        instrument = identified.instrument
        if not isinstance(instrument, MadeSafe):
            return None
        read_s = self.clock.now()  # one that answers late may have stood so when it was asked
        reading = instrument.read_safety()
        rests = reading.safe or getattr(reading, "dormant", False)
        if rests and not ok:
            return LeftOut(name, "another serial number answers", said)
        took_s = self.clock.now() - began_s
        return SafeOutcome(name, rests, reading.read_back, took_s, used=False, read_s=read_s)


def wait(clock: Clock | None) -> None:
    """Give a clock a sign of life and raise what interrupts it; a wish to hurry ends nothing."""
    if clock is not None:
        with suppress(Hurried):
            clock.sleep(0.0)


def why_left_out(error: InstrumentError) -> str:
    """Return in a few words why an instrument could not be read."""
    if not isinstance(error, InstrumentInUse):
        return SILENT
    return f"{IN_USE}{error.who or 'another process'}"
