"""One simulated instrument in a small world of a test's own, and who talks to it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
import pytest
from sim_bench import Line

from sim_instruments.faults.catalogue import read_fault
from sim_instruments.faults.instrument import InstrumentFaults, Schedule
from sim_instruments.instrument import Setting
from sim_instruments.truth import Truth
from sim_instruments.world.base import Room
from station.clock import Clock, VirtualClock
from station.errors import InstrumentError
from station.instruments.opening import InstrumentPlace
from station.method.verbs import POLL_S
from station.safety.readings import Readings


class EmptyRoom(Room):
    """A world of another procedure, in which there is nothing of what the instrument needs."""


class Fixture:
    """A served instrument and whoever talks to it."""

    def __init__(
        self,
        clock: Clock,
        name: str,
        maker: Callable[[Setting], Any],
        truth: Mapping[str, Any],
        room: Any,
        *entries: Mapping[str, Any],
        serial: str = "0",
    ) -> None:
        self.clock, self.name, self.room = clock, name, room
        self.readings = Readings(clock)
        self.heard: list[tuple[str, bytes]] = []
        rng = np.random.default_rng(1)
        faults = InstrumentFaults(Schedule(clock, room.lock))
        setting = Setting(name, serial, Truth(truth, "simulator"), room, clock, rng, 0, faults)
        self.simulator = maker(setting)
        self.instruments = {name: self.simulator.describe()}
        for entry in entries:
            given = {"instrument": name, **entry}
            protocol = str(self.instruments[name]["protocol"])
            fault = read_fault(
                given, Truth(given, "fault"), protocol, [entry["fault"]], clock.now(), rng
            )
            faults.add(fault[0], at_message=fault[1])

    def place(self, limits: Mapping[str, float] | None = None, **settings: Any) -> InstrumentPlace:
        return InstrumentPlace(
            self.name,
            self.instruments[self.name]["address"],
            self.clock,
            settings,
            limits or {},
            trace=lambda direction, data: self.heard.append((direction, data)),
            publisher=self.readings.publisher(self.name),
        )

    def line(self) -> Line:
        return Line(self, self.name, self.clock)  # type: ignore[arg-type]

    def at_its_front_panel(self, message: str) -> str | None:
        """Do what somebody else does there; on virtual time the line has room for one client."""
        said: str | None = self.simulator.execute(message)
        return said

    def sent(self) -> list[bytes]:
        """Return what went to the instrument."""
        return [data for direction, data in self.heard if direction == ">"]

    def newest(self, quantity: str) -> Any:
        reading = self.readings.newest(self.name, quantity)
        return None if reading is None else reading.value


S = TypeVar("S", bound=Fixture)


@contextmanager
def serving(make: Callable[[Clock], S], clock: Clock | None = None) -> Iterator[S]:
    """Serve what is made while this thread takes part in time."""
    clock = clock or VirtualClock()
    with clock.participant("test"):
        fixture = make(clock)
        try:
            yield fixture
        finally:
            fixture.simulator.close()
            clock.stop()


@contextmanager
def standing(
    name: str,
    maker: Callable[[Setting], Any],
    truth: Mapping[str, Any],
    room: Any,
    *faults: Mapping[str, Any],
    serial: str = "0",
    clock: Clock | None = None,
) -> Iterator[Fixture]:
    """Serve an instrument while this thread takes part in time."""
    with serving(
        lambda clock: Fixture(clock, name, maker, truth, room, *faults, serial=serial), clock
    ) as fixture:
        yield fixture


@contextmanager
def opened(
    name: str,
    maker: Callable[[Setting], Any],
    driver: Callable[[InstrumentPlace], Any],
    truth: Mapping[str, Any],
    room: Any,
    *faults: Mapping[str, Any],
) -> Iterator[tuple[Fixture, Any]]:
    """Serve an instrument and open its driver."""
    with standing(name, maker, truth, room, *faults) as fixture:
        instrument = driver(fixture.place())
        try:
            yield fixture, instrument
        finally:
            instrument.close()


def error_of(act: Callable[..., object], *given: Any) -> str:
    """Return what the error of an instrument states that an act ends in."""
    with pytest.raises(InstrumentError) as raised:
        act(*given)
    return str(raised.value)


def recorded(fixture: Fixture, driver: Any, seconds: float) -> Any:
    """Return the outputs of a while as a block, drained once."""
    fixture.clock.sleep(seconds)
    return driver.drain()


def taken(fixture: Any, source: Any, seconds: float) -> dict[str, np.ndarray]:
    """Return the columns of a source that is drained as an acquisition does."""
    until_s, blocks = fixture.clock.now() + seconds, []
    while fixture.clock.now() < until_s:
        fixture.clock.sleep(POLL_S)
        blocks.append(source.drain().columns)
    return {name: np.concatenate([columns[name] for columns in blocks]) for name in source.columns}
