"""The world of the bias over temperature: a gyro at rest in a chamber, its input axis up."""

from __future__ import annotations

import numpy as np

from sim_instruments.truth import Truth
from sim_instruments.world.base import CHAMBER, DEVICE, nothing
from sim_instruments.world.chamber import Chamber, ThermalLag
from sim_instruments.world.laser_gyro import LaserGyro
from sim_instruments.world.noise import ReadingNoise, Wander, generator
from sim_instruments.world.piecewise import Array
from sim_instruments.world.static_gyro import StaticLaserGyro

PER_MINUTE = 60.0
POWERS = 4
SENSOR_CELL_S = 0.1
PLAY_CELL_S = 10.0
FLICKER_CELLS_S = 120.0 * 4.0 ** np.arange(6)
FLICKER_OF_CELL = np.sqrt(2.0 * np.log(4.0) / (2.0 * np.pi))
"""Standard deviation over B of what the density B^2/(2 pi f) has in a factor of 4 of frequency."""


class GyroInChamber(LaserGyro):
    """A gyro whose bias follows its temperature, behind a lag, and how that came about.

    Truth: that of `BiasTemperatureBench`. Bodies of two time constants in the air give the
    temperature, that of the first, and what the bias follows, a lag behind it.
    """

    def __init__(self, truth: Truth, own: Truth, chamber: Chamber, seed: int) -> None:
        super().__init__(truth)
        self.white_arcsec = 60.0 * own.quantity("angle_random_walk", "deg/sqrt(h)")
        self.walk_deg_per_h = own.quantity("rate_random_walk_in_one_hour", "deg/h")
        # It has no warm-up beside its own heat, and no bias beside its curve.
        self.warm_up_deg_per_h = self.bias_deg_per_h = 0.0
        lag_s, self._sensor_lag_s = own.quantity("lag", "s"), own.positive("sensor_lag", "s")
        self._lag_s = lag_s
        rise_K = own.quantity("self_heating", "K")
        taus_s = np.array([lag_s, self._sensor_lag_s])
        self.bodies = ThermalLag(chamber, taus_s, np.full(2, rise_K))
        between = own.section("temperature_range")
        low, high = between.quantity("low", "degC"), between.quantity("high", "degC")
        self._middle_degC, self._half_K = 0.5 * (low + high), 0.5 * (high - low)
        curve = own.section("curve")
        self._curve = [curve.quantity(f"u{k}", "deg/h", 0.0) for k in range(POWERS)][::-1]
        self._per_K_per_s = PER_MINUTE * own.quantity("rate_sensitivity", "deg/h/(degC/min)")
        loop = own.section("hysteresis")
        self._half_loop = 0.5 * loop.quantity("size", "deg/h")
        self._width_K = loop.positive("half_width", "K")
        self._held_degC = [chamber.room_degC]
        flicker = own.quantity("bias_instability", "deg/h") * FLICKER_OF_CELL
        self._flicker = [
            Wander(np.array([flicker]), cell_s, generator(seed, f"flicker {cell_s:g}"))
            for cell_s in FLICKER_CELLS_S.tolist()
        ]
        self._offset_K = own.quantity("sensor_offset", "K")
        sigma = np.array([own.quantity("sensor_noise", "K")])
        self._reading = ReadingNoise(sigma, SENSOR_CELL_S, generator(seed, "gyro-sensor"))

    def temperature_degC(self, time_s: Array) -> Array:
        """Return what its thermometer reads at each time."""
        own = self.body_degC(time_s)
        noise = self._reading.at(time_s)[:, 0]
        return np.asarray(own + self._offset_K + self._extra_K(time_s) + noise)

    def body_degC(self, time_s: Array) -> Array:
        """Return its temperature at each time."""
        return self.bodies.temperature_and_rate(time_s)[0][:, 0]

    def drift_deg_per_h(self, time_s: Array) -> Array:
        """Return the bias at each time, that of the switch-on and white noise aside."""
        temperature, rate = self.bodies.temperature_and_rate(time_s)
        followed = self._followed(temperature)
        bias = np.polyval(self._curve, (followed - self._middle_degC) / self._half_K)
        bias = bias + self._per_K_per_s * rate[:, 0]
        bias = bias + self._half_loop * (followed - self._held(time_s)) / self._width_K
        return np.asarray(bias + sum(part.at(time_s)[:, 0] for part in self._flicker))

    def forget_after(self, time_s: float) -> None:
        """Compute again what the air makes of the gyro from a time on."""
        self.bodies.forget_after(time_s)
        del self._held_degC[max(int(time_s / PLAY_CELL_S), 0) + 1 :]

    def _followed(self, temperature_degC: Array) -> Array:
        """Return what the bias follows: the two bodies (times, 2) as lags one after the other."""
        first, second = temperature_degC.T
        lag_s, sensor_lag_s = self._lag_s, self._sensor_lag_s
        return np.asarray((lag_s * first - sensor_lag_s * second) / (lag_s - sensor_lag_s))

    def _held(self, time_s: Array) -> Array:
        """Return where the play of the loop is held at each time, degC."""
        known = len(self._held_degC)
        last = max(int(time_s.max() / PLAY_CELL_S), 0) + 1
        if last >= known:
            cells_s = PLAY_CELL_S * np.arange(known, last + 1, dtype=np.float64)
            held = self._held_degC[-1]
            followed = self._followed(self.bodies.temperature_and_rate(cells_s)[0])
            for value in followed.tolist():
                held = min(max(held, value - self._width_K), value + self._width_K)
                self._held_degC.append(held)
        first = max(int(time_s.min() / PLAY_CELL_S), 0)
        cells = np.arange(first, last + 1)
        return np.interp(time_s / PLAY_CELL_S, cells, self._held_degC[first : last + 1])


class BiasTemperatureBench(StaticLaserGyro):
    """A gyro on a plate in a chamber, in no field.

    Truth below `simulation.bias_temperature`: `lag` of the gyro's temperature behind the chamber's
    air and `sensor_lag` of what its bias follows behind that; `self_heating` by which it is warmer
    in the end; `curve` (`u0` to `u3`, of the powers of u, which goes from -1 to 1 over
    `temperature_range`, `low` to `high`); `rate_sensitivity` to the rate of its temperature;
    `hysteresis` (`size` warming less cooling, and the `half_width` of the play);
    `angle_random_walk`, `bias_instability`, `rate_random_walk_in_one_hour`; `sensor_offset` and
    `sensor_noise` of its thermometer. The chamber is that of `simulation.fog`, channel and
    direction those of `simulation.gyro`.
    """

    preparations: tuple[str, ...] = ("mount-in-chamber", "connect-cables", "dut-power-on")

    def __init__(self, truth: Truth) -> None:
        self.chamber = Chamber(truth.section("fog").section("chamber"), self._air_changed)
        super().__init__(truth)
        self.acts["mount-in-chamber"] = (
            nothing,
            "The simulated gyro stands in the chamber, its input axis up, the door closed.",
        )
        self.temperatures = {DEVICE: self._own.body_degC, CHAMBER: self.chamber.air_degC}

    def power(self, time_s: float, on: bool) -> None:
        """Switch the gyro on, with a bias and a heat of its own, or off."""
        super().power(time_s, on)
        self._heat(time_s)

    def darken_gyro(self, time_s: float, dark: bool) -> None:
        """Put the gyro's discharge out, or let it come back."""
        super().darken_gyro(time_s, dark)
        self._heat(time_s)

    def gyro_angle_arcsec(self, edges_s: Array) -> Array:
        """Return the angle, noise aside, that the gyro turns between neighbouring times."""
        gyro, none = self._own, np.zeros((edges_s.size - 1, 3))
        drift = gyro.drift_deg_per_h(0.5 * (edges_s[1:] + edges_s[:-1]))
        on_s = np.diff(gyro.heat.on_time(edges_s))
        return np.asarray(gyro.steady_angle_arcsec(edges_s, none, none) + drift * on_s)

    def _make_gyro(self, truth: Truth) -> GyroInChamber:
        """Return the gyro in the chamber."""
        own, seed = truth.section("bias_temperature"), truth.integer("seed", 0)
        self._own = GyroInChamber(truth.section("gyro"), own, self.chamber, seed)
        return self._own

    def _heat(self, time_s: float) -> None:
        self._own.bodies.switch(time_s, self._own.heat.is_on)
        self._own.forget_after(time_s)
        self._changed()

    def _air_changed(self, time_s: float) -> None:
        self._own.forget_after(time_s)
        self._changed()
