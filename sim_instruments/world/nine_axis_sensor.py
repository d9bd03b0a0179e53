"""The simulated nine-axis sensor: what it reads of rates, specific forces and fields."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.coils import AXES, small_rotation, wiring
from sim_instruments.world.laser_gyro import Heat
from sim_instruments.world.noise import Wander, WhiteNoise, generator
from sim_instruments.world.piecewise import Array

Switches = npt.NDArray[np.bool_]

SECONDS_PER_HOUR = 3600.0
PAIRS = (("x", "y"), ("x", "z"), ("y", "x"), ("y", "z"), ("z", "x"), ("z", "y"))
EDGES = ("xy", "xz", "yz")
STANDARD_GRAVITY = 9.80665
CELL_S = 0.005
"""White noise is white up to the 100 Hz of its cells, some way into a sensor's bandwidth."""
FLICKER_CELLS_S = (20.0, 80.0, 320.0, 1280.0, 5120.0)
FLICKER_PART = 0.69
"""What each of the wanders has of the bias instability, for an Allan deviation of 0.664 of it."""


class Means(NamedTuple):
    """What the sensor measures in successive intervals, shape (intervals, 3) each.

    `valid` tells of each gyro whether it stayed within its range; `temperature_degC` has the shape
    (intervals,).
    """

    gyro_deg_per_s: Array
    valid: Switches
    accelerometer_g: Array
    magnetometer_nT: Array
    temperature_degC: Array

    def rows(self, here: slice | npt.NDArray[np.int64]) -> Means:
        """Return what is measured in some of the intervals."""
        return Means._make(means[here] for means in self)


class NineAxisSensor:
    """The sensor, true to its description; its axes are called x, y, z.

    Truth, `gyros`: `range`, at which a gyro saturates; `resolution`; `angle_random_walk`;
    `bias_instability` B (IEEE Std 952: flicker noise whose Allan deviation is 0.664 B, here between
    20 s and some hours); below `x`, `y`, `z` each `bias`, `scale_factor_error`, `asymmetry` (of
    the positive sense over the negative one), `ripple` (`amplitude` and `period` of what the scale
    factor changes with the rate); `misalignment` `xy`, …, the angle by which the gyro x feels the
    rate about y; `wiring`: which gyro each axis shows, such as `{x: y, y: -x}`, its own without.
    `warm_up`: how much larger the biases are at switching on, `time_constant`,
    `temperature_rise` over the `room`.

    `accelerometers`: `bias` and `scale_factor_error` by axis, `noise_in_one_second`.
    `magnetometers`: `offset` (hard iron) and `scale_factor_error` by axis, `noise_in_one_second`.
    What may stand there beside: of the gyros `g_sensitivity` (`xx`, `xy`, …: gyro, axis of the
    force); of the accelerometers `nonorthogonality` (`xy` `xz` `yz`, 90 deg less the angle of the
    axes), `second_order`, `boresight` (their frame is turned by it about the base's axes),
    `lever_arm` from the table's axis; of the magnetometers `misalignment` (`xy`, …, soft iron too).
    """

    def __init__(self, truth: Truth, room_degC: float, seed: int) -> None:
        gyros = truth.section("gyros")
        self.range_deg_per_s = gyros.quantity("range", "deg/s")
        self._step = gyros.quantity("resolution", "deg/s")
        if min(self.range_deg_per_s, self._step) <= 0.0:
            raise SimulationError(f"{gyros.where}: range and resolution must be positive")
        own = [gyros.section(axis) for axis in AXES]
        self._bias = np.array([axis.quantity("bias", "deg/h") for axis in own])
        self._scale = np.array([1.0 + axis.quantity("scale_factor_error", "1") for axis in own])
        self._asymmetry = np.array([axis.quantity("asymmetry", "1") for axis in own])
        ripple = [axis.section("ripple") for axis in own]
        self._ripple = np.array([axis.quantity("amplitude", "1") for axis in ripple])
        self._per_rate = 2 * np.pi / np.array([axis.quantity("period", "deg/s") for axis in ripple])
        self._cross = np.eye(3)
        leans = gyros.section("misalignment")
        for gyro, other in PAIRS:
            place = AXES.index(gyro), AXES.index(other)
            self._cross[place] = leans.quantity(gyro + other, "rad")
        self._wiring = wiring(gyros)
        warm_up = truth.section("warm_up")
        self.heat = Heat(warm_up.quantity("time_constant", "s"))
        self._warm_up = warm_up.quantity("bias", "deg/h")
        self._rise_K = warm_up.quantity("temperature_rise", "K")
        self._room_degC = room_degC
        white = gyros.quantity("angle_random_walk", "deg/sqrt(h)") / np.sqrt(SECONDS_PER_HOUR)
        self._noise = _white(white, seed, "gyro")
        flicker = np.full(3, FLICKER_PART * gyros.quantity("bias_instability", "deg/h"))
        self._flicker = [
            Wander(flicker, cell_s, generator(seed, f"nine-axis flicker {cell_s:g} s"))
            for cell_s in FLICKER_CELLS_S
        ]
        self._per_g = np.array(
            [gyros.errors("g_sensitivity", [a + b for b in AXES], "deg/h/g") for a in AXES]
        )
        accelerometers = truth.section("accelerometers")
        self._accelerometers = _Triad(accelerometers, "bias", "g", seed, _in_own_frame)
        self._lever_arm_m = np.array(accelerometers.errors("lever_arm", AXES, "mm")) / 1000.0
        self._magnetometers = _Triad(truth.section("magnetometers"), "offset", "nT", seed, _leaning)

    def scale_factor(self, rate_deg_per_s: Array) -> Array:
        """Return measured over true rate, bias aside, at true rates (n, 3), of each gyro."""
        ripple = self._ripple * np.sin(self._per_rate * np.abs(rate_deg_per_s))
        sense = 0.5 * self._asymmetry * np.sign(rate_deg_per_s)
        return np.asarray(self._scale * (1.0 + ripple + sense))

    def bias_deg_per_h(self, time_s: Array) -> Array:
        """Return the gyros' biases at each time, shape (times, 3), white noise aside."""
        wander = np.sum([flicker.at(time_s) for flicker in self._flicker], axis=0)
        cold = 1.0 - self.heat.warmth(time_s)[:, None]
        return np.asarray(self._bias + self._warm_up * cold + wander)

    def temperature_degC(self, time_s: Array) -> Array:
        """Return the sensor's temperature at each time."""
        return np.asarray(self._room_degC + self._rise_K * self.heat.warmth(time_s))

    def measure(self, edges_s: Array, rate_deg_per_s: Array, force_g: Array, nT: Array) -> Means:
        """Return what it measures between neighbouring times.

        Of true means, shape (intervals, 3) each, along its axes: the rate, the specific force (1 g
        up at rest) and the magnetic field.
        """
        middles_s = 0.5 * (edges_s[:-1] + edges_s[1:])
        felt = rate_deg_per_s @ self._cross.T
        read = self.scale_factor(rate_deg_per_s) * felt
        read += (self.bias_deg_per_h(middles_s) + force_g @ self._per_g.T) / SECONDS_PER_HOUR
        read += _means(self._noise, edges_s)
        read = np.round(read / self._step) * self._step @ self._wiring.T
        return Means(
            np.clip(read, -self.range_deg_per_s, self.range_deg_per_s),
            np.abs(read) < self.range_deg_per_s,
            self._accelerometers.reads(edges_s, force_g + self._turned_g(rate_deg_per_s)),
            self._magnetometers.reads(edges_s, nT),
            self.temperature_degC(middles_s),
        )

    def _turned_g(self, rate_deg_per_s: Array) -> Array:
        """Return the specific force of turning at steady rates (n, 3), the lever arm away."""
        rate = np.radians(rate_deg_per_s)
        return np.asarray(np.cross(rate, np.cross(rate, self._lever_arm_m)) / STANDARD_GRAVITY)


class _Triad:
    """Three sensors with an offset, scale factors, directions and white noise.

    `towards` reads from the truth what turns true vectors into those along the input axes.
    """

    def __init__(
        self,
        truth: Truth,
        offset: str,
        unit: str,
        seed: int,
        towards: Callable[[Truth], Array],
    ) -> None:
        self._towards = towards(truth)
        self._second_per_unit = np.array(truth.errors("second_order", AXES, "ug/g^2")) * 1e-6
        self._offset = np.array(truth.quantities(offset, AXES, unit))
        self._scale = 1.0 + np.array(truth.quantities("scale_factor_error", AXES, "1"))
        self._noise = _white(truth.quantity("noise_in_one_second", unit), seed, truth.where)

    def reads(self, edges_s: Array, true: Array) -> Array:
        felt = true @ self._towards.T
        read = self._offset + self._scale * felt + self._second_per_unit * felt**2
        return np.asarray(read + _means(self._noise, edges_s))


def _in_own_frame(truth: Truth) -> Array:
    """Return (I + N) R: the accelerometers' own frame is turned, its axes lean symmetrically."""
    turned = small_rotation(truth, "boresight").T if "boresight" in truth else np.eye(3)
    shape = np.eye(3)
    for pair, angle in zip(EDGES, truth.errors("nonorthogonality", EDGES, "rad"), strict=True):
        i, j = (AXES.index(axis) for axis in pair)
        shape[i, j] = shape[j, i] = angle / 2.0
    return np.asarray(shape @ turned)


def _leaning(truth: Truth) -> Array:
    """Return what each axis feels of the others, too: directions and soft iron."""
    towards = np.eye(3)
    names = [first + second for first, second in PAIRS]
    for (first, second), angle in zip(
        PAIRS, truth.errors("misalignment", names, "rad"), strict=True
    ):
        towards[AXES.index(first), AXES.index(second)] = angle
    return towards


def _white(in_one_second: float, seed: int, name: str) -> list[WhiteNoise]:
    """Return the noise of three axes, of so much in the mean over a second."""
    return [
        WhiteNoise(in_one_second, generator(seed, f"nine-axis {name} {axis}"), CELL_S)
        for axis in AXES
    ]


def _means(noise: list[WhiteNoise], edges_s: Array) -> Array:
    return np.column_stack([noise_source.mean(edges_s) for noise_source in noise])
