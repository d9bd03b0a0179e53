"""The world of the fibre-optic gyros: a navigator on a three-axis table in a thermal chamber.

The fibre of a gyro, its index and the wavelength of the source change with temperature, so that a
rate reads delta(T) too large; a coil whose temperature changes reads a rate that is not there
(Shupe).
"""

from __future__ import annotations

from functools import partial

import numpy as np

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.base import CHAMBER, DEVICE, World, nothing
from sim_instruments.world.chamber import Chamber, ThermalLag
from sim_instruments.world.coils import AXES
from sim_instruments.world.fog_navigator import Navigator
from sim_instruments.world.nine_axis import DIRECTIONS
from sim_instruments.world.noise import RandomWalk, ReadingNoise, generator
from sim_instruments.world.piecewise import Array
from sim_instruments.world.table import RAD_PER_S, Table

LARGEST_ORDER = 9
SENSOR_CELL_S, NOISE_CELL_S, DRIFT_CELL_S = 0.05, 0.1, 10.0


class FogGyros:
    """The gyros x, y, z of one unit; whether they are switched on is the unit's affair.

    Truth, for all: `temperature_range` (`low`, `high`), over which the variable u of the curves
    goes from -1 to 1; `shupe_at_1_degC_per_min`; `bias_walk`; `angle_random_walk`;
    `sensor_noise` and `sensor_offset` of the thermometers, and `sensor_wiring`, where it is given:
    what the thermometer of an axis shows instead, another axis, the `room` or the `air`. Below
    `x`, `y`, `z`: `lag` behind the chamber's air and `self_heating` by which the switched-on gyro
    is warmer in the end; `scale_factor_error` (`u0`, `u1`, …: of the power of u, ripple and
    hysteresis apart), `ripple` (`amplitude`, `period`), `hysteresis` (`half_width`, and the `rate`
    of temperature at which three quarters of it show); `bias` at the middle of the range, and
    `bias_per_degC`.
    """

    def __init__(self, truth: Truth, chamber: Chamber, seed: int) -> None:
        limits = truth.section("temperature_range")
        low, high = limits.quantity("low", "degC"), limits.quantity("high", "degC")
        if not low < high:
            raise SimulationError(f"{limits.where}: low must be below high")
        self.middle_degC, self.half_K = 0.5 * (low + high), 0.5 * (high - low)
        own = [truth.section(axis) for axis in AXES]
        self.heat = ThermalLag(
            chamber,
            np.array([gyro.quantity("lag", "s") for gyro in own]),
            np.array([gyro.quantity("self_heating", "K") for gyro in own]),
        )
        curves = np.array([_coefficients(gyro.section("scale_factor_error")) for gyro in own])
        # Of the highest power that any gyro has first.
        used = np.flatnonzero(curves.any(axis=0))
        self._curves = curves.T[: used.max(initial=0) + 1][::-1]
        ripple = [gyro.section("ripple") for gyro in own]
        self._ripple = np.array([axis.quantity("amplitude", "1") for axis in ripple])
        self._per_K = 2 * np.pi / np.array([axis.quantity("period", "K") for axis in ripple])
        loop = [gyro.section("hysteresis") for gyro in own]
        self._loop = np.array([axis.quantity("half_width", "1") for axis in loop])
        self._loop_K_per_s = np.array([axis.quantity("rate", "degC/min") for axis in loop]) / 60.0
        self._bias = np.array([gyro.quantity("bias", "deg/h") for gyro in own])
        self._bias_per_K = np.array([gyro.quantity("bias_per_degC", "deg/h/degC") for gyro in own])
        self._shupe = truth.quantity("shupe_at_1_degC_per_min", "deg/h") * 60.0
        offset = truth.section("sensor_offset")
        self._sensor_K = np.array([offset.quantity(axis, "K") for axis in AXES])
        sigma = np.full(3, truth.quantity("sensor_noise", "K"))
        self._sensor = ReadingNoise(sigma, SENSOR_CELL_S, generator(seed, "fog-sensors"))
        self._chamber = chamber
        wired = truth.section("sensor_wiring") if "sensor_wiring" in truth else None
        self._shown = [axis if wired is None else wired.text(axis, axis) for axis in AXES]
        if unknown := set(self._shown) - {*AXES, "room", "air"}:
            raise SimulationError(f"{truth.where}.sensor_wiring: there is no {min(unknown)}")
        # In deg/sqrt(h), that is 1/60 deg after one second.
        step = np.full(3, truth.quantity("angle_random_walk", "deg/sqrt(h)") / 60.0 * np.pi / 180)
        self._angle = RandomWalk(step, NOISE_CELL_S, generator(seed, "fog-angle-walk"))
        drift = np.full(3, truth.quantity("bias_walk", "deg/h/sqrt(h)") / 60.0)
        self._drift = RandomWalk(drift, DRIFT_CELL_S, generator(seed, "fog-bias-walk"))

    def temperature_degC(self, time_s: Array) -> Array:
        """Return the gyros' true temperatures, shape (times, 3)."""
        return self.heat.temperature_and_rate(time_s)[0]

    def body_degC(self, time_s: Array) -> Array:
        """Return the temperature of their housing, the mean of theirs."""
        return np.asarray(self.temperature_degC(time_s).mean(axis=1))

    def sensor_degC(self, time_s: Array) -> Array:
        """Return what the thermometers in the gyros read, shape (times, 3)."""
        noise = self._sensor.at(time_s)
        true = dict(zip(AXES, self.temperature_degC(time_s).T, strict=True))
        true["room"] = np.full(len(time_s), self._chamber.room_degC)
        true["air"] = self._chamber.air_degC(time_s)
        shown = np.column_stack([true[name] for name in self._shown])
        return np.asarray(shown + self._sensor_K + noise)

    def scale_factor_error(
        self, temperature_degC: Array, rate_K_per_s: Array | float = 0.0
    ) -> Array:
        """Return delta, measured rate over true rate less one, (times, 3), at temperatures (…, 3).

        `rate_K_per_s` is the temperatures' own rate, which the hysteresis follows.
        """
        u = (temperature_degC - self.middle_degC) / self.half_K
        delta = np.zeros_like(u)
        for coefficients in self._curves:
            delta = delta * u + coefficients
        delta += self._ripple * np.sin(self._per_K * temperature_degC)
        return np.asarray(delta + self._loop * np.tanh(rate_K_per_s / self._loop_K_per_s))

    def bias_rad_per_s(self, time_s: Array, temperature_degC: Array, rate_K_per_s: Array) -> Array:
        """Return the rates that the gyros read at rest, (times, 3), without their white noise."""
        of_temperature = self._bias_per_K * (temperature_degC - self.middle_degC)
        bias = self._bias + of_temperature + self._shupe * rate_K_per_s + self._drift.at(time_s)
        return np.asarray(RAD_PER_S * bias)

    def errors_rad_per_s(self, time_s: Array, rate_rad_per_s: Array) -> Array:
        """Return measured less true rate, noise aside, for true rates along x, y, z, (times, 3)."""
        temperature, slope = self.heat.temperature_and_rate(time_s)
        scale = self.scale_factor_error(temperature, slope)
        return np.asarray(scale * rate_rad_per_s + self.bias_rad_per_s(time_s, temperature, slope))

    def noise_rad(self, time_s: Array) -> Array:
        """Return the integral of the gyros' white noise from 0 s to each time, (times, 3)."""
        return self._angle.at(time_s)


def _coefficients(truth: Truth) -> Array:
    """Return the coefficients of the powers of u, lowest first, as many as there can be."""
    names = [f"u{power}" for power in range(LARGEST_ORDER + 1)]
    if not any(name in truth for name in names):
        raise SimulationError(f"{truth.where}: 'u0', 'u1', … are missing")
    return np.array([truth.quantity(name, "1") if name in truth else 0.0 for name in names])


BEFORE_ALL_S = -1e5


class FogBench(World):
    """A chamber around a table, and on the table a navigator whose gyros feel both.

    Truth below `simulation.fog`: `latitude`, `table`, `chamber`, `gyros` and `navigator` (see the
    parts), `powered_at_start`. The coils of the other benches stand in the same room, and the
    gaussmeter's probe lies there and feels the ambient field.
    """

    on_table = True

    def __init__(self, truth: Truth, table: Table | None = None) -> None:
        super().__init__(truth)
        seed = truth.integer("seed", 0)
        fog = truth.section("fog")
        self.chamber = Chamber(fog.section("chamber"), self._air_changed)
        self.gyros = FogGyros(fog.section("gyros"), self.chamber, seed)
        self.table = table or Table.of_bench(truth, self.table_changed)
        latitude_deg = fog.quantity("latitude", "deg")
        self._navigator = Navigator(
            fog.section("navigator"), self.table, self.gyros, latitude_deg, seed
        )
        self.temperatures = {DEVICE: self.gyros.body_degC, CHAMBER: self.chamber.air_degC}
        if fog.switch("powered_at_start"):
            self.power(BEFORE_ALL_S, True)
        self.acts = {
            "mount": (
                nothing,
                "The simulated navigator stands on the table, its axes along the table's.",
            ),
            "mount-turned": (
                self._navigator.turn_on_plate,
                "The simulated navigator was turned by half a turn on the table.",
            ),
            "mount-navigator": (
                nothing,
                "The simulated navigator stands in the chamber, its door closed.",
            ),
            **{
                f"navigator-{axes}": (
                    partial(self.mount, np.column_stack(DIRECTIONS[axes])),
                    f"The simulated navigator stands with {axes}.",
                )
                for axes in (f"{axis}-{way}" for axis in "XYZ" for way in ("up", "down"))
            },
            **self.usual_acts(
                "The simulated navigator was switched on, and its gyros warm up.",
                "The simulated navigator was switched off.",
            ),
        }

    @property
    def dut_powered(self) -> bool:
        """Whether the navigator is switched on."""
        return self._navigator.powered

    def power(self, time_s: float, on: bool) -> None:
        """Switch the navigator on or off, which warms its gyros or lets them cool down."""
        with self.lock:
            if on != self.dut_powered:
                self.gyros.heat.switch(time_s, on)
                self._navigator.switch(time_s, on)
                self._navigator.forget_after(time_s)
                self.version += 1

    def align(self, time_s: float, latitude_deg: float) -> None:
        """Let the navigator begin to align at a stated latitude; not while it is off."""
        with self.lock:
            self._navigator.align(time_s, latitude_deg)
            self.version += 1

    def aligned(self, time_s: float) -> bool:
        """Return whether the navigator knows its attitude at a time."""
        with self.lock:
            return self._navigator.aligned(time_s)

    def navigator_attitude(self, times_s: Array) -> Array:
        """Return what the navigator takes for heading, pitch and roll, in deg, shape (times, 3).

        Heading from 0 to below 360 deg, clockwise from north. Zeros while it is not aligned.
        """
        with self.lock:
            return self._navigator.attitude_deg(np.asarray(times_s, dtype=np.float64))

    def gyro_temperature_degC(self, times_s: Array) -> Array:
        """Return what the thermometers in the gyros x, y, z read, shape (times, 3)."""
        with self.lock:
            return self.gyros.sensor_degC(np.asarray(times_s, dtype=np.float64))

    def mount(self, axes: Array, time_s: float) -> None:
        """Mount the navigator on the plate, its x, y, z (columns) along the plate's axes."""
        with self.lock:
            self._navigator.mount(axes, time_s)
            self.version += 1

    def _air_changed(self, time_s: float) -> None:
        self.gyros.heat.forget_after(time_s)
        self.table_changed(time_s)

    def table_changed(self, time_s: float) -> None:
        """Forget what was computed ahead from a time on: the table turns otherwise."""
        self._navigator.forget_after(time_s)
        self.version += 1
