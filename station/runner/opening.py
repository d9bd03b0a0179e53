"""Open the instruments a plan needs, and prove that each is the one in the bench file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from station import registry
from station.clock import Clock
from station.errors import InputError, InstrumentError, InstrumentsMissing
from station.readings import Publisher, Readings, Value
from station.runner.instrument_locks import InstrumentLocks

if TYPE_CHECKING:
    from station.bench import Bench
    from station.runner.trace import Trace


class Identity(Protocol):
    """Who answered: maker, model, serial number and firmware, as the instrument says them."""

    maker: str
    model: str
    serial: str
    firmware: str


class Opened(Protocol):
    """An instrument with its line open."""

    def identify(self) -> Identity:
        """Ask who is there."""
        ...

    def close(self) -> None:
        """Give the line back."""
        ...


@dataclass(frozen=True)
class Place:
    """Where an instrument is attached and what the bench file says of it; drivers get one."""

    name: str
    address: str
    clock: Clock
    settings: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    asker: Callable[[str, str], str] | None = None
    trace: Callable[[str, bytes], None] | None = None
    publisher: Publisher | None = None

    def publish(self, quantity: str, value: Value, unit: str = "") -> None:
        """Put up a reading for interlocks and panel; nothing happens where nobody looks."""
        if self.publisher is not None:
            self.publisher(quantity, value, unit)

    def ask(self, prompt_id: str, text: str) -> str:
        """Put a request to the operator and return the answer."""
        if self.asker is None:
            raise InputError(f"{self.name}: nobody can be asked here: {text}")
        return self.asker(prompt_id, text)


@dataclass(frozen=True)
class Found:
    """An opened instrument and who it said it is."""

    instrument: Opened
    identity: Identity


@dataclass(frozen=True)
class Probe:
    """Whether an instance of a bench answers, is the right one, and what it said."""

    name: str
    ok: bool
    said: str
    found: Found | None = None

    def to_data(self) -> dict[str, Any]:
        """Return the probe as plain data."""
        identity = vars(self.found.identity) if self.found else None
        return {"instrument": self.name, "ok": self.ok, "said": self.said, "identity": identity}


def open_one(
    name: str,
    bench: Bench,
    addresses: Mapping[str, str],
    clock: Clock,
    asker: Callable[[str, str], str] | None = None,
    trace: Trace | None = None,
    readings: Readings | None = None,
    locks: InstrumentLocks | None = None,
) -> Probe:
    """Open and identify one instance of a bench; an instrument that answered stays open.

    `addresses` replaces those of the bench file (a simulated bench gives its own); what the
    instrument says is published on `readings`; `locks` keep other processes away from it.
    """
    if name not in bench.instruments:
        return Probe(name, False, f"{name}: the bench {bench.name!r} has no such instrument")
    entry = bench.instruments[name]
    address = addresses.get(name, entry.address or "")
    tracer = trace.of(name) if trace else None
    publisher = readings.publisher(name) if readings else None
    place = Place(name, address, clock, entry.settings, entry.limits, asker, tracer, publisher)
    try:
        if locks is not None and address:
            locks.take(name, address)
        instrument: Opened = registry.load(registry.DRIVERS, entry.driver)(place)
    except InstrumentError as error:
        return Probe(name, False, str(error))
    try:
        identity = instrument.identify()
    except InstrumentError as error:
        instrument.close()
        return Probe(name, False, str(error))
    found = Found(instrument, identity)
    if entry.serial and identity.serial != entry.serial:
        return Probe(
            name,
            False,
            f"{name}: serial number {identity.serial} answers at {address}, the bench file says "
            f"{entry.serial}; connect the right instrument or correct the bench file",
            found,
        )
    said = f"{identity.maker} {identity.model} {identity.serial} {identity.firmware}".strip()
    return Probe(name, True, said, found)


def probe(
    name: str,
    bench: Bench,
    addresses: Mapping[str, str],
    clock: Clock,
    locks: InstrumentLocks | None = None,
) -> Probe:
    """Ask one instance of a bench who it is, and close it again."""
    opened = open_one(name, bench, addresses, clock, locks=locks)
    if opened.found is not None:
        opened.found.instrument.close()
    return opened


def open_instruments(
    bench: Bench,
    wanted: Iterable[str],
    addresses: Mapping[str, str],
    clock: Clock,
    asker: Callable[[str, str], str] | None,
    trace: Trace | None = None,
    readings: Readings | None = None,
    locks: InstrumentLocks | None = None,
) -> dict[str, Found]:
    """Open and identify the `wanted` instances of a bench, in the bench file's order.

    Raises InstrumentsMissing that lists every one that is absent or has another serial number;
    what was opened by then is closed again.
    """
    needed = set(wanted)
    ordered = [name for name in bench.instruments if name in needed]
    ordered += sorted(needed - set(bench.instruments))
    probes = [
        open_one(name, bench, addresses, clock, asker, trace, readings, locks) for name in ordered
    ]
    found = {one.name: one.found for one in probes if one.found is not None}
    problems = [one.said for one in probes if not one.ok]
    if problems:
        for one in found.values():
            one.instrument.close()
        raise InstrumentsMissing(problems)
    return found
