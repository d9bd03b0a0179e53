"""The navigator behind its interface: what it outputs, when, and what it says of itself.

How its messages look on a line is another module's. Angles and temperatures come from the world,
computed some way ahead as if nothing would change, and again from the present output on when the
world's version says that something did.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from sim_instruments.faults.lasting import AlignmentFails, Frozen, GyroFails, Silent
from sim_instruments.generic.outputs import Ahead, OutputModel
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError
from sim_instruments.world.piecewise import Array

START, STOP, IDENTIFY, REPORT, ALIGN = 1, 2, 3, 4, 5
OK, UNKNOWN_COMMAND, BAD_RATE, BAD_LATITUDE, ALREADY_RUNNING, BAD_LENGTH, UNIT_OFF = range(7)
ALIGNED, ALIGNING = 1 << 0, 1 << 1
OFF_BIT, ALIGNMENT_FAILED, GYRO_FAILED = 1 << 8, 1 << 9, 1 << 10
SLOWEST, FASTEST = 10, 100  # outputs per second in units of 0.1 Hz
PROTOCOL_VERSION = 1
VERSIONS = (1, 0, 1, PROTOCOL_VERSION)
"""Firmware major and minor, hardware, protocol."""
TEMPERATURE_STEPS, LARGEST_TEMPERATURE = 100.0, 32767  # per degC
MAX_REPORTED = 0xFFFF  # of an alignment, in units of 0.1 s
FIRST_AHEAD, MAX_AHEAD = 64, 256
LASTING_FAULTS = (Frozen.kind, Silent.kind, AlignmentFails.kind, GyroFails.kind)

Values = list[float]
"""Heading, pitch and roll in deg, and the temperatures of the gyros x, y, z in degC."""


@runtime_checkable
class NavigatorWorld(Protocol):
    """What a world with a navigator in it offers beside what every world does."""

    @property
    def version(self) -> int:
        """A number that rises with every change of what the future holds."""

    @property
    def dut_powered(self) -> bool:
        """Whether the navigator is switched on now."""

    def align(self, time_s: float, latitude_deg: float) -> None:
        """Begin an alignment."""

    def aligned(self, time_s: float) -> bool:
        """Return whether the navigator is aligned at a time."""

    def navigator_attitude(self, times_s: Array) -> Array:
        """Return heading, pitch and roll as the navigator computes them, deg, (times, 3)."""

    def gyro_temperature_degC(self, times_s: Array) -> Array:
        """Return what the thermometers in the gyros x, y, z read, (times, 3)."""


class Output(NamedTuple):
    """One output: angles in deg, rounded to the navigator's resolution, temperatures in degC."""

    counter: int
    heading_deg: float
    pitch_deg: float
    roll_deg: float
    temperature_degC: tuple[float, float, float]
    status: int

    def temperature_steps(self) -> list[int]:
        """Return the temperatures in 0.01 degC, as both lines send them."""
        steps = (round(sensor_degC * TEMPERATURE_STEPS) for sensor_degC in self.temperature_degC)
        return [max(-LARGEST_TEMPERATURE, min(step, LARGEST_TEMPERATURE)) for step in steps]


class NavigatorModel(OutputModel):
    """A navigator that answers commands and gives each output to `send` when it is due.

    Truth (`simulator` mapping): `resolution` of the angles; `latency` between the instant of an
    output and its first byte on the line; `clock_error` of the navigator's clock: by how much its
    intervals are too long. In a world without a navigator its interface answers, and says that the
    navigator is off.
    """

    def __init__(self, setting: Setting, send: Callable[[Output], None]) -> None:
        truth = setting.truth
        self.serial = setting.serial_number("the navigator's")
        self._resolution_deg = truth.quantity("resolution", "deg")
        super().__init__(setting, truth.quantity("latency", "s"))
        if self._resolution_deg <= 0 or self._latency_s < 0:
            raise SimulationError(
                f"{truth.where}: resolution must be positive, latency not negative"
            )
        self._world = setting.world.find(NavigatorWorld)
        self._send = send
        self._ahead = Ahead(FIRST_AHEAD, MAX_AHEAD)
        self._aligning_since_s: float | None = None
        self._last: Values | None = None
        self.rate = 0
        """Outputs per second now, in units of 0.1 Hz; 0 while nothing is output."""
        self.counter = 0
        self._begin_s = self._interval_s = 0.0
        self._forget_ahead()

    def carry_out(self, command: int, rate: int, latitude_deg: float) -> int:
        """Do what a command asks for, `rate` in 0.1 Hz; returns a result."""
        if command == START:
            return self._start(rate)
        if command == ALIGN:
            return self._align(latitude_deg)
        if command == STOP:
            self.rate = 0
        return OK if command in (STOP, IDENTIFY, REPORT) else UNKNOWN_COMMAND

    def report(self) -> tuple[int, int, int, int]:
        """Return status, 0.1 s that an alignment is under way, last counter and rate."""
        status, since_s = self.status(), self._aligning_since_s
        for_s = self._clock.now() - since_s if status & ALIGNING and since_s is not None else 0.0
        return status, min(round(10 * for_s), MAX_REPORTED), self.counter & 0xFFFF, self.rate

    def _start(self, rate: int) -> int:
        if not self._powered():
            return UNIT_OFF
        if self.rate:
            return ALREADY_RUNNING
        if not SLOWEST <= rate <= FASTEST:
            return BAD_RATE
        self.rate, self.counter = rate, 0
        self._begin_s, self._interval_s = self._clock.now(), 10.0 / rate * self._stretch
        self._forget_ahead()
        self._begin()
        return OK

    def _align(self, latitude_deg: float) -> int:
        if self._world is None or not self._powered():
            return UNIT_OFF
        if not abs(latitude_deg) <= 90:
            return BAD_LATITUDE
        self._aligning_since_s = self._clock.now()
        self._world.align(self._aligning_since_s, latitude_deg)
        return OK

    def status(self) -> int:
        """Return the status bits of now."""
        self._faults.catch_up()
        if self._world is None or not self._powered():
            return OFF_BIT
        bits = GYRO_FAILED if self._faults.now(GyroFails.kind) is not None else 0
        if self._faults.now(AlignmentFails.kind) is not None:
            self._aligning_since_s = None
            return bits | ALIGNMENT_FAILED
        if self._world.aligned(self._clock.now()):
            self._aligning_since_s = None
            return bits | ALIGNED
        return bits | (ALIGNING if self._aligning_since_s is not None else 0)

    def _powered(self) -> bool:
        on = self._world is not None and self._world.dut_powered
        if not on:
            # What it was doing is forgotten with its supply.
            self.rate, self._aligning_since_s = 0, None
        return on

    def _next_s(self) -> float:
        return self._begin_s + (self.counter + 1) * self._interval_s + self._latency_s

    def _goes_on(self) -> bool:
        return self._powered() and self.rate > 0

    def _due(self) -> Callable[[], object] | None:
        output = self._next()
        return None if output is None else partial(self._send, output)

    def _next(self) -> Output | None:
        """Return the next output; None for one that a fault keeps back."""
        self._faults.catch_up()
        self.counter += 1
        values = self._values()
        if self._faults.now(Frozen.kind) is not None and self._last is not None:
            values = self._last
        self._last = values
        if self._faults.now(Silent.kind) is not None:
            return None
        heading, pitch, roll, x, y, z = values
        return Output(self.counter & 0xFFFF, heading, pitch, roll, (x, y, z), self.status())

    def _values(self) -> Values:
        """Return angles and temperatures of the present output."""
        assert self._world is not None
        if self._version != self._world.version:
            self._forget_ahead()
        if self._used == len(self._computed):
            self._compute_ahead(self._world)
        self._used += 1
        return self._computed[self._used - 1]

    def _forget_ahead(self) -> None:
        self._computed: list[Values] = []
        self._used = 0
        self._ahead.forget()
        self._version = self._world.version if self._world is not None else 0

    def _compute_ahead(self, world: NavigatorWorld) -> None:
        count = self._ahead.count(self._interval_s)
        times_s = self._begin_s + self._interval_s * np.arange(
            self.counter, self.counter + count, dtype=np.float64
        )
        step = self._resolution_deg
        angles = np.round(world.navigator_attitude(times_s) / step) * step
        angles[:, 0] %= 360.0
        temperatures = np.asarray(world.gyro_temperature_degC(times_s))
        self._computed = np.column_stack((angles, temperatures)).tolist()
        self._used = 0
