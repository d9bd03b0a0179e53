"""Watlow F4 controller of a thermal chamber, by Modbus RTU.

Not confirmed in a primary source, for every register but 1061: that a set-point one count below its
low limit (602) switches heater and compressor off, as public clients read it; that 102 and 106 are
the states of the alarms, and 101 the error of the input; how the digits of the serial number are
shared out. A digital input is on while its level equals the one at which it is active; whether it
is so while the door is closed is a matter of the wiring.

Chamber F4s and the F4P share this map but for two places: 1916 to 1921 are the clock of a chamber
F4 and the slidewire of an F4P, and 200 is 2 while a profile runs and 3 while it is held, but 1 in
automatic and 2 in manual control on an F4P, which has no profile to terminate. The run's log says
which of them is met.

The F4 ramps by profiles alone. This driver steps the set-point by itself: it writes register 300
again whenever it is asked for anything, at most 1 K at once, so a ramp is only as even as the
driver is asked often.

Commands and their sources:
    0, 1, 2, 4 - model, serial number, software revision - F4 clients - not confirmed
    100, 101 - process value, error of its input - F4 clients - not confirmed
    102, 106 - states of the alarms - F4 clients - not confirmed
    103, 107 - power of heating and cooling, signed hundredths of a percent, of which the magnitude
        is taken - F4 clients - not confirmed
    200, 1217 - state of the profile, terminate it - F4 clients - not confirmed
    201, 213, 225, 237 - levels of the digital inputs - F4 clients - not confirmed
    1061, 1063, 1065, 1067 - level at which a digital input is active - F4P manual 0600-0032
        p.6.18 - confirmed
    300 - set-point, signed - F4 clients - not confirmed
    602, 603 - limits of the set-point - F4 clients - not confirmed
    606, 901 - decimals and unit of temperatures - F4 clients - not confirmed
    1916 to 1921 - clock, which tells a chamber F4 from an F4P - F4 clients - not confirmed
    2000 and on - events, ten registers apart - F4 clients - not confirmed
"""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from drivers.transport.exchanges import Repeatable
from drivers.transport.modbus_line import ModbusLine, ModbusRefusal, ModbusSettings, signed
from drivers.watlow.chamber import WatlowChamber
from station.errors import AnotherInstrument
from station.roles import Identity, Place

MODEL, MODEL_OF_F4 = 0, 5270
WITNESS = ((0, 1), (1, 1), (2, 1))
"""Model and serial number: no other three registers that are read one after the other hold them."""

PROCESS, INPUT_ERROR, ALARMS, HEATS, COOLS = 100, 101, (102, 106), 103, 107
PROFILE, PROFILE_ACTIVE, MANUAL, TERMINATE = 200, (2, 3), 2, 1217
TARGET, SET_LOW, SET_HIGH = 300, 602, 603
DECIMALS, MAX_DECIMALS = 606, 3
UNIT, CELSIUS = 901, 1
INPUTS, ACTIVE_LEVELS = (201, 213, 225, 237), (1061, 1063, 1065, 1067)
CLOCK, CLOCK_FITS = 1916, ((0, 23), (0, 59), (0, 59), (1, 12), (1, 31), (1990, 2199))
"""Hour, minute, second, month, day and year, and what each may be."""
FIRST_EVENT, PER_EVENT, EVENTS = 2000, 10, 8
PERCENT = 100.0


class WatlowF4(WatlowChamber):
    """A chamber behind channel 1."""

    class Settings(ModbusSettings):
        """How the chamber is wired to the controller, and its line."""

        chamber_event: int | None = Field(
            None,
            ge=1,
            le=8,
            description="the event that must be on for heater and compressor to run",
        )
        door: int | None = Field(
            None, ge=1, le=4, description="the digital input that is on while the door is closed"
        )
        baud_rate: Literal[9600, 19200] = Field(19200, description="serial line: bits in a second")

    identifies_on: ClassVar[str] = "socket"
    """Where a scan of served instruments may ask it."""

    repeatable: ClassVar[Repeatable] = Repeatable(r"(read|write) \d+")

    resolution_K = 0.1

    def __init__(self, place: Place) -> None:
        settings = self.Settings.of(place)
        event, door = settings.chamber_event, settings.door
        self._event_register = FIRST_EVENT + PER_EVENT * (event - 1) if event else None
        self._per_K: float | None = None
        self._has_profiles: bool | None = None
        self._active_register = ACTIVE_LEVELS[door - 1] if door else None
        line = ModbusLine(place, settings, self.repeatable, WITNESS)
        super().__init__(place, line, INPUTS[door - 1] if door else None)

    def identify(self) -> Identity:
        """Read model, serial number and software revision."""
        model, first, last = (self._line.read(address)[0] for address in (MODEL, 1, 2))
        if model != MODEL_OF_F4:
            raise AnotherInstrument(
                self.place.name,
                "read its model",
                f"{model} came back where an F4 has {MODEL_OF_F4}",
                "check that the address in the bench file is this controller's",
            )
        (revision,) = self._line.read(4)
        return Identity("Watlow", "F4", f"{first:03d}{last:03d}", f"{revision / 100:.2f}")

    def _input_on(self) -> int:
        assert self._active_register is not None
        (level,) = self._line.read(self._active_register)
        self.met(f"the door's input is active at {'high' if level else 'low'} level")
        return level

    def _is_for_chambers(self) -> bool:
        """Whether it has a clock and profiles, and no slidewire; read once."""
        if self._has_profiles is None:
            try:
                clock = self._line.read(CLOCK, len(CLOCK_FITS))
            except ModbusRefusal:
                clock = []
            fits = zip(clock, CLOCK_FITS, strict=bool(clock))
            self._has_profiles = bool(clock) and all(low <= n <= high for n, (low, high) in fits)
            self.met("registers of a chamber F4" if self._has_profiles else "registers of an F4P")
        return self._has_profiles

    def _limits_found(self) -> tuple[float, float]:
        (unit,) = self._line.read(UNIT)
        if unit != CELSIUS:
            raise self.error(
                "read the unit of its temperatures",
                f"{unit} came back where degC is {CELSIUS}",
                "set the controller to degC at its panel",
            )
        self._is_for_chambers()
        return self._temperature(SET_LOW), self._temperature(SET_HIGH)

    def _write_limits(self, low_degC: float, high_degC: float) -> None:
        self._write(SET_LOW, low_degC)
        self._write(SET_HIGH, high_degC)

    def _process_degC(self) -> float:
        return self._temperature(PROCESS)

    def _stands_at(self) -> float:
        return self._temperature(TARGET)

    def _jump(self, temperature_degC: float) -> None:
        self._write(TARGET, temperature_degC)

    def _engage(self, temperature_degC: float) -> None:
        if self._event_register is not None:
            self._line.set(self._event_register, 1)
        self._jump(temperature_degC)

    def _disengage(self) -> None:
        (profile,) = self._line.read(PROFILE)
        if profile in PROFILE_ACTIVE and self._is_for_chambers():
            self._line.write(TERMINATE, [1])
        (low,) = self._line.read(SET_LOW)
        self._line.write(TARGET, [(low - 1) & 0xFFFF])
        if self._event_register is not None:
            self._line.write(self._event_register, [0])

    def last_attempt(self) -> None:
        """Switch heater and compressor off at once, and wait for no answer."""
        if self._event_register is not None:
            self._line.tell(self._event_register, 0)
        if self._limits_written and self._per_K is not None:
            low = round(self.limit("temperature_low") * self._per_K)
            self._line.tell(TARGET, (low - 1) & 0xFFFF)

    def _output(self) -> tuple[bool, float]:
        (low,), (target,) = self._line.read(SET_LOW), self._line.read(TARGET)
        on = signed(target) >= signed(low)
        if self._event_register is not None:
            on = on and self._line.read(self._event_register) == [1]
        (heats,), (cools,) = self._line.read(HEATS), self._line.read(COOLS)
        return on, (abs(signed(heats)) - abs(signed(cools))) / PERCENT

    def _troubles(self) -> list[str]:
        troubles = [
            f"alarm {number} is on"
            for number, address in enumerate(ALARMS, 1)
            if self._line.read(address) != [0]
        ]
        if not self._is_for_chambers() and self._line.read(PROFILE) == [MANUAL]:
            troubles.append("it is in manual control")
        (error,) = self._line.read(INPUT_ERROR)
        return [*troubles, f"its sensor has error {error}"] if error else troubles

    def _temperature(self, address: int) -> float:
        per_K = self._scale()
        (word,) = self._line.read(address)
        return signed(word) / per_K

    def _write(self, address: int, temperature_degC: float) -> None:
        self._line.set(address, round(temperature_degC * self._scale()) & 0xFFFF)

    def _scale(self) -> float:
        """Return the counts in a kelvin, read once."""
        if self._per_K is None:
            (decimals,) = self._line.read(DECIMALS)
            if decimals > MAX_DECIMALS:
                raise self.error(
                    "read the decimals of its temperatures",
                    f"{decimals} came back, which is no number of decimals",
                    "check that the address in the bench file is this controller's",
                )
            self._per_K = 10.0**decimals
        return self._per_K
