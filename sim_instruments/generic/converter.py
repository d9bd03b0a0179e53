"""What the converter of a meter with six and a half digits makes of its input, whoever made it.

As guides of such meters have it: ranges with 20 % over-range, integration in power-line cycles or
as an aperture in s, the resolution that belongs to each, auto-zero by a second measurement after
every reading. Assumed, since no source at hand says it: 1000 V and 3 A have no over-range, noise
goes with the resolution, four-wire resistance is always zeroed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from sim_instruments.faults.lasting import Frozen, Overload
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError
from sim_instruments.world.coils import AXES
from sim_instruments.world.currents import CurrentHistory
from sim_instruments.world.piecewise import Array

CYCLES = (0.001, 0.002, 0.006, 0.02, 0.06, 0.2, 1.0, 10.0, 100.0)
RESOLUTION = (30e-6, 15e-6, 6e-6, 3e-6, 1.5e-6, 0.7e-6, 0.3e-6, 0.1e-6, 0.03e-6)
"""Of the range, for each integration time in `CYCLES`."""
APERTURES_S = (20e-6, 2.0)
OVERLOAD_READING = 9.9e37
OVER_RANGE = 1.2
OPEN_INPUT_V = 2e-3
OPEN_INPUT_S = 60.0
"""An open input wanders: rms and correlation time."""


@runtime_checkable
class AccelerometerWorld(Protocol):
    """A world in which an accelerometer's output can be measured."""

    def mean_output_V(self, edges_s: Array) -> Array:
        """Return the mean voltage between neighbouring times, shape (intervals,)."""


@runtime_checkable
class CoilsWorld(Protocol):
    """A world with coils that a meter's leads may pass."""

    currents: dict[str, CurrentHistory]


@runtime_checkable
class Pt100World(Protocol):
    """A world in which a platinum thermometer can be measured."""

    def mean_pt100_ohm(self, edges_s: Array) -> Array:
        """Return the mean resistance between neighbouring times, shape (intervals,)."""


@dataclass
class Function:
    """A measurement function with its present settings, by the name that SCPI has for it.

    `overload_bit` is that of the questionable events. `aperture_s` takes the place of `cycles`
    unless it is None. `zero_on` repeats each measurement with the input switched off; `can_zero`
    False: it does so always, and no command prevents it.
    """

    name: str
    unit: str
    ranges: tuple[float, ...]
    overload_bit: int
    can_zero: bool = True
    range: float = 0.0
    autorange: bool = True
    cycles: float = 10.0
    aperture_s: float | None = None
    zero_on: bool = True
    zeroed_at_s: float = field(default=0.0, compare=False)

    def limit(self, range_: float) -> float:
        """Return the largest reading of a range."""
        hard_end = range_ == self.ranges[-1] and self.unit in ("VDC", "VAC", "ADC", "AAC")
        return range_ if hard_end else OVER_RANGE * range_


class Converter:
    """The input of one meter in its world, with the meter's own errors.

    Truth (`simulator` mapping): `measures` (`accelerometer`, `pt100` or `nothing`), `noise` (rms
    at one power-line cycle, of the range), `line_frequency`; with an accelerometer `gain_error`,
    `offset` in V and `zero_drift_in_one_hour` (V, where auto-zero is off), with a Pt100
    `gain_error` and `offset` in ohm; `linearity` may be given, how far the middle of the range is
    off a straight line through its ends, of the range; and `pick_up`, the volts that its leads take
    up where the coils x, y and z together carry 1 A, whether or not the device is on. What is not
    connected, or not in this world, is an open input.
    """

    def __init__(self, setting: Setting) -> None:
        truth = setting.truth
        self._accelerometer = setting.world.find(AccelerometerWorld)
        self._pt100 = setting.world.find(Pt100World)
        self._rng, self._faults = setting.rng, setting.faults
        self.measures = truth.word("measures", ("accelerometer", "pt100", "nothing"))
        self._noise = truth.quantity("noise", "1")
        self.line_frequency_Hz = truth.quantity("line_frequency", "Hz")
        if self.line_frequency_Hz not in (50.0, 60.0):
            raise SimulationError(f"{truth.where}.line_frequency: must be 50 Hz or 60 Hz")
        self._gain, self._offset, self._drift_per_s = 1.0, 0.0, 0.0
        if self.measures != "nothing":
            unit = "V" if self.measures == "accelerometer" else "ohm"
            self._gain += truth.quantity("gain_error", "1")
            self._offset = truth.quantity("offset", unit)
        if self.measures == "accelerometer":
            self._drift_per_s = truth.quantity("zero_drift_in_one_hour", "V") / 3600
        self._pick_up_V = truth.quantity("pick_up", "V", 0.0)
        self._coils = setting.world.find(CoilsWorld) if self._pick_up_V else None
        self._bow = truth.error("linearity", "1")
        self._open_V, self._open_at_s = 0.0, -np.inf
        self._last = 0.0

    def aperture_s(self, function: Function) -> float:
        """Return the integration time of a function."""
        return function.aperture_s or function.cycles / self.line_frequency_Hz

    def resolution(self, function: Function) -> float:
        """Return the resolution that belongs to the integration time, of the range."""
        cycles = self.aperture_s(function) * self.line_frequency_Hz
        exponent = np.interp(np.log(cycles), np.log(CYCLES), np.log(RESOLUTION))
        return float(np.exp(exponent))

    def busy_s(self, function: Function) -> float:
        """Return how long one reading takes, its own zero included."""
        zeroed = function.zero_on or not function.can_zero
        return self.aperture_s(function) * (2 if zeroed else 1)

    def read(self, function: Function, starts_s: Array) -> Array:
        """Return the readings whose integration begins at the given times, shape (readings,)."""
        ends_s = starts_s + self.aperture_s(function)
        true = self._input(function, starts_s, ends_s)
        limits = np.array([function.limit(full_scale) for full_scale in function.ranges])
        chosen = np.full(len(true), function.ranges.index(function.range))
        if function.autorange:
            chosen = np.minimum(np.searchsorted(limits, np.abs(true)), len(limits) - 1)
        ranges = np.array(function.ranges)[chosen]
        relative = self._noise * self.resolution(function) / RESOLUTION[CYCLES.index(1.0)]
        if self._bow:
            true = true + self._bow * ranges * (1.0 - (true / ranges) ** 2)
        values = true + relative * ranges * self._rng.standard_normal(len(true))
        beyond = np.abs(values) > limits[chosen]
        beyond |= self._faults.during(Overload.kind, ends_s)
        values = np.where(beyond, np.copysign(OVERLOAD_READING, true), values)
        for k in np.flatnonzero(self._faults.during(Frozen.kind, ends_s)).tolist():
            values[k] = values[k - 1] if k else self._last
        function.range = float(ranges[-1])
        self._last = float(values[-1])
        return values

    def range_now(self, function: Function, now_s: float) -> float:
        """Return the range that holds what was at the input just now."""
        start_s = max(now_s - self.aperture_s(function), 0.0)
        if start_s == now_s:
            return function.range
        true = float(self._input(function, np.array([start_s]), np.array([now_s]))[0])
        holding = [
            full_scale for full_scale in function.ranges if abs(true) <= function.limit(full_scale)
        ]
        return holding[0] if holding else function.ranges[-1]

    def _input(self, function: Function, starts_s: Array, ends_s: Array) -> Array:
        edges_s = np.column_stack([starts_s, ends_s]).ravel()
        if function.name == "VOLT":
            if self.measures == "accelerometer" and self._accelerometer is not None:
                volts = self._accelerometer.mean_output_V(edges_s)[::2]
                drift = self._drift_per_s * (starts_s - function.zeroed_at_s)
                volts = volts + self._picked_up_V(edges_s)
                return self._gain * volts + self._offset + (0.0 if function.zero_on else drift)
            return self._open_input_V(starts_s)
        if function.unit == "OHM" and self.measures == "pt100" and self._pt100 is not None:
            return self._gain * self._pt100.mean_pt100_ohm(edges_s)[::2] + self._offset
        # Nothing is between the terminals: no current flows through a resistance, a diode or a
        # thermocouple; nothing alternates, and a capacitance is that of the leads.
        open_end = function.unit in ("OHM", "DIODE", "DEGC", "RATIO")
        return np.full(len(starts_s), np.inf if open_end else 0.0)

    def _picked_up_V(self, edges_s: Array) -> Array | float:
        if self._coils is None:
            return 0.0
        coils = [current for name, current in self._coils.currents.items() if name in AXES]
        currents_A = [coil.mean_current(edges_s)[::2] for coil in coils]
        return np.asarray(self._pick_up_V * np.sum(currents_A, axis=0))

    def _open_input_V(self, starts_s: Array) -> Array:
        steps = np.exp(-np.diff(starts_s, prepend=self._open_at_s) / OPEN_INPUT_S)
        shocks = OPEN_INPUT_V * np.sqrt(1 - steps**2) * self._rng.standard_normal(len(steps))
        volts = np.empty(len(steps))
        for k, (step, shock) in enumerate(zip(steps.tolist(), shocks.tolist(), strict=True)):
            self._open_V = step * self._open_V + shock
            volts[k] = self._open_V
        self._open_at_s = float(starts_s[-1])
        return volts
