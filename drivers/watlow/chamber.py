"""What every Watlow controller of a thermal chamber does alike: limits, ramps, looks, rest."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from drivers.transport.modbus_line import ModbusLine
from station.roles import Driver, Place, SafetyReading, published, quantity
from station.roles.patience import patience

MAX_AT_ONCE_K = 1.0
SENSIBLE_DEGC = (-200.0, 500.0)
LOOK_S = 0.1
TROUBLE_EVERY_S = 60.0
NO_POWER_PERCENT = 0.05


class WatlowChamber(Driver, ABC):
    """A chamber with one temperature; a model says in which registers.

    Limits: `temperature_low` and `temperature_high` go into the controller, which must not be set
    to less by the chamber's maker: they are never made wider than they are found.
    `temperature_slew` is the fastest ramp; where it is given, `set_temperature` is a ramp, too.

    Alarms are looked for before every command, and once a minute by whoever asks for temperature,
    set-point or the end of a ramp; one that is on is raised as InstrumentError. `door_register` is
    the input of the door, if any.
    """

    wired_by: ClassVar = {"door": "door"}
    without_limits = "the chamber is not switched on"
    resolution_K: float
    """How fine the controller's set-point is."""

    def __init__(self, place: Place, line: ModbusLine, door_register: int | None) -> None:
        self.place, self._line, self._door_register = place, line, door_register
        self._lock = place.clock.lock(f"{place.name} set-point")
        self._limits_written = self._on = False
        self._steps: Steps | None = None
        self._looked_s = -math.inf

    # The role.

    def programme_limits(self) -> None:
        """Write the bench file's temperature limits into the controller and read them back.

        Raises InstrumentError where the controller's own are narrower.
        """
        low, high = self.limit("temperature_low"), self.limit("temperature_high")
        has_low, has_high = self._limits_found()
        if low < has_low - self.resolution_K or high > has_high + self.resolution_K:
            raise self.error(
                f"limit the set-point to {low:g} degC to {high:g} degC",
                f"the controller's own limits are {has_low:g} degC and {has_high:g} degC",
                "narrow limits.temperature_low and limits.temperature_high in the bench file; only "
                "if the chamber is rated for more, widen the limits at the controller's panel",
            )
        self._write_limits(low, high)
        self._limits_written = True

    def switch_on(self) -> None:
        """Let heater and compressor control, with the present temperature as set-point."""
        self._prepare("switch the control on")
        low, high = self.limit("temperature_low"), self.limit("temperature_high")
        with self._lock:
            self._steps = None
            self._engage(min(max(self._air(), low), high))
        self._on = True
        self.place.publish("output", "on")

    def set_temperature(self, temperature_degC: float) -> None:
        """Go to a temperature as fast as the bench allows; returns at once.

        Raises InstrumentError beyond the limits, with the control off, and for an alarm.
        """
        slew = self.place.limits.get("temperature_slew")
        if slew is not None:
            self.ramp_to(temperature_degC, slew)
            return
        self._ready_for(temperature_degC, f"go to {temperature_degC:g} degC")
        with self._lock:
            self._steps = None
            self._jump(temperature_degC)

    def ramp_to(self, temperature_degC: float, rate_K_per_min: float) -> None:
        """Begin a ramp of the set-point from where it stands; returns at once.

        Raises InstrumentError beyond the limits, with the control off, and for an alarm.
        """
        attempted = f"ramp to {temperature_degC:g} degC at {rate_K_per_min:g} degC/min"
        slew = self.place.limits.get("temperature_slew", math.inf)
        if not 0 < rate_K_per_min <= slew or not math.isfinite(rate_K_per_min):
            raise self.error(
                attempted,
                f"the bench allows rates above 0 and up to {slew:g} degC/min",
                "correct the plan's rate, or limits.temperature_slew",
            )
        self._ready_for(temperature_degC, attempted)
        with self._lock:
            self._steps = None
            self._begin_ramp(temperature_degC, rate_K_per_min)

    def hold(self) -> None:
        """End a ramp and hold the set-point where it stands."""
        with self._lock:
            self._steps = None
            self._end_ramp()

    def is_ramping(self) -> bool:
        """Whether the set-point is still on its way; a ramp that the driver steps is stepped here.

        With the control off nothing is on its way. Raises InstrumentError for an alarm, and for a
        control that is no longer on.
        """
        self._step()
        self._look("followed the ramp")
        return self._on and (self._steps is not None or self._ramp_goes())

    def temperature_degC(self) -> float:
        """Return the process value; InstrumentError for an alarm, or for a value that is none."""
        self._step()
        self._look("read the temperature")
        return self._air()

    def set_point_degC(self) -> float:
        """Return the set-point that is controlled to now."""
        self._step()
        self._look("read the set-point")
        return self._stands_at()

    def pause(self) -> str:
        """Hold the set-point where it stands, for as long as a pause may last."""
        self._look("pause", now=True)
        if not self._on:
            return "control off"
        self.hold()
        return f"holds {self._stands_at():.1f} degC"

    def make_safe(self, deadline_s: float) -> None:
        """Switch heater and compressor off and see, before run time `deadline_s`, that they are."""
        self._on = False
        with self._lock:
            self._steps = None
            self._disengage()
        while self.place.clock.now() < deadline_s - LOOK_S:
            if self.read_safety().safe:
                return
            self.place.clock.sleep(LOOK_S)

    @abstractmethod
    def last_attempt(self) -> None:
        """Switch heater and compressor off at once, and wait for no answer."""

    def read_safety(self) -> SafetyReading:
        """Read back whether the control is off and the output without power."""
        # A sensor that has failed makes nothing unsafe.
        (on, power_percent), air_degC = self._line.proof.of(self._output, self._process_degC)
        self.place.publish("output", "on" if on else "off")
        return SafetyReading(
            not on and abs(power_percent) <= NO_POWER_PERCENT,
            f"control {'ON' if on else 'off'}, output {power_percent:.1f} %, "
            f"air at {air_degC:.1f} degC",
        )

    @patience()
    def open_contacts(self) -> tuple[str, ...]:
        """Return `door` where it is open, and each alarm and limit that is on."""
        contacts = (
            *(["door"] if self._door_is_closed() is False else ()),
            *self._troubles(),
        )
        self.place.publish("chain", "open" if contacts else "closed")
        return contacts

    # What a model does in its own way.

    @abstractmethod
    def _process_degC(self) -> float:
        """Return the process value."""

    @abstractmethod
    def _output(self) -> tuple[bool, float]:
        """Return whether the control is on, and the power in percent."""

    @abstractmethod
    def _troubles(self) -> list[str]:
        """Return what the controller complains of, in words."""

    @abstractmethod
    def _limits_found(self) -> tuple[float, float]:
        """Return the limits of the set-point as they are in the controller, degC."""

    @abstractmethod
    def _write_limits(self, low_degC: float, high_degC: float) -> None:
        """Write the limits of the set-point and read them back."""

    @abstractmethod
    def _stands_at(self) -> float:
        """Return the set-point that is controlled to."""

    @abstractmethod
    def _jump(self, temperature_degC: float) -> None:
        """Write the set-point, without a ramp, and read it back."""

    @abstractmethod
    def _engage(self, temperature_degC: float) -> None:
        """Switch the control on with this set-point, and see that it is on."""

    @abstractmethod
    def _disengage(self) -> None:
        """Switch heater and compressor off."""

    @abstractmethod
    def _input_on(self) -> int:
        """Return what the input of the door reads while it is on."""

    def _begin_ramp(self, target_degC: float, rate_K_per_min: float) -> None:
        here_degC = self._stands_at()
        rate_K_per_s, now_s = rate_K_per_min / 60.0, self.place.clock.now()
        self._steps = Steps(here_degC, target_degC, rate_K_per_s, now_s, here_degC)

    def _end_ramp(self) -> None:
        """End a ramp where the set-point stands."""
        self._steps = None

    def _ramp_goes(self) -> bool:
        """Whether the controller itself makes a ramp."""
        return False

    # What interlocks may watch.

    @quantity("door", states=("closed", "open"))
    def _door_is_closed(self) -> bool | None:
        """Return what is known of the door, None where no input is wired to it."""
        if self._door_register is None:
            return None
        return self._line.read(self._door_register) == [self._input_on()]

    @quantity("chain", states=("closed", "open"))
    def _chain_is_closed(self) -> bool:
        return not self.open_contacts()

    @quantity("output", states=("on", "off"))
    def _is_on(self) -> bool:
        return self._output()[0]

    @published("temperature", "degC")
    def _air(self) -> float:
        air_degC = self._process_degC()
        if not SENSIBLE_DEGC[0] <= air_degC <= SENSIBLE_DEGC[1]:
            raise self.error(
                "read the temperature",
                f"its process value reads {air_degC:g} degC",
                "look at the controller's panel, and at the sensor and its cable",
            )
        return air_degC

    @quantity("temperature", "degC")
    def _air_now(self) -> float:
        self._step()
        return self._air()

    # What is common.

    def _step(self) -> None:
        """Put the set-point of a ramp where it belongs by now."""
        with self._lock:
            steps = self._steps
            if steps is None:
                return
            due_degC = steps.due_degC(self.place.clock.now())
            arrived = due_degC == steps.target_degC
            if arrived or abs(due_degC - steps.stands_at_degC) >= self.resolution_K:
                self._jump(due_degC)
                steps.stands_at_degC = due_degC
            if arrived:
                self._steps = None

    def _prepare(self, attempted: str) -> None:
        """Have the bench's limits in the controller, and no alarm, before anything moves."""
        if not self._limits_written:
            self.programme_limits()
        self._look(attempted, now=True)

    def _ready_for(self, temperature_degC: float, attempted: str) -> None:
        low, high = self.limit("temperature_low"), self.limit("temperature_high")
        if not low <= temperature_degC <= high:
            raise self.error(
                attempted,
                f"the bench allows {low:g} degC to {high:g} degC",
                "correct the plan's temperatures, or the bench file's limits",
            )
        if not self._on:
            raise self.error(attempted, "its control is off", "switch it on before")
        self._prepare(attempted)

    def _look(self, attempted: str, *, now: bool = False) -> None:
        """Raise InstrumentError for what the controller complains of, where it is time to look."""
        if not now and self.place.clock.now() < self._looked_s + TROUBLE_EVERY_S:
            return
        self._looked_s = self.place.clock.now()
        troubles = self._troubles()
        if self._on:
            on, _ = self._output()
            self.place.publish("output", "on" if on else "off")
            if not on:
                troubles.append("its control is off though it was switched on")
        if troubles:
            self._looked_s = -math.inf
            raise self.error(
                attempted,
                ", and ".join(troubles),
                "look at the chamber and at its controller's panel, and clear the cause there",
            )


@dataclass
class Steps:
    """A ramp that the driver steps by itself: where it began, where it ends, where it stands."""

    start_degC: float
    target_degC: float
    rate_K_per_s: float
    began_s: float
    stands_at_degC: float

    def due_degC(self, time_s: float) -> float:
        """Return where the set-point belongs, at most `MAX_AT_ONCE_K` from where it stands."""
        way = self.target_degC - self.start_degC
        gone = min(self.rate_K_per_s * (time_s - self.began_s), abs(way))
        change = self.start_degC + math.copysign(gone, way) - self.stands_at_degC
        change = max(-MAX_AT_ONCE_K, min(change, MAX_AT_ONCE_K))
        due_degC = self.stands_at_degC + change
        return self.target_degC if math.isclose(due_degC, self.target_degC) else due_degC
