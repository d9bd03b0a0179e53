"""Watlow F4 controller of a thermal chamber, on Modbus RTU.

From public clients: register 0 holds the model (5270, the letters F and 4), 1 and 2 the serial
number, 100 the process value, 300 the set-point, 602 and 603 its limits, all three signed with as
many decimals as 606 says; 103 and 107 the powers of heater and compressor in signed hundredths of
a percent, of which cooling is negative; 901 the unit; 200 what a profile does; events from 2000,
ten registers apart. From the F4P manual: 1061 and every second one after it, the levels at which
the digital inputs 201, 213, 225 and 237 are active. Assumed: three digits of the serial number in a
register; a set-point one count below its low limit is `off`; 102 and 106 are the states of the
alarms, other than zero while they are on; what is out of range is refused with exception 3.

A chamber's F4 has a clock at 1916 to 1921 (hour, minute, second, month, day, year), and in 200 the
state of its profile, of which there is none here; ten registers from 3500 on hold a name each,
which are blank. An F4P has its slidewire at 1916 to 1921, what it reads is assumed, and in 200 1 in
automatic control and 2 in manual. Left out: profiles, the second channel.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from functools import partial

from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError
from sim_instruments.watlow.plant import Plant, WatlowController
from sim_instruments.wire.modbus import (
    ILLEGAL_VALUE,
    ModbusError,
    ModbusRtuServer,
    Parameter,
    Registers,
    Words,
    chosen,
    fixed,
    number,
    shown,
    signed,
)
from station.clock import Clock

UNIT = 1
MODEL, REVISION, MADE = 5270, 203, 2208
PER_K, DECIMALS, CELSIUS = 10.0, 1, 1
ALARMS = (102, 106)
INPUTS = (201, 213, 225, 237)
FIRST_ACTIVE_LEVEL = 1061
LEVELS, MAPS = ("low", "high"), ("chamber", "f4p")
AUTOMATIC, MANUAL = 1, 2
CLOCK = ("hour", "minute", "second", "month", "day", "year")
BEGAN = datetime(2026, 1, 1)  # noqa: DTZ001
"""What a controller's clock shows when its world begins."""
PROFILES = 40
EVENTS = 8
HIGHEST_SERIAL = 999_999


class WatlowF4(WatlowController):
    """The controller; its channel 1 moves the world's `chamber`, or one of its own.

    Truth (`simulator` mapping): what `Plant` needs; `set_point_low` and `set_point_high` as the
    chamber's maker left them; `chamber_event`, the event that must be on for heater and compressor
    to run, or 0; `door_input`, the input (1 to 4) that is on while the door is closed, none unless
    said; `door_active`, the level (`high` unless said, or `low`) at which that input is active;
    `map`, `chamber` unless said, or `f4p`; `manual`, whether an F4P is in manual control.
    """

    model = "Watlow F4"
    protocol = "modbus-rtu"
    resource = "socket://{host}:{port}"

    def __init__(self, setting: Setting) -> None:
        truth = setting.truth
        if not setting.serial.isdecimal() or int(setting.serial) > HIGHEST_SERIAL:
            raise SimulationError(f"{truth.where}: an F4 has a serial number of six digits")
        self._plant = Plant(setting)
        self._low = round(truth.quantity("set_point_low", "degC") * PER_K)
        self._high = round(truth.quantity("set_point_high", "degC") * PER_K)
        self._chamber_event = truth.integer("chamber_event", 0)
        self._door_input = truth.integer("door_input", 0, 0)
        self._wired = LEVELS.index(truth.word("door_active", LEVELS, "high"))
        self._active = dict.fromkeys(range(1, len(INPUTS) + 1), self._wired)
        self._events = dict.fromkeys(range(1, EVENTS + 1), 0)
        self._set_point = self._low - 1
        own = (
            self._of_chamber(setting.clock)
            if truth.word("map", MAPS, "chamber") == "chamber"
            else self._of_f4p(MANUAL if truth.switch("manual") else AUTOMATIC)
        )
        self._registers = Registers(self._table(int(setting.serial)) | own)
        self._server = ModbusRtuServer(setting, self._registers, UNIT)
        self._server.begin()

    def _table(self, serial: int) -> dict[int, Parameter]:
        first, last = divmod(serial, 1000)
        constants = {0: MODEL, 1: first, 2: last, 4: REVISION, 5: MADE, 101: 0}
        constants |= {606: DECIMALS, 608: 0, 901: CELSIUS}
        plant = self._plant
        table = {address: fixed(value) for address, value in constants.items()} | {
            100: shown(lambda: plant.process_degC() * PER_K),
            103: shown(lambda: max(plant.output_percent(), 0.0) * 100),
            107: shown(lambda: min(plant.output_percent(), 0.0) * 100),
            300: Parameter(lambda: signed(self._set_point), self._aim),
            602: Parameter(lambda: signed(self._low), partial(self._limit, "_low")),
            603: Parameter(lambda: signed(self._high), partial(self._limit, "_high")),
        }
        for n, address in enumerate(ALARMS, 1):
            table[address] = shown(partial(self._alarm, n))
        for n, address in enumerate(INPUTS, 1):
            table[address] = shown(partial(self._input, n))
            active = partial(self._active.__getitem__, n), partial(self._active.__setitem__, n)
            table[FIRST_ACTIVE_LEVEL + 2 * (n - 1)] = chosen((0, 1), *active)
        for n in self._events:
            event = partial(self._events.__getitem__, n), partial(self._set_event, n)
            table[2000 + 10 * (n - 1)] = chosen((0, 1), *event)
        return table

    @staticmethod
    def _of_chamber(clock: Clock) -> dict[int, Parameter]:
        """Return the clock of a chamber's F4, and its profiles, of which none runs."""
        shows = ControllerClock(clock)
        return {
            **{1916 + n: shows.field(name) for n, name in enumerate(CLOCK)},
            200: fixed(0),
            1217: chosen((1,), lambda: 0, lambda _: None),
            **{3500 + 10 * profile: fixed(*b" " * 10) for profile in range(PROFILES)},
        }

    @staticmethod
    def _of_f4p(control: int) -> dict[int, Parameter]:
        """Return an F4P's slidewire and state of its control; it has no profiles to terminate."""
        return {**{1916 + n: fixed(0) for n in range(len(CLOCK))}, 200: fixed(control)}

    def _aim(self, words: Words) -> None:
        value = number(words[0])
        if not self._low - 1 <= value <= self._high:
            raise ModbusError(ILLEGAL_VALUE)
        self._set_point = value
        self._follow()

    def _limit(self, name: str, words: Words) -> None:
        limits = {"_low": self._low, "_high": self._high, name: number(words[0])}
        if not limits["_low"] < limits["_high"]:
            raise ModbusError(ILLEGAL_VALUE)
        is_off = self._set_point < self._low
        setattr(self, name, limits[name])
        if is_off:
            self._set_point = self._low - 1
        self._follow()

    def _follow(self) -> None:
        """Do what set-point and event together say."""
        on = self._set_point >= self._low
        if on:
            self._plant.set_point(self._set_point / PER_K)
        allowed = not self._chamber_event or self._events[self._chamber_event] == 1
        self._plant.control(on and allowed)

    def _set_event(self, event: int, state: int) -> None:
        self._events[event] = state
        self._follow()

    def _input(self, n: int) -> int:
        on = n == self._door_input and not self._plant.door_is_open()
        return self._wired if on else 1 - self._wired

    def _alarm(self, alarm: int) -> int:
        return 2 if self._plant.alarm_is_on(alarm) else 0


class ControllerClock:
    """The date and time that a controller shows, which are set field by field."""

    def __init__(self, clock: Clock) -> None:
        self._clock, self._shift = clock, timedelta(0)

    def field(self, name: str) -> Parameter:
        """Return the register of one field; a value that is no date is refused."""

        def take(words: Words) -> None:
            now, wanted = self._now(), {name: words[0]}
            try:
                self._shift += now.replace(**wanted) - now  # type: ignore[arg-type]
            except ValueError:
                raise ModbusError(ILLEGAL_VALUE) from None

        return Parameter(lambda: (getattr(self._now(), name),), take)

    def _now(self) -> datetime:
        return BEGAN + timedelta(seconds=self._clock.now()) + self._shift
