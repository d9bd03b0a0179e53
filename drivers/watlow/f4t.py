"""Watlow F4T controller of a thermal chamber, by Modbus TCP, or RTU on a serial port.

Not confirmed in a primary source: that a ramp which is switched off leaves the set-point at its
target, so it is held before; that register 6730, and 14080 on a serial port, holds the unit of what
is read (15 for degC), so a controller without it is taken to be set to degC. Of numbers the low
word comes first unless the bench file says otherwise.

A controller whose firmware has no such ramp is driven with `ramp: stepped`: the driver then writes
the set-point again whenever it is asked for anything, in steps of at most 1 K, so the ramp is only
as even as the driver is asked often.

Commands and their sources:
    0, 4, 8, 12 - hardware, release, build, serial number - F4T manual, register list - confirmed
    1356 and on - states of alarms, a hundred registers apart - F4T manual, register list -
        confirmed
    2730, 2814 - control mode, 62 off and 10 automatic; the mode that is active - F4T manual,
        register list - confirmed
    2774, 2776 - limits of the set-point - F4T manual, register list - confirmed
    2782, 2810 - set-point, and where it stands - F4T manual, register list - confirmed
    2808, 2820 - power, process value - F4T manual, register list - confirmed
    2794, 2796, 2798 - ramp of the set-point: action, scale, rate - chamber maker's manual -
        not confirmed
    6730, 14080 - unit by Modbus TCP, by serial port - F4T clients - not confirmed
    11250, 11264, 11288 - state, status and error of a limit controller - F4T clients -
        not confirmed
    16566, 16568 - terminate the profile, its state - F4T clients - not confirmed
    33718 and on - states of inputs and outputs - F4T clients - not confirmed
"""

from __future__ import annotations

import struct
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from drivers.transport.exchanges import Repeatable
from drivers.transport.modbus_line import (
    NO_REGISTER,
    SCHEME,
    ModbusLine,
    ModbusRefusal,
    ModbusSettings,
)
from drivers.watlow.chamber import LOOK_S, WatlowChamber
from station.errors import AnotherInstrument
from station.roles import Identity, Place

LOW_FIRST = "low-first"
HARDWARE, RELEASE, BUILD, SERIAL = 0, 4, 8, 12
HARDWARE_OF_F4T = 124
FIRST_IO, PER_MODULE, PER_IO, MOST = 33718, 240, 40, 6
OFF, ON = 62, 63
REPEATABLE = Repeatable(r"(read|write) \d+")
"""A register that is read or written twice holds the same afterwards."""


def io_register(name: str) -> int:
    """Return the register of an input or output by `module.number`, as `2.1`; ValueError else."""
    module, _, number = name.partition(".")
    if not (module.isdecimal() and number.isdecimal()):
        raise ValueError(f"{name!r} is no module and number such as '2.2'")
    if not (1 <= int(module) <= MOST and 1 <= int(number) <= MOST):
        raise ValueError(f"{name!r} is beyond module {MOST} or number {MOST}")
    return FIRST_IO + PER_MODULE * (int(module) - 1) + PER_IO * (int(number) - 1)


def io_name(name: str) -> str:
    """Return the name of an input or output; ValueError for one that no controller has."""
    io_register(name)
    return name


IoName = Annotated[str, AfterValidator(io_name)]
"""Module and number of an input or output, as `2.1`."""


class F4TSettings(ModbusSettings):
    """What the bench file says of a controller, whatever it is used for."""

    word_order: Literal["low-first", "high-first"] = Field(
        "low-first", description="of the two words of a number; proven by the identity"
    )


class F4TRegisters:
    """One controller's line, and the order of the two words of a number."""

    def __init__(self, place: Place, settings: F4TSettings) -> None:
        self._place = place
        self._low_first = settings.word_order == LOW_FIRST
        self.line = ModbusLine(place, settings, REPEATABLE, ((HARDWARE, 2), (SERIAL, 2)))

    def identify(self) -> Identity:
        """Read who is there; the hardware's number proves the model and the order of words."""
        hardware = self.whole(HARDWARE)
        if hardware != HARDWARE_OF_F4T:
            swapped = (hardware & 0xFFFF) << 16 | hardware >> 16 & 0xFFFF
            raise AnotherInstrument(
                self._place.name,
                "read the number of its hardware",
                f"{hardware} came back where an F4T has {HARDWARE_OF_F4T}",
                "correct settings.word_order in the bench file, or the order in the controller"
                if swapped == HARDWARE_OF_F4T
                else "check that the address in the bench file is this controller's",
            )
        release, build = self.whole(RELEASE), self.whole(BUILD)
        return Identity("Watlow", "F4T", str(self.whole(SERIAL)), f"{release}.{build}")

    def whole(self, address: int) -> int:
        """Return a signed whole number of two registers."""
        (value,) = struct.unpack(">i", self._bytes(self.line.read(address, 2)))
        return int(value)

    def number(self, address: int) -> float:
        """Return a number of two registers; it may be no finite one."""
        (value,) = struct.unpack(">f", self._bytes(self.line.read(address, 2)))
        return float(value)

    def write_number(self, address: int, value: float) -> None:
        """Write a number into two registers and read it back; InstrumentError for another."""
        high, low = struct.unpack(">HH", struct.pack(">f", value))
        self.line.write(address, (low, high) if self._low_first else (high, low))
        read_back = self.number(address)
        if not abs(read_back - value) <= 1e-6 * abs(value) + 1e-6:
            raise self.line.another(address, value, read_back)

    def _bytes(self, words: list[int]) -> bytes:
        first, second = words
        return struct.pack(">HH", *((second, first) if self._low_first else (first, second)))


PER_LOOP = 160
MODE, SET_LOW, SET_HIGH, TARGET = 2730, 2774, 2776, 2782
RAMP_ACTION, RAMP_SCALE, RAMP_RATE = 2794, 2796, 2798
POWER, STANDS_AT, MODE_NOW, PROCESS = 2808, 2810, 2814, 2820
AUTO, AT_SET_POINT, PER_MINUTE = 10, 85, 57
UNIT_BY_TCP, UNIT_BY_PORT, CELSIUS = 6730, 14080, 15
PROFILE_ACTION, PROFILE_STATE, TERMINATE, PROFILE_ACTIVE = 16566, 16568, 148, (149, 146)
FIRST_ALARM, PER_ALARM, MAX_ALARMS = 1356, 100, 14
QUIET_ALARMS = (88, 61, 12)
ALARMS = {7: "high", 8: "low", 28: "error"}
LIMIT_STATE, LIMIT_STATUS, LIMIT_ERROR, PER_LIMIT, LIMIT_MODULES = 11250, 11264, 11288, 60, 6
ERROR, FAIL, NONE = 28, 32, 61
FOLLOWS_WITHIN_S = 2.0
ARRIVED_K = 1e-3


class WatlowF4T(WatlowChamber):
    """A chamber behind one control loop."""

    class Settings(F4TSettings):
        """How the chamber is wired to the controller."""

        loop: int = Field(1, ge=1, le=4, description="the control loop")
        ramp: Literal["controller", "stepped"] = Field(
            "controller", description="who makes a ramp: the controller, or the driver step by step"
        )
        alarms: int = Field(4, ge=0, le=MAX_ALARMS, description="how many the controller has")
        limit_modules: tuple[Annotated[int, Field(ge=1, le=LIMIT_MODULES)], ...] = Field(
            (), description="slots of limit controllers"
        )
        door: IoName | None = Field(
            None,
            description='input that is on while the door is closed, module and number as `"2.2"`',
        )

    identifies_on: ClassVar[str] = SCHEME
    """Where a scan of served instruments may ask it."""

    repeatable: ClassVar[Repeatable] = REPEATABLE

    resolution_K = 0.01

    def __init__(self, place: Place) -> None:
        settings = self.Settings.of(place)
        self.registers = registers = F4TRegisters(place, settings)
        self._shift = PER_LOOP * (settings.loop - 1)
        self._alarms, self._limits = settings.alarms, settings.limit_modules
        self._stepped = settings.ramp == "stepped"
        door_register = None if settings.door is None else io_register(settings.door)
        self._unit_register = UNIT_BY_TCP if place.address.startswith(SCHEME) else UNIT_BY_PORT
        super().__init__(place, registers.line, door_register)

    def identify(self) -> Identity:
        """Read hardware, serial number and firmware."""
        return self.registers.identify()

    def _input_on(self) -> int:
        return ON

    def _limits_found(self) -> tuple[float, float]:
        self.registers.identify()  # numbers in the wrong order of words would pass for numbers
        try:
            (unit,) = self._line.read(self._unit_register)
        except ModbusRefusal as refusal:
            if refusal.code != NO_REGISTER:
                raise
            unit = CELSIUS
        if unit != CELSIUS:
            raise self.error(
                "read the unit of its temperatures",
                f"{unit} came back where degC is {CELSIUS}",
                "set the display unit of its Modbus port to degC at the controller's panel",
            )
        return self._number(SET_LOW), self._number(SET_HIGH)

    def _write_limits(self, low_degC: float, high_degC: float) -> None:
        self._write(SET_LOW, low_degC)
        self._write(SET_HIGH, high_degC)

    def _process_degC(self) -> float:
        return self._number(PROCESS)

    def _stands_at(self) -> float:
        return self._number(STANDS_AT)

    def _jump(self, temperature_degC: float) -> None:
        self._set_word(RAMP_ACTION, OFF)
        self._write(TARGET, temperature_degC)

    def _engage(self, temperature_degC: float) -> None:
        self._jump(temperature_degC)
        self._set_word(MODE, AUTO)
        until_s = self.place.clock.now() + FOLLOWS_WITHIN_S
        while (mode := self._word(MODE_NOW)) != AUTO:
            if self.place.clock.now() >= until_s:
                raise self.error(
                    "switch the control on",
                    f"its active mode still reads {mode} where automatic is {AUTO}",
                    "look at its panel for an alarm, a limit, or an input that keeps the loop off",
                )
            self.place.clock.sleep(LOOK_S)

    def _disengage(self) -> None:
        self._line.write(MODE + self._shift, [OFF])
        try:
            (state,) = self._line.read(PROFILE_STATE)
            if state in PROFILE_ACTIVE:  # a profile has the last word on every loop
                self._line.write(PROFILE_ACTION, [TERMINATE])
                self._line.write(MODE + self._shift, [OFF])
        except ModbusRefusal:
            pass  # a controller without profiles

    def last_attempt(self) -> None:
        """Switch heater and compressor off at once, and wait for no answer."""
        self._line.tell(MODE + self._shift, OFF)

    def _output(self) -> tuple[bool, float]:
        (mode,) = self._line.read(MODE_NOW + self._shift)
        return mode != OFF, self._number(POWER)

    def _troubles(self) -> list[str]:
        troubles = []
        for n in range(self._alarms):
            (state,) = self._line.read(FIRST_ALARM + PER_ALARM * n)
            if state not in QUIET_ALARMS:
                troubles.append(f"alarm {n + 1} is on ({ALARMS.get(state, state)})")
        for module in self._limits:
            state, status, error = (
                self._line.read(address + PER_LIMIT * (module - 1))[0]
                for address in (LIMIT_STATE, LIMIT_STATUS, LIMIT_ERROR)
            )
            if state == ERROR or status == FAIL or error != NONE:
                troubles.append(f"the limit controller in slot {module} has tripped")
        return troubles

    def _begin_ramp(self, target_degC: float, rate_K_per_min: float) -> None:
        self._end_ramp()
        if self._stepped:
            super()._begin_ramp(target_degC, rate_K_per_min)
            return
        here_degC = self._stands_at()
        self._set_word(RAMP_SCALE, PER_MINUTE)
        self._write(RAMP_RATE, rate_K_per_min)
        self._set_word(RAMP_ACTION, AT_SET_POINT)
        began_s = self.place.clock.now()
        self._write(TARGET, target_degC)
        gone_K = abs(self._stands_at() - here_degC)
        most_K = rate_K_per_min * (self.place.clock.now() - began_s + 1.0) / 60.0 + ARRIVED_K
        if gone_K > most_K:
            self._jump(here_degC)
            raise self.error(
                f"ramp to {target_degC:g} degC",
                f"its set-point jumped by {gone_K:.2f} K at once",
                "write ramp: stepped in the settings of the bench file",
            )

    def _end_ramp(self) -> None:
        """Hold the set-point where it stands, then end the ramp."""
        self._write(TARGET, self._stands_at())
        self._set_word(RAMP_ACTION, OFF)

    def _ramp_goes(self) -> bool:
        return abs(self._number(STANDS_AT) - self._number(TARGET)) > ARRIVED_K

    def _number(self, address: int) -> float:
        return self.registers.number(address + self._shift)

    def _write(self, address: int, value: float) -> None:
        self.registers.write_number(address + self._shift, value)

    def _word(self, address: int) -> int:
        return self._line.read(address + self._shift)[0]

    def _set_word(self, address: int, value: int) -> None:
        self._line.set(address + self._shift, value)
