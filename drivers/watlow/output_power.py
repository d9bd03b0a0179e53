"""Power of the device under test, switched by a digital output of a Watlow F4T.

Not confirmed in a primary source: that an output can be written where its state is read. Where the
chamber's maker gave the output to a profile event, `event` switches it, which the manual does say;
either way the state of the output itself is what is read back.

Commands and their sources:
    0, 4, 8, 12 - hardware, release, build, serial number - F4T manual, register list - confirmed
    16594 to 16600, 16822 to 16828 - profile events 1 to 8, 62 off and 63 on - F4T manual, register
        list - confirmed
    33718 and on - states of outputs, 240 registers a module and 40 an output - F4T clients -
        not confirmed
"""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from drivers.transport.exchanges import Repeatable
from drivers.transport.modbus_line import DEVICE_FAILURE, ModbusRefusal
from drivers.watlow.f4t import (
    OFF,
    ON,
    REPEATABLE,
    F4TRegisters,
    F4TSettings,
    IoName,
    WatlowF4T,
    io_register,
)
from station.errors import InstrumentError
from station.roles import Driver, Identity, Place, Shares, quantity
from station.roles.patience import patience

EVENTS = (16594, 16596, 16598, 16600, 16822, 16824, 16826, 16828)
SWITCHES_WITHIN_S = 1.0
LOOK_S = 0.05


class WatlowOutputPower(Driver):
    """An output behind which the device's supply hangs.

    Where the output is that of the chamber's own controller, `shares: [thermal_chamber]` stands in
    place of an address, `unit` and `word_order`, and its line is used.
    """

    class Settings(F4TSettings):
        """Which output it is, and what switches it."""

        output: IoName = Field(description='module and number of the output, as `"2.1"`')
        event: int | None = Field(
            None,
            ge=1,
            le=8,
            description="the profile event that switches it; unless given it is written itself",
        )

    repeatable: ClassVar[Repeatable] = REPEATABLE
    shares: ClassVar[Shares] = Shares(
        WatlowF4T,
        "is no Watlow F4T",
        "share the chamber whose controller has the output, or give an address",
    )

    def __init__(self, place: Place) -> None:
        self.place = place
        self._shares = bool(place.shared)
        settings = self.Settings.of(place)
        self._registers = self._shared_registers() or F4TRegisters(place, settings)
        self._name = settings.output
        self._output = self._switch = io_register(self._name)
        if settings.event is not None:
            self._switch = EVENTS[settings.event - 1]

    def identify(self) -> Identity:
        """Read hardware, serial number and firmware of the controller."""
        return self._registers.identify()

    def switch_on(self) -> None:
        """Switch the device on and see that the output is on."""
        self._set(ON)

    def switch_off(self) -> None:
        """Switch the device off and see that the output is off."""
        self._set(OFF)

    @quantity("output", states=("on", "off"))
    def _is_on(self) -> bool:
        return self._state() == ON

    def close(self) -> None:
        """Close the line where it is this one's own; the output stays as it is."""
        if not self._shares:
            self._registers.line.close()

    def _shared_registers(self) -> F4TRegisters | None:
        self.shares.need(self.place)
        return next((chamber.registers for chamber in self.place.shared.values()), None)

    def _set(self, wanted: int) -> None:
        try:
            self._registers.line.set(self._switch, wanted)
        except ModbusRefusal as refusal:
            raise self._missing(refusal) from refusal
        until_s = self.place.clock.now() + SWITCHES_WITHIN_S
        while (state := self._state()) != wanted:
            if self.place.clock.now() >= until_s:
                raise self.error(
                    f"switch output {self._name} {'on' if wanted == ON else 'off'}",
                    f"its state still reads {state} after {SWITCHES_WITHIN_S:g} s",
                    "compare the output's function in the controller and settings.event",
                )
            self.place.clock.sleep(LOOK_S)

    @patience()
    def _state(self) -> int:
        try:
            (state,) = self._registers.line.read(self._output)
        except ModbusRefusal as refusal:
            raise self._missing(refusal) from refusal
        self.place.publish("output", "on" if state == ON else "off")
        return state

    def _missing(self, refusal: ModbusRefusal) -> InstrumentError:
        if refusal.code != DEVICE_FAILURE:
            return refusal
        return self.error(
            f"use output {self._name}",
            f"the controller has no such output (exception {refusal.code})",
            "correct settings.output in the bench file, or look which modules it is fitted with",
        )
