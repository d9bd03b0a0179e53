"""The world of the nine-axis calibration: a sensor on a north-referenced plate, or on a table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.base import World
from sim_instruments.world.coils import AXES, wiring
from sim_instruments.world.laser_gyro import Heat
from sim_instruments.world.noise import Wander, WhiteNoise, generator
from sim_instruments.world.piecewise import Array, Nodes, nodes_within
from sim_instruments.world.table import Table, earth_rate_rad_per_s

Switches = npt.NDArray[np.bool_]

SECONDS_PER_HOUR = 3600.0
PAIRS = (("x", "y"), ("x", "z"), ("y", "x"), ("y", "z"), ("z", "x"), ("z", "y"))
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
        self._accelerometers = _Triad(truth.section("accelerometers"), "bias", "g", seed)
        self._magnetometers = _Triad(truth.section("magnetometers"), "offset", "nT", seed)

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
        read += self.bias_deg_per_h(middles_s) / SECONDS_PER_HOUR
        read += _means(self._noise, edges_s)
        read = np.round(read / self._step) * self._step @ self._wiring.T
        return Means(
            np.clip(read, -self.range_deg_per_s, self.range_deg_per_s),
            np.abs(read) < self.range_deg_per_s,
            self._accelerometers.reads(edges_s, force_g),
            self._magnetometers.reads(edges_s, nT),
            self.temperature_degC(middles_s),
        )


class _Triad:
    """Three sensors with an offset, a scale factor and white noise."""

    def __init__(self, truth: Truth, offset: str, unit: str, seed: int) -> None:
        self._offset = np.array(truth.quantities(offset, AXES, unit))
        self._scale = 1.0 + np.array(truth.quantities("scale_factor_error", AXES, "1"))
        self._noise = _white(truth.quantity("noise_in_one_second", unit), seed, truth.where)

    def reads(self, edges_s: Array, true: Array) -> Array:
        return np.asarray(self._offset + self._scale * true + _means(self._noise, edges_s))


def _white(in_one_second: float, seed: int, name: str) -> list[WhiteNoise]:
    """Return the noise of three axes, of so much in the mean over a second."""
    return [
        WhiteNoise(in_one_second, generator(seed, f"nine-axis {name} {axis}"), CELL_S)
        for axis in AXES
    ]


def _means(noise: list[WhiteNoise], edges_s: Array) -> Array:
    return np.column_stack([noise_source.mean(edges_s) for noise_source in noise])


Axes = tuple[Array, Array, Array]

NORTH, EAST, DOWN = np.eye(3)
POSES: dict[str, Axes] = {
    "1": (EAST, NORTH, -DOWN),
    "2": (-NORTH, EAST, -DOWN),
    "3": (NORTH, -DOWN, EAST),
    "4": (-EAST, -NORTH, -DOWN),
    "5": (NORTH, -EAST, -DOWN),
    "6": (-NORTH, -DOWN, -EAST),
}
"""Where X, Y and Z point on the plate. 1 to 3 are the published positions; 4 to 6 are the same
turned by half a turn about the vertical."""
MOUNTINGS: dict[str, Axes] = {
    "mount-table": (NORTH, -EAST, -DOWN),
    "mount-table-turned": (-NORTH, EAST, -DOWN),
    "mount-X-up": (-DOWN, -EAST, -NORTH),
    "mount-Y-up": (NORTH, -DOWN, EAST),
    "mount-Z-up": (NORTH, -EAST, -DOWN),
}
"""Where X, Y and Z point on the table's plate while its axes are at zero."""
BEFORE_ALL_S = -1e5
MOTORS_AT_DEG_PER_S = 100.0
PANEL_S, ORDER = 0.1, 3
"""At its fastest the table turns some degrees within a panel."""


class _Place(NamedTuple):
    """Where the sensor has been since a time: `axes` are X, Y, Z (rows) along the base's axes."""

    since_s: float
    on_table: bool
    axes: Array


class NineAxisBench(World):
    """A sensor that feels the earth's turn, gravity and the earth's field, and the table's turns.

    The base is north, east, down. Truth below `simulation.nine_axis`: `latitude`; `heading_error`
    of the `plate` and of the `table` (their north lies east of north by that); `placing_error`,
    the size of what the sensor's `heading` and `tilt` are wrong by, anew every time it is put or
    mounted; `magnetic_field` (`north`, `east`, `down`); `table_field`, where the table disturbs it:
    `plate` (`x`, `y`, `z`), fixed to its plate, and `motors` (`north`, `east`, `down`), what they
    add at 100 deg/s; `sensor` (see there), which is on from the beginning where `powered_at_start`
    says so. The table is that of `simulation.fog`.
    """

    preparations: tuple[str, ...] = ("mount-table", "connect-cables", "dut-power-on")

    def __init__(self, truth: Truth, table: Table | None = None) -> None:
        super().__init__(truth)
        self._seed = truth.integer("seed", 0)
        own = truth.section("nine_axis")
        self.table = table or Table.of_bench(truth, self.table_changed)
        self._earth = earth_rate_rad_per_s(own.quantity("latitude", "deg"))
        heading = own.section("heading_error")
        self._plate, self._base = (
            _about_down(heading.quantity(angle, "rad")) for angle in ("plate", "table")
        )
        placing = own.section("placing_error")
        tilt, turned = (placing.quantity(angle, "rad") for angle in ("tilt", "heading"))
        self._misplaced_rad = np.array([tilt, tilt, turned])
        field = ("north", "east", "down")
        self._field_nT = np.array(own.quantities("magnetic_field", field, "nT"))
        room = truth.section("room").quantity("temperature", "degC")
        table_field = own.section("table_field") if "table_field" in own else Truth({}, own.where)
        self._plate_nT = np.array(table_field.errors("plate", AXES, "nT"))
        self._motors_nT = np.array(table_field.errors("motors", field, "nT"))
        sensor = own.section("sensor")
        self.sensor = NineAxisSensor(sensor, room, self._seed)
        # Before anybody takes it, it lies on the bench, its cable somewhere.
        self._places = [_Place(BEFORE_ALL_S, False, _about_down(0.7) @ np.array(POSES["1"]))]
        self._times_put: Counter[str] = Counter()
        self._put_last = ""
        if sensor.switch("powered_at_start"):
            self.sensor.heat.switch(BEFORE_ALL_S, True)
        self.acts = {
            **{
                f"pose-{name}": (
                    partial(self._put, f"pose-{name}", axes),
                    f"The simulated sensor stands on the plate in position {name}.",
                )
                for name, axes in POSES.items()
            },
            **{
                name: (
                    partial(self._mount, name, axes),
                    "The simulated sensor is mounted on the turntable.",
                )
                for name, axes in MOUNTINGS.items()
            },
            **self.usual_acts(
                "The simulated sensor was switched on and warms up.",
                "The simulated sensor was switched off.",
            ),
        }

    @property
    def dut_powered(self) -> bool:
        """Whether the sensor is switched on."""
        return self.sensor.heat.is_on

    @property
    def range_deg_per_s(self) -> float:
        """The rate at which a gyro of the sensor saturates."""
        return self.sensor.range_deg_per_s

    def power(self, time_s: float, on: bool) -> None:
        """Switch the sensor on, which begins its warm-up, or off."""
        with self.lock:
            self.sensor.heat.switch(time_s, on)
            self._changed()

    def nine_axis_means(self, edges_s: Array) -> Means:
        """Return what the sensor measures between neighbouring times."""
        with self.lock:
            rests = self._rests(edges_s)
            panel_s, order = (np.inf, 1) if rests else (PANEL_S, ORDER)
            nodes = nodes_within(edges_s[:-1], edges_s[1:], panel_s, order)
            rate, force, field = (nodes.mean(signal) for signal in self._felt(nodes))
            return self.sensor.measure(edges_s, np.degrees(rate), force, field)

    def table_changed(self, time_s: float) -> None:
        """Forget what was computed ahead: the table turns otherwise."""
        self._changed()

    def attitude(self, time_s: Array) -> Array:
        """Return where X, Y, Z (rows) point along north, east, down, shape (times, 3, 3)."""
        return self._moving(np.asarray(time_s, dtype=np.float64))[0]

    def _mount(self, prompt_id: str, axes: Axes, time_s: float) -> None:
        if self._put_last != prompt_id:  # nobody takes it off to mount it the same way
            self._put(prompt_id, axes, time_s)

    def _put(self, prompt_id: str, axes: Axes, time_s: float) -> None:
        with self.lock:
            # A run that goes on in a world begun anew finds the sensor as it stood.
            self._times_put[prompt_id] += 1
            self._put_last = prompt_id
            name = f"nine-axis placing {prompt_id} {self._times_put[prompt_id]}"
            rng = generator(self._seed, name)
            wrong = Rotation.from_rotvec(self._misplaced_rad * rng.standard_normal(3))
            placed = np.array(axes) @ wrong.as_matrix().T
            self._places.append(_Place(time_s, prompt_id in MOUNTINGS, placed))
            self._changed()

    def _rests(self, edges_s: Array) -> bool:
        """Return whether the sensor stands still between the first and the last time."""
        here = self._places[-1]
        still = not here.on_table or self.table.rests_from_s <= edges_s[0]
        return here.since_s <= edges_s[0] and still

    def _felt(self, nodes: Nodes) -> tuple[Array, Array, Array]:
        """Return the rate in rad/s, the specific force in g and the field in nT, (times, 3)."""
        attitude, rate = self._moving(nodes.time_s)
        force, field = attitude @ -DOWN, attitude @ self._field_nT
        for place, here in self._stays(nodes.time_s):
            if place.on_table:
                turning = np.linalg.norm(rate[here] - self._earth, axis=1)
                motors = np.degrees(turning)[:, None] / MOTORS_AT_DEG_PER_S * self._motors_nT
                moved = np.einsum("nij,nj->ni", attitude[here], motors)
                field[here] += place.axes @ self._plate_nT + moved
        return np.einsum("nij,nj->ni", attitude, rate), force, field

    def _stays(self, time_s: Array) -> Iterator[tuple[_Place, npt.NDArray[np.bool_]]]:
        """Yield where the sensor is at some of the times (n,), and at which."""
        ends_s = [place.since_s for place in self._places[1:]] + [np.inf]
        for place, end_s in zip(self._places, ends_s, strict=True):
            here = (time_s >= place.since_s) & (time_s < end_s)
            if here.any():
                yield place, here

    def _moving(self, time_s: Array) -> tuple[Array, Array]:
        """Return X, Y, Z (rows) along n, (times, 3, 3), and the rate along n, (times, 3)."""
        attitude = np.empty((time_s.size, 3, 3))
        rate = np.tile(self._earth, (time_s.size, 1))
        for place, here in self._stays(time_s):
            if not place.on_table:
                attitude[here] = place.axes @ self._plate.T
                continue
            plate, turning = self.table.motion(time_s[here])
            attitude[here] = place.axes @ (self._base @ plate).transpose(0, 2, 1)
            rate[here] += turning @ self._base.T
        return attitude, rate


def _about_down(angle_rad: float) -> Array:
    """Return the rotation by an angle clockwise from above."""
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, angle_rad]).as_matrix())
