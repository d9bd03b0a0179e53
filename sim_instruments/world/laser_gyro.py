"""The world of the laser gyro: a three-axis coil, a field probe, the gyro and its pulses.

Rates are in deg/h and angles in arcsec: 1 deg/h is 1 arcsec/s.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.base import World
from sim_instruments.world.coils import (
    AXES,
    HelmholtzPair,
    field_matrix_mT_per_A,
    small_rotation,
)
from sim_instruments.world.currents import mean_products
from sim_instruments.world.piecewise import LONG_AGO_S, Array

EARTH_RATE_DEG_PER_H = 15.041067
PROBE_MOVE_MM = 80.0
GYRO_AXES = ("IA", "NA", "LA")


class Heat:
    """How warm the switched-on device is: 0 cold, 1 in its final state; first order."""

    def __init__(self, tau_s: float) -> None:
        self.tau_s = tau_s
        self._starts = [LONG_AGO_S]
        self._on = [0.0]
        self._warmth = [0.0]
        self._on_time = [0.0]
        self._warm_time = [0.0]

    @property
    def is_on(self) -> bool:
        """Whether the device is switched on now."""
        return self._on[-1] > 0.5

    def switch(self, time_s: float, on: bool) -> None:
        """Switch on or off at `time_s`; a repeated switch changes nothing."""
        if on == self.is_on:
            return
        at = np.array([time_s])
        on_time, warm_time = self.on_time(at), self.warm_time(at)
        self._warmth.append(float(self.warmth(at)[0]))
        self._on_time.append(float(on_time[0]))
        self._warm_time.append(float(warm_time[0]))
        self._on.append(1.0 if on else 0.0)
        self._starts.append(time_s)

    def warmth(self, time_s: Array) -> Array:
        """Return the warmth at each time."""
        k, elapsed = self._piece(time_s)
        final, first = np.array(self._on)[k], np.array(self._warmth)[k]
        return np.asarray(final + (first - final) * np.exp(-elapsed / self.tau_s))

    def on_time(self, time_s: Array) -> Array:
        """Return the time spent switched on up to each time, in s."""
        k, elapsed = self._piece(time_s)
        return np.asarray(np.array(self._on_time)[k] + np.array(self._on)[k] * elapsed)

    def warm_time(self, time_s: Array) -> Array:
        """Return the integral of the warmth over the time spent switched on, in s."""
        k, elapsed = self._piece(time_s)
        final, first = np.array(self._on)[k], np.array(self._warmth)[k]
        gained = final * elapsed - (first - final) * self.tau_s * np.expm1(-elapsed / self.tau_s)
        return np.asarray(np.array(self._warm_time)[k] + np.array(self._on)[k] * gained)

    def _piece(self, time_s: Array) -> tuple[npt.NDArray[np.int64], Array]:
        starts = np.array(self._starts)
        k = np.clip(np.searchsorted(starts, time_s, side="right") - 1, 0, None)
        return k, np.maximum(time_s - starts[k], 0.0)


class LaserGyro:
    """A single-axis laser gyro, true to its description; see the bench file for every number."""

    def __init__(self, truth: Truth) -> None:
        self.channel = truth.integer("channel", 1)
        latitude = truth.quantity("latitude", "rad")
        axis = truth.section("input_axis")
        azimuth, elevation = axis.quantity("azimuth", "rad"), axis.quantity("elevation", "rad")
        self.earth_rate_deg_per_h = EARTH_RATE_DEG_PER_H * float(
            np.cos(latitude) * np.cos(azimuth) * np.cos(elevation)
            + np.sin(latitude) * np.sin(elevation)
        )
        self.bias_deg_per_h = truth.quantity("bias", "deg/h")
        # White noise of Q0 deg/sqrt(h) makes an angle of 60 Q0 sqrt(t) arcsec after t seconds.
        self.white_arcsec = 60.0 * truth.quantity("angle_random_walk", "deg/sqrt(h)")
        self.walk_deg_per_h = truth.quantity("rate_random_walk_in_one_hour", "deg/h")
        self.dither_arcsec = truth.quantity("dither_residual", "arcsec")
        self.pulse_arcsec = truth.quantity("pulse_weight", "arcsec")
        if self.pulse_arcsec <= 0:
            raise SimulationError(f"{truth.where}.pulse_weight: must be positive")
        warm_up = truth.section("warm_up")
        self.warm_up_deg_per_h = warm_up.quantity("amplitude", "deg/h")
        self.heat = Heat(warm_up.quantity("time_constant", "s"))
        self._ambient_degC = warm_up.quantity("ambient_temperature", "degC")
        self._rise_K = warm_up.quantity("temperature_rise", "K")
        self._overheated_since_s, self._overheated_K = [LONG_AGO_S], [0.0]
        self.sensitivity = np.array(truth.quantities("magnetic_sensitivity", GYRO_AXES, "deg/h/mT"))
        # A unit of its own for deg/h/mT² is not in the unit table: per mT stands in the name.
        self.quadratic = np.array(
            truth.quantities("quadratic_sensitivity_per_mT", GYRO_AXES, "deg/h/mT")
        )

    def temperature_degC(self, time_s: Array) -> Array:
        """Return the gyro's temperature at each time."""
        own_K = self._rise_K * self.heat.warmth(time_s)
        return np.asarray(self._ambient_degC + own_K + self._extra_K(time_s))

    def overheat(self, time_s: float, rise_K: float) -> None:
        """Be `rise_K` warmer than the warm-up says from `time_s` on; the rate is as before."""
        self._overheated_since_s.append(time_s)
        self._overheated_K.append(rise_K)

    def _extra_K(self, time_s: Array) -> Array:
        """Return by how much it is warmer at each time than it should be."""
        k = np.searchsorted(self._overheated_since_s, time_s, side="right") - 1
        return np.array(self._overheated_K)[np.clip(k, 0, None)]

    def steady_angle_arcsec(
        self, edges_s: Array, field_mT: Array, field_squared_mT2: Array
    ) -> Array:
        """Return the angle, noise aside, turned between neighbouring times, shape (intervals,).

        `field_mT` and `field_squared_mT2` are the interval means of the field on IA, NA, LA and
        of its square, both of shape (intervals, 3). While switched off nothing is counted.
        """
        on = np.diff(self.heat.on_time(edges_s))
        cold = on - np.diff(self.heat.warm_time(edges_s))
        magnetic = field_mT @ self.sensitivity + field_squared_mT2 @ self.quadratic
        steady = self.earth_rate_deg_per_h + self.bias_deg_per_h + magnetic
        return np.asarray(steady * on + self.warm_up_deg_per_h * cold)


class PulseNoise:
    """The gyro's random part, sample by sample of one acquisition with equal intervals.

    Drawn in whole blocks from the start of the acquisition, so that a sample's noise does not
    depend on who looks when.
    """

    BLOCK = 1024

    def __init__(
        self, gyro: LaserGyro, rng: np.random.Generator, interval_s: float, rate_deg_per_h: float
    ) -> None:
        self._gyro = gyro
        self._rng = rng
        self._interval_s = interval_s
        self._first = 0
        self._walk = np.array([rate_deg_per_h])
        self._angles = np.empty(0)
        self._dither = np.empty(0)
        self.phase = float(rng.random())

    def angle_steps_arcsec(self, first: int, count: int) -> Array:
        """Return the random angle turned in samples `first` to `first + count - 1` (from 0)."""
        self._reach(first, count)
        return self._angles[first - self._first : first - self._first + count]

    def dither_arcsec(self, first: int, count: int) -> Array:
        """Return what is left of the dither at the end of the same samples."""
        self._reach(first, count)
        return self._dither[first - self._first : first - self._first + count]

    def rate_deg_per_h(self, samples: int) -> float:
        """Return the random walk of the rate after `samples` samples."""
        self._reach(max(samples - 1, 0), 1)
        return float(self._walk[samples - self._first])

    def _reach(self, first: int, count: int) -> None:
        if first - self._first > 4 * self.BLOCK:
            # What is long past is asked for no more.
            drop = first - self._first - 2 * self.BLOCK
            self._walk, self._angles = self._walk[drop:], self._angles[drop:]
            self._dither = self._dither[drop:]
            self._first += drop
        while self._first + self._angles.size < first + count:
            draws = self._rng.standard_normal((3, self.BLOCK))
            step = self._gyro.walk_deg_per_h * np.sqrt(self._interval_s / 3600.0)
            walk = self._walk[-1] + np.cumsum(step * draws[1])
            before = np.concatenate((self._walk[-1:], walk[:-1]))
            white = self._gyro.white_arcsec * np.sqrt(self._interval_s) * draws[0]
            angles = white + (before + walk) / 2 * self._interval_s
            self._angles = np.concatenate((self._angles, angles))
            self._dither = np.concatenate((self._dither, self._gyro.dither_arcsec * draws[2]))
            self._walk = np.concatenate((self._walk, walk))


class LaserGyroBench(World):
    """Currents in the coils, the field they make, and the gyro that feels it.

    `soft_iron` near the gyro may add its share to the field along `x`, `y` and `z` there; the probe
    does not feel it.
    """

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        self.mounted = True
        self.probe_axis = "x"
        self._powered = self._gyro_dark = False
        coils = truth.section("coils")
        sections = [coils.section(axis) for axis in AXES]
        self.pairs = [
            HelmholtzPair(axis, section) for axis, section in zip(AXES, sections, strict=True)
        ]
        # A strong coil, where the bench has one, stands elsewhere and is not felt here.
        self._felt = [self.currents[axis] for axis in AXES]
        self._probe_mm = np.array(truth.quantities("probe_position", AXES, "mm"))
        self._move_probe(np.zeros(3), 0.0)
        gyro = truth.section("gyro")
        self.gyro = self._make_gyro(truth)
        mounting = small_rotation(gyro, "mounting_error")
        centre = field_matrix_mT_per_A(self.pairs, np.zeros(3))
        iron = np.diag(1.0 + np.array(gyro.errors("soft_iron", AXES, "1")))
        self.gyro_mT_per_A = mounting @ iron @ centre
        self.gyro_ambient_mT = mounting @ iron @ self.ambient_mT
        if gyro.switch("powered_at_start"):
            self.power(0.0, True)
        self.acts = {
            "place-probe": (
                partial(self._move_probe, np.zeros(3)),
                "The simulated probe stood at the place of the device.",
            ),
            "move-probe-back": (
                partial(self._move_probe, np.zeros(3)),
                "The simulated probe was put back to the place of the device.",
            ),
            **{
                f"move-probe-{axis}-{word}": (
                    partial(self._move_probe, sign * PROBE_MOVE_MM * np.eye(3)[k]),
                    f"The simulated probe was moved by {PROBE_MOVE_MM:g} mm along {axis}, {word}.",
                )
                for k, axis in enumerate(AXES)
                for word, sign in (("plus", 1.0), ("minus", -1.0))
            },
            "mount": (
                self._mount,
                "The simulated gyro stands in the middle of the coils, IA NA LA along x y z.",
            ),
            **self.usual_acts(
                "The simulated gyro was switched on and warms up.",
                "The simulated gyro was switched off.",
            ),
            **{
                f"turn-probe-{axis}": (
                    partial(self._turn_probe, axis),
                    f"The simulated probe was turned along {axis}.",
                )
                for axis in AXES
            },
        }

    @property
    def dut_powered(self) -> bool:
        """Whether the gyro is switched on."""
        return self._powered

    def power(self, time_s: float, on: bool) -> None:
        """Switch the gyro on, which starts its warm-up, or off."""
        self._powered = on
        self.gyro.heat.switch(time_s, on and not self._gyro_dark)
        self._changed()

    def darken_gyro(self, time_s: float, dark: bool) -> None:
        """Put the gyro's discharge out, or let it come back, whatever its power does."""
        self._gyro_dark = dark
        self.gyro.heat.switch(time_s, self._powered and not dark)
        self._changed()

    def overheat_gyro(self, time_s: float, rise_K: float) -> None:
        """Make the gyro warmer than it should be, as by a blocked cooling; 0 ends it."""
        self.gyro.overheat(time_s, rise_K)
        self._changed()

    def mean_probe_field_mT(self, edges_s: Array) -> Array:
        """Return the mean field at the probe between neighbouring times, shape (intervals, 3)."""
        return np.asarray(self.ambient_mT + self._mean_currents(edges_s) @ self.probe_mT_per_A.T)

    def gyro_angle_arcsec(self, edges_s: Array) -> Array:
        """Return the angle, noise aside, that the gyro turns between neighbouring times."""
        mean_A = self._mean_currents(edges_s)
        field = self.gyro_ambient_mT + mean_A @ self.gyro_mT_per_A.T
        squared = np.zeros_like(field)
        if self.gyro.quadratic.any():
            products = mean_products(self._felt, edges_s)
            matrix, ambient = self.gyro_mT_per_A, self.gyro_ambient_mT
            coil = field - ambient
            squared = (
                ambient**2
                + 2.0 * ambient * coil
                + np.einsum("aj,njk,ak->na", matrix, products, matrix, optimize=True)
            )
        return self.gyro.steady_angle_arcsec(edges_s, field, squared)

    def _make_gyro(self, truth: Truth) -> LaserGyro:
        """Return the gyro of this world."""
        return LaserGyro(truth.section("gyro"))

    def _mount(self, time_s: float) -> None:
        self.mounted = True

    def _move_probe(self, shift_mm: Array, time_s: float) -> None:
        probe_m = (self._probe_mm + shift_mm) * 1e-3
        self.probe_mT_per_A = field_matrix_mT_per_A(self.pairs, probe_m)
        self._changed()

    def _turn_probe(self, axis: str, time_s: float) -> None:
        self.probe_axis = axis

    def _mean_currents(self, edges_s: Array) -> Array:
        return np.column_stack([history.mean_current(edges_s) for history in self._felt])
