"""A small world with a thermal chamber in it, and a Watlow controller that stands there."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
from fixture import Fixture as AnyFixture
from fixture import serving
from sim_bench import Line

from drivers.watlow.f4 import WatlowF4
from drivers.watlow.f4t import WatlowF4T
from sim_instruments.truth import Truth
from sim_instruments.watlow.f4 import WatlowF4 as F4Simulator
from sim_instruments.watlow.f4t import WatlowF4T as F4TSimulator
from sim_instruments.watlow.plant import ROOM
from sim_instruments.world import base as world
from sim_instruments.world.chamber import Chamber
from station.clock import Clock
from station.instruments.opening import InstrumentPlace

NAME = "thermal_chamber"
LIMITS = {"temperature_low": -45.0, "temperature_high": 70.0}
SERIALS = {"f4t": "10423177", "f4": "208417"}
PLANT = {
    "steers": "chamber",
    "sensor_error": "0.08 K",
    "noise": "0.01 K",
    "set_point_low": "-70 degC",
    "set_point_high": "180 degC",
}
F4T: dict[str, Any] = {
    **PLANT,
    "word_order": "low-first",
    "alarms": 4,
    "limit_modules": [5],
    "outputs": {"2.1": "dut_power", "2.3": "spare"},
    "inputs": {"2.2": "door"},
    "events": {1: "2.3"},
}
F4: dict[str, Any] = {**PLANT, "chamber_event": 0}
SETTINGS: dict[str, dict[str, Any]] = {"f4t": {"limit_modules": [5], "door": "2.2"}, "f4": {}}
DRIVERS: dict[str, Any] = {"f4t": WatlowF4T, "f4": WatlowF4}
SIMULATORS: dict[str, Any] = {"f4t": F4TSimulator, "f4": F4Simulator}
TRUTHS = {"f4t": F4T, "f4": F4}


class Room(world.Room):
    """A world with a chamber, and a device that can be switched."""

    def __init__(self) -> None:
        super().__init__()
        self.chamber = Chamber(Truth(ROOM, "chamber"))
        self.acts: list[str] = []

    def power(self, time_s: float, on: bool) -> None:
        self.acts.append(f"dut-power-{'on' if on else 'off'}")


class Fixture(AnyFixture):
    """A served controller, and whoever talks to it."""

    def __init__(
        self,
        clock: Clock,
        model: str,
        truth: Mapping[str, Any],
        faults: tuple[Mapping[str, Any], ...],
        room: Any,
    ) -> None:
        self.model = model
        whole = {**TRUTHS[model], **truth}
        super().__init__(
            clock, NAME, SIMULATORS[model], whole, room, *faults, serial=SERIALS[model]
        )

    def place(self, limits: Mapping[str, float] | None = None, **settings: Any) -> InstrumentPlace:
        given = {**SETTINGS[self.model], **settings}
        return super().place(LIMITS if limits is None else limits, **given)

    def driver(self, limits: Mapping[str, float] | None = None, **settings: Any) -> Any:
        return DRIVERS[self.model](self.place(limits, **settings))

    def line(self) -> RawModbus:
        return RawModbus(self)

    def air_degC(self) -> float:
        """Return the true temperature of the air."""
        return float(self.room.chamber.air_degC(np.array([self.clock.now()]))[0])

    def output(self) -> float:
        """Return how hard the chamber truly heats or cools."""
        return float(self.room.chamber.output(np.array([self.clock.now()]))[0])


class RawModbus(Line):
    """A raw client of Modbus TCP that puts its frames together by hand."""

    def __init__(self, fixture: Fixture) -> None:
        super().__init__(fixture, NAME, fixture.clock)  # type: ignore[arg-type]

    def pdu(self, request: bytes, *, transaction: int = 1, unit: int = 1) -> bytes:
        """Send a request in a frame and return the answer out of its frame."""
        frame = struct.pack(">HHHB", transaction, 0, len(request) + 1, unit) + request
        answer = self.raw_ask(frame)
        head = struct.unpack(">HHHB", answer[:7])
        assert head == (transaction, 0, len(answer) - 6, unit)
        return answer[7:]

    def words(self, address: int, count: int) -> tuple[int, ...]:
        """Read registers."""
        answer = self.pdu(struct.pack(">BHH", 3, address, count))
        assert answer[:2] == bytes([3, 2 * count]), answer.hex()
        return struct.unpack(f">{count}H", answer[2:])

    def number(self, address: int) -> float:
        """Read a number whose low word comes first."""
        low, high = self.words(address, 2)
        return float(struct.unpack(">f", struct.pack(">HH", high, low))[0])

    def put(self, address: int, value: int) -> bytes:
        """Write one register and return the answer."""
        return self.pdu(struct.pack(">BHH", 6, address, value))

    def put_number(self, address: int, value: float) -> bytes:
        """Write a number, low word first, and return the answer."""
        high, low = struct.unpack(">HH", struct.pack(">f", value))
        return self.pdu(struct.pack(">BHHBHH", 16, address, 2, 4, low, high))


def controller(
    model: str, *faults: Mapping[str, Any], room: Any = None, **truth: Any
) -> AbstractContextManager[Fixture]:
    """Serve a controller while this thread takes part in time."""
    return serving(lambda clock: Fixture(clock, model, truth, faults, room or Room()))


@contextmanager
def opened(
    model: str,
    *faults: Mapping[str, Any],
    room: Any = None,
    limits: Mapping[str, float] | None = None,
    settings: Mapping[str, Any] | None = None,
    **truth: Any,
) -> Iterator[tuple[Fixture, Any]]:
    """Serve a controller and open its driver."""
    with controller(model, *faults, room=room, **truth) as fixture:
        driver = fixture.driver(limits, **(settings or {}))
        yield fixture, driver
        driver.close()
