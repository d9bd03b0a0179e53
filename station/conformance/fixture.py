"""One instrument of a bench under test: its clock, its place, and whatever it opened."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Any

from station import registry
from station.clock import Clock, RealClock, VirtualClock
from station.conformance.faulty_server import moved_to
from station.errors import InputError, StationError
from station.instruments.bench import Bench
from station.instruments.opening import InstrumentPlace
from station.roles.base import MadeSafe
from station.roles.role import role_of
from station.runner.session import simulators_of
from station.safety.safe_state import DEFAULT_WITHIN_S

Message = tuple[float, str, bytes]
"""Run time in s, direction, and the bytes."""


@dataclass
class Fixture:
    """An instrument under test, with what its driver said on the wire and to the operator."""

    bench: Bench
    name: str
    clock: Clock
    address: str
    simulation: Any = None
    addresses: Mapping[str, str] = field(default_factory=dict)
    """Where a simulated bench serves its instruments."""

    heard: list[Message] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    opened: list[Any] = field(default_factory=list)
    strangers: list[Any] = field(default_factory=list)
    """What was opened in the instrument's place: it is closed, and nothing else is asked of it."""

    @property
    def role(self) -> str:
        """The role that the instrument has on its bench."""
        return role_of(self.name)

    @property
    def limits(self) -> Mapping[str, float]:
        """The bench's limits of the instrument."""
        return self.bench.instruments[self.name].limits

    @property
    def driver(self) -> Any:
        """The driver under test, a class."""
        return registry.load(registry.DRIVERS, self.bench.instruments[self.name].driver)

    @property
    def within_s(self) -> float:
        """Run time that the bench gives the instrument to come to rest, s."""
        for wanted, within_s in self.bench.safe_order():
            if wanted in (self.name, self.role):
                return within_s
        return DEFAULT_WITHIN_S

    def open(self, *, port: int | None = None, limits: Mapping[str, float] | None = None) -> Any:
        """Return the driver with its line open, at the bench's address or a port of this computer.

        Raises InputError where the kind of address leads to no port.
        """
        address: str | None = self.address
        if port is not None:
            address = moved_to(self.address, port)
        if address is None:
            raise InputError(f"{self.address!r} leads to no port of this computer")
        limits = self.limits if limits is None else limits
        entry = self.bench.instruments[self.name]
        place = self._place(self.name, address, limits)
        instrument = self.driver(
            replace(place, shared={share: self._whole(share) for share in entry.shares})
        )
        (self.opened if port is None else self.strangers).append(instrument)
        return instrument

    def stray(self, where: str, text: str, nth: int = 1) -> bool:
        """Have a line that nobody asked for come at the n-th message from now on, once.

        `where`: `ahead` of the reply, `before` or `behind` it in one piece, or `after` it. False
        where the instrument is not simulated by a bench that can do so.
        """
        return self._inject(fault="stray-line", where=where, text=text, nth=nth)

    def silence(self) -> bool:
        """Have no answer come from now on; False where nobody can do so."""
        return self._inject(**{"fault": "no-reply", "for": "1 h"})

    def energised(self) -> bool | None:
        """Whether the simulated instrument is energised, as it says itself; None: it does not."""
        report = getattr(self.simulation, "simulation_report", None)
        said: bool | None = None if report is None else report()["outputs"].get(self.name)
        return said

    def _inject(self, **fault: Any) -> bool:
        inject = getattr(self.simulation, "inject", None)
        if inject is None:
            return False
        try:
            inject({"instrument": self.name, **fault})
        except Exception as error:  # the simulator's own, which is no class of the station
            if "cannot have the fault" in str(error) or "no simulated instrument" in str(error):
                return False
            raise
        return True

    def close(self) -> None:
        """Bring whatever may be energised to rest, and give every line back."""
        for instrument in self.opened:
            with suppress(StationError, OSError):
                if isinstance(instrument, MadeSafe):
                    instrument.make_safe(self.clock.now() + self.within_s)
        for instrument in (*self.opened, *self.strangers):
            with suppress(Exception):  # a driver that cannot be closed fails a test of its own
                instrument.close()

    def _place(self, name: str, address: str, limits: Mapping[str, float]) -> InstrumentPlace:
        settings = self.bench.instruments[name].settings
        return InstrumentPlace(name, address, self.clock, settings, limits, self._ask, self._hear)

    def _whole(self, name: str) -> Any:
        """Return another instrument of the bench, opened because the line under test is its own."""
        entry = self.bench.instruments[name]
        address = self.addresses.get(name, entry.address or "")
        driver = registry.load(registry.DRIVERS, entry.driver)
        instrument = driver(self._place(name, address, entry.limits))
        self.opened.append(instrument)
        return instrument

    def _ask(self, prompt_id: str, text: str, at_the_end: bool) -> str:
        self.asked.append(prompt_id)
        return str(self.simulation.act(prompt_id)) if self.simulation else "done"

    def _hear(self, direction: str, data: bytes) -> None:
        self.heard.append((self.clock.now(), direction, data))


@contextmanager
def fixture_of(bench: Bench, name: str, procedure: str) -> Iterator[Fixture]:
    """Put one instrument of a bench on the stand, simulated on virtual time where the bench is."""
    clock: Clock = RealClock() if bench.simulation is None else VirtualClock()
    simulation = None
    address = bench.instruments[name].address or ""
    addresses: dict[str, str] = {}
    if bench.simulation is not None:
        simulator = registry.load(registry.SIMULATORS, registry.SIMULATED_BENCH)
        # What the bench has besides stays away: each test would set it up anew.
        drivers = [
            bench.instruments[opened].driver for opened in (name, *bench.instruments[name].shares)
        ]
        simulation = simulator(bench.data, clock, procedure, simulators_of(drivers))
        addresses = {
            instrument: str(at["address"]) for instrument, at in simulation.instruments.items()
        }
        address = addresses.get(name, address)
    if bench.instruments[name].shares:
        address = ""  # the line is another instrument's
    try:
        with clock.participant("conformance"):
            if simulation is not None:
                simulation.make_ready()
            fixture = Fixture(bench, name, clock, address, simulation, addresses)
            try:
                yield fixture
            finally:
                fixture.close()
    finally:
        if simulation is not None:
            simulation.close()
        clock.stop()
