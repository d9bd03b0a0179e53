"""Open the instruments a plan needs, and prove that each is the one in the bench file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import methodcaller
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol

from station import registry
from station.clock import Clock, RealClock
from station.errors import InputError, InstrumentError, InstrumentInUse, InstrumentsMissing
from station.instruments.instrument_locks import Identity, InstrumentLocks
from station.roles.base import EXCHANGE_DEADLINE_S, Driver, Exchanges
from station.safety.readings import Publisher, Readings, Value

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.instruments.trace import Trace


Asker = Callable[[str, str, bool], str]
"""Puts a request of an id and a text to the operator, at the end of the run where that is True."""
LOOK = "a look at the whole bench"
"""What the holder of a lock begins with that will be given back in a moment."""
LOOK_ENDS_WITHIN_S = 10.0
BETWEEN_TRIES_S = 0.1


class Opened(Protocol):
    """An instrument with its line open."""

    def identify(self) -> Identity:
        """Ask who is there."""
        ...

    def close(self) -> None:
        """Give the line back."""
        ...


@dataclass(frozen=True)
class InstrumentPlace:
    """Where an instrument is attached and what the bench file says of it; drivers get one."""

    name: str
    address: str
    clock: Clock
    settings: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    asker: Asker | None = None
    trace: Callable[[str, bytes], None] | None = None
    publisher: Publisher | None = None
    shared: Mapping[str, Opened] = field(default_factory=dict)
    """The instruments over whose lines this one is reached, opened, by name."""

    noter: Callable[[str, Mapping[str, Any]], None] | None = None
    exchanges: Exchanges = field(default_factory=Exchanges)

    def note(self, kind: str, **details: Any) -> None:
        """Have an event written to the run's log; nothing happens where there is no run."""
        if self.noter is not None:
            self.noter(kind, details)

    def publish(self, quantity: str, value: Value, unit: str = "") -> None:
        """Put up a reading for interlocks and panel; nothing happens where nobody looks."""
        if self.publisher is not None:
            self.publisher(quantity, value, unit)

    def ask(self, prompt_id: str, text: str) -> str:
        """Put a request to the operator and return the answer."""
        return self._put(prompt_id, text, False)

    def ask_at_the_end(self, prompt_id: str, text: str) -> None:
        """Put a request that no step waits for; a person is asked once the results are written."""
        self._put(prompt_id, text, True)

    def _put(self, prompt_id: str, text: str, at_the_end: bool) -> str:
        if self.asker is None:
            raise InputError(f"{self.name}: no operator can be asked: {text}")
        return self.asker(prompt_id, text, at_the_end)


@dataclass(frozen=True)
class Identified:
    """An opened instrument and who it said it is."""

    instrument: Opened
    identity: Identity


@dataclass(frozen=True)
class Probe:
    """Whether an instance of a bench answers, is the right one, and what it said."""

    name: str
    ok: bool
    said: str
    identified: Identified | None = None
    in_use_by: str | None = None
    """What another process that has it says of itself."""

    def to_data(self) -> dict[str, Any]:
        """Return the probe as plain data."""
        identity = vars(self.identified.identity) if self.identified else None
        return {"instrument": self.name, "ok": self.ok, "said": self.said, "identity": identity}


def open_one(
    name: str,
    bench: Bench,
    addresses: Mapping[str, str],
    clock: Clock,
    asker: Asker | None = None,
    trace: Trace | None = None,
    readings: Readings | None = None,
    locks: InstrumentLocks | None = None,
    opened: Mapping[str, Opened] = MappingProxyType({}),
    identify: Callable[[Opened], Identity] = methodcaller("identify"),
) -> Probe:
    """Open and identify one instance of a bench; an instrument that answered stays open.

    `addresses` replaces those of the bench file (a simulated bench gives its own); what the
    instrument says is published on `readings`; `locks` keep other processes away from it;
    `opened` are those whose lines it may share; `identify` asks who is there.
    """
    if name not in bench.instruments:
        return Probe(name, False, f"{name}: the bench {bench.name!r} has no such instrument")
    entry = bench.instruments[name]
    silent = [share for share in entry.shares if share not in opened]
    if silent:
        what = f"it is reached over {' and '.join(silent)}, which could not be opened"
        return Probe(name, False, f"{name}: {what}")
    address = addresses.get(name, entry.address or "")
    tracer = trace.of(name, address) if trace else None
    publisher = readings.publisher(name) if readings else None
    place = InstrumentPlace(
        name,
        address,
        clock,
        entry.settings,
        entry.limits,
        asker,
        tracer,
        publisher,
        {share: opened[share] for share in entry.shares},
        readings.noter(name) if readings else None,
    )
    try:
        if locks is not None and address:
            take_lock(locks, name, address)
        driver = registry.load(registry.DRIVERS, entry.driver)
        stated_s = getattr(driver, "deadline_s", EXCHANGE_DEADLINE_S)
        place.exchanges.deadline_s = max(stated_s, entry.deadline_s or 0.0)
        instrument: Opened = driver(place)
    except InstrumentError as error:
        return Probe(name, False, str(error), in_use_by=getattr(error, "who", None))
    try:
        identity = identify(instrument)
    except InstrumentError as error:
        instrument.close()
        return Probe(name, False, str(error))
    identified = Identified(instrument, identity)
    if entry.serial and identity.serial != entry.serial:
        return Probe(
            name,
            False,
            f"{name}: serial number {identity.serial} answers at {address}, the bench file states "
            f"{entry.serial}; connect the right instrument or correct the bench file",
            identified,
        )
    if locks is not None:
        try:
            locks.take_identity(name, identity)
        except InstrumentError as error:  # reached another way, it is in use
            instrument.close()
            return Probe(name, False, str(error), in_use_by=getattr(error, "who", None))
    answer = f"{identity.maker} {identity.model} {identity.serial} {identity.firmware}".strip()
    return Probe(name, True, answer, identified)


def take_lock(locks: InstrumentLocks, name: str, address: str) -> None:
    """Take an instrument's lock; another run's look at the whole bench is waited for.

    Raises InstrumentError where another process has it.
    """
    real = RealClock()
    while True:
        try:
            return locks.take(name, address)
        except InstrumentInUse as error:
            if not error.who.startswith(LOOK) or real.now() > LOOK_ENDS_WITHIN_S:
                raise
            real.sleep(BETWEEN_TRIES_S)


def with_shared(bench: Bench, wanted: Iterable[str]) -> list[str]:
    """Return the `wanted` instances and those whose lines they share, in the order to open them.

    That of the bench file, but what is shared comes first.
    """
    entries = bench.instruments
    needed = set(wanted)
    needed |= {share for name in needed if name in entries for share in entries[name].shares}
    ordered = [name for name in entries if name in needed]
    ordered.sort(key=lambda name: bool(entries[name].shares))
    return ordered + sorted(needed - set(entries))


def open_in_order(
    names: Iterable[str], open_it: Callable[[str, Mapping[str, Opened]], Probe]
) -> list[Probe]:
    """Open instances one after the other, each with those that answered before it."""
    opened: dict[str, Opened] = {}
    probes = []
    for name in names:
        answer = open_it(name, opened)
        probes.append(answer)
        if answer.ok and answer.identified is not None:
            opened[name] = answer.identified.instrument
    return probes


def probe(
    name: str,
    bench: Bench,
    addresses: Mapping[str, str],
    clock: Clock,
    locks: InstrumentLocks | None = None,
) -> Probe:
    """Ask one instance of a bench who it is, and close it again."""
    probes = open_in_order(
        with_shared(bench, [name]),
        lambda part, opened: open_one(part, bench, addresses, clock, locks=locks, opened=opened),
    )
    for answer in reversed(probes):
        if answer.identified is not None:
            answer.identified.instrument.close()
    return probes[-1]


def open_instruments(
    bench: Bench,
    wanted: Iterable[str],
    addresses: Mapping[str, str],
    clock: Clock,
    asker: Asker | None,
    trace: Trace | None = None,
    readings: Readings | None = None,
    locks: InstrumentLocks | None = None,
) -> dict[str, Identified]:
    """Open and identify the `wanted` instances of a bench, and those whose lines they share.

    Raises InstrumentsMissing that lists every one that is absent or has another serial number;
    what was opened by then is closed again.
    """
    probes = open_in_order(
        with_shared(bench, wanted),
        lambda name, opened: open_one(
            name, bench, addresses, clock, asker, trace, readings, locks, opened
        ),
    )
    probes = explained(bench, probes)
    identified = {probe.name: probe.identified for probe in probes if probe.identified is not None}
    wrong = [probe for probe in probes if not probe.ok]
    if wrong:
        for answer in reversed(identified.values()):
            answer.instrument.close()
        raise InstrumentsMissing(problems_of(wrong), len(wrong))
    return identified


def explained(bench: Bench, probes: Sequence[Probe]) -> list[Probe]:
    """Return the probes; what answers with another entry's serial number names that entry."""
    serials = {name: entry.serial for name, entry in bench.instruments.items() if entry.serial}
    owners = {serial: name for name, serial in serials.items()}
    answered = {
        probe.name: probe.identified.identity.serial
        for probe in probes
        if probe.identified is not None
    }
    return [
        replace(probe, said=probe.said + hint(probe, owners, serials, answered)) for probe in probes
    ]


def hint(
    probe: Probe, owners: dict[str, str], serials: dict[str, str], answered: dict[str, str]
) -> str:
    """Return what the serial number that answered says of the cables; empty where nothing."""
    serial = answered.get(probe.name)
    owner = owners.get(serial or "")
    if probe.ok or owner is None or owner == probe.name:
        return ""
    if answered.get(owner) == serial:
        return f"; {owner} answers with it, too: the addresses of both lead to one instrument"
    if answered.get(owner) == serials.get(probe.name):
        return f"; it is that of {owner}, which answers with this one's: the two are exchanged"
    return f"; it is that of {owner}"


def put_settings_back(instruments: Iterable[object]) -> None:
    """Leave what instruments keep as it was met; drivers note what stays. Never raises."""
    for instrument in instruments:
        if isinstance(instrument, Driver):
            instrument.kept.put_back()


def problems_of(wrong: Iterable[Probe]) -> list[str]:
    """Return what is wrong with instruments; who has several of them is named once."""
    together: dict[str, list[Probe]] = {}
    for answer in wrong:
        together.setdefault(answer.in_use_by or answer.name, []).append(answer)
    return [
        f"{', '.join(probe.name for probe in probes)}: another process has them ({who}); wait "
        "until that has ended, or end it with `station abort RUN`"
        if len(probes) > 1
        else probes[0].said
        for who, probes in together.items()
    ]
