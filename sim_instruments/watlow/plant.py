"""What a Watlow controller is wired to: a chamber, its sensor, and what may go wrong with them."""

from __future__ import annotations

import math
import re
from typing import Any, ClassVar

import numpy as np

from sim_instruments.faults.lasting import (
    ChamberAlarm,
    CompressorTrip,
    DoorOpen,
    Frozen,
    HeaterBroken,
    LastingFault,
)
from sim_instruments.instrument import ServedInstrument, Setting
from sim_instruments.truth import Truth
from sim_instruments.wire.modbus import Registers
from sim_instruments.world.chamber import Chamber

CHAMBER, NOTHING = "chamber", "nothing"
COMPRESSOR_ALARM = 2
NUMBER = re.compile(r"\d+")
"""The alarm that hangs on the compressor's pressure switch."""

ROOM: dict[str, Any] = {
    "room": "22 degC",
    "time_constant": "5 min",
    "heating": "3 degC/min",
    "cooling": "2 degC/min",
    "lowest": "-70 degC",
    "highest": "180 degC",
    "idle_time_constant": "4 h",
    "door_time_constant": "3 min",
    "cycling": {"amplitude": "0.15 K", "period": "15 min"},
}
"""A chamber of the usual kind, for worlds in which no device stands in one."""


class Plant:
    """The chamber of the world, or one of its own; `faults` begin and end here.

    Truth: `steers` (`chamber`, or `nothing` for a controller whose loop is not wired), and
    `sensor_error` and `noise` of the process value; `door_inverted: true` for a door's contact
    that is wired the other way round.
    """

    lasting_faults: ClassVar = (
        Frozen.kind,
        HeaterBroken.kind,
        CompressorTrip.kind,
        DoorOpen.kind,
        ChamberAlarm.kind,
    )

    def __init__(self, setting: Setting) -> None:
        truth, faults = setting.truth, setting.faults
        self._clock, self._faults, self._rng = setting.clock, faults, setting.rng
        steers = truth.word("steers", (CHAMBER, NOTHING))
        self._error_K = truth.quantity("sensor_error", "K")
        self._noise_K = truth.quantity("noise", "K")
        world = setting.world.find(Chamber) if steers == CHAMBER else None
        self._chamber = world or Chamber(Truth(ROOM, "chamber"))
        self._inverted = truth.switch("door_inverted")
        self._controls = False
        self._kept_degC: float | None = None
        faults.when_changed(Frozen.kind, self._freeze)
        faults.when_changed(HeaterBroken.kind, lambda s, f: self._chamber.heater(s, f is None))
        faults.when_changed(
            CompressorTrip.kind, lambda s, f: self._chamber.compressor(s, f is None)
        )
        faults.when_changed(DoorOpen.kind, lambda s, f: self._chamber.door(s, f is not None))
        faults.when_changed(ChamberAlarm.kind, lambda s, f: self._alarmed(s))

    def process_degC(self) -> float:
        """Return what the sensor measures now."""
        if self._kept_degC is not None:
            return self._kept_degC
        return self._measured_degC(self._clock.now())

    def output_percent(self) -> float:
        """Return the power of heater (positive) and compressor (negative)."""
        now_s = np.array([self._clock.now()])
        return 100.0 * float(self._chamber.output(now_s)[0]) if self._moves() else 0.0

    def set_point(self, temperature_degC: float) -> None:
        """Control to another temperature from now on."""
        self._chamber.set_point(self._clock.now(), temperature_degC)

    def ramp(self, from_degC: float, to_degC: float, rate_K_per_s: float) -> None:
        """Control to a temperature that goes to another from now on."""
        self._chamber.ramp(self._clock.now(), from_degC, to_degC, rate_K_per_s)

    def control(self, on: bool) -> None:
        """Give heater and compressor to the controller, or switch them off."""
        self._controls = on
        self._chamber.control(self._clock.now(), self._moves())

    def energised(self) -> bool:
        """Return whether heater and compressor may run."""
        return self._moves()

    def door_is_open(self) -> bool:
        """Return what the door's switch shows; one that is wired inverted shows the opposite."""
        is_open = self._faults.now(DoorOpen.kind) is not None or self._chamber.door_stands_open
        return is_open != self._inverted

    def alarm_is_on(self, number: int) -> bool:
        """Return whether an alarm, numbered from 1, is on."""
        alarm = self._faults.now(ChamberAlarm.kind)
        if isinstance(alarm, ChamberAlarm) and alarm.number == number:
            return True
        return number == COMPRESSOR_ALARM and self._faults.now(CompressorTrip.kind) is not None

    def _moves(self) -> bool:
        """Whether heater and compressor follow the controller; an alarm's relay cuts them off."""
        return self._controls and self._faults.now(ChamberAlarm.kind) is None

    def _measured_degC(self, time_s: float) -> float:
        air_degC = float(self._chamber.air_degC(np.array([time_s]))[0])
        return air_degC + self._error_K + self._noise_K * float(self._rng.standard_normal())

    def _freeze(self, time_s: float, fault: LastingFault | None) -> None:
        self._kept_degC = None if fault is None else self._measured_degC(time_s)

    def _alarmed(self, time_s: float) -> None:
        self._chamber.control(time_s, self._moves())


class SetPoint:
    """The set-point that a controller controls to, which may be on a ramp to another."""

    def __init__(self, setting: Setting, plant: Plant, value_degC: float) -> None:
        self._clock, self._plant = setting.clock, plant
        self._start_degC = self.target_degC = value_degC
        self._began_s, self._rate_K_per_s = 0.0, math.inf
        plant.set_point(value_degC)

    def now_degC(self) -> float:
        """Return where the set-point stands."""
        if math.isinf(self._rate_K_per_s):
            return self.target_degC
        way = self.target_degC - self._start_degC
        gone = self._rate_K_per_s * (self._clock.now() - self._began_s)
        return self.target_degC if gone >= abs(way) else self._start_degC + math.copysign(gone, way)

    def jump(self, target_degC: float) -> None:
        """Stand at a temperature from now on."""
        self.target_degC, self._rate_K_per_s = target_degC, math.inf
        self._plant.set_point(target_degC)

    def ramp(self, target_degC: float, rate_K_per_s: float, start_degC: float) -> None:
        """Go to a temperature at a rate; a rate of zero stands still."""
        self._start_degC, self.target_degC = start_degC, target_degC
        self._began_s, self._rate_K_per_s = self._clock.now(), rate_K_per_s
        if rate_K_per_s > 0 and start_degC != target_degC:
            self._plant.ramp(start_degC, target_degC, rate_K_per_s)
        else:
            self._plant.set_point(start_degC)


class WatlowController(ServedInstrument):
    """A controller, of whatever model, that steers a plant."""

    lasting_faults: ClassVar = Plant.lasting_faults
    _plant: Plant
    _registers: Registers

    def knows(self, command: str) -> bool:
        """Whether the controller has a register, or the first and the last of several."""
        return all(int(number) in self._registers for number in NUMBER.findall(command))

    def energised(self) -> bool:
        """Return whether heater and compressor may run."""
        return self._plant.energised()
