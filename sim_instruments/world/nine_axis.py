"""The world of the nine-axis calibration: a sensor on a north-referenced plate, on a table, or in
the bench's three-axis coil."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from sim_instruments.truth import Truth
from sim_instruments.world.base import World
from sim_instruments.world.coils import (
    AXES,
    HelmholtzPair,
    field_matrix_mT_per_A,
    small_rotation,
)
from sim_instruments.world.nine_axis_sensor import Means, NineAxisSensor
from sim_instruments.world.noise import generator
from sim_instruments.world.piecewise import Array, Nodes, nodes_within
from sim_instruments.world.table import Table, earth_rate_rad_per_s

Axes = tuple[Array, Array, Array]

NORTH, EAST, DOWN = np.eye(3)
COIL_AXES: Axes = (NORTH, -EAST, -DOWN)
"""Where x, y and z of the three-axis coil point."""
IN_COIL = "mount-in-coil"
NT_PER_MT = 1e6
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


def standing(up: Array) -> Axes:
    """Return where X, Y and Z point with a direction (3,) of the sensor up, some way round."""
    north = np.cross(np.eye(3)[int(np.argmin(np.abs(up)))], up)
    north /= np.linalg.norm(north)
    x, y, z = np.column_stack((north, np.cross(-up, north), -up))
    return x, y, z


def directions() -> Iterator[tuple[str, Axes]]:
    """Yield each face, edge and corner of the sensor that can point up, `X-down-Y-up`, and how."""
    ways = {1: "up", -1: "down"}
    for signs in product((0, 1, -1), repeat=3):
        named = [f"{axis}-{ways[sign]}" for axis, sign in zip("XYZ", signs, strict=True) if sign]
        if named:
            yield "-".join(named), standing(np.array(signs) / np.linalg.norm(signs))


DIRECTIONS = dict(directions())
MOUNTINGS |= {f"mount-{axis}-down": DIRECTIONS[f"{axis}-down"] for axis in "XYZ"}
BEFORE_ALL_S = -1e5
MOTORS_AT_DEG_PER_S = 100.0
PANEL_S, ORDER = 0.1, 3
"""At its fastest the table turns some degrees within a panel."""


class _Place(NamedTuple):
    """Where the sensor has been since a time: `axes` are X, Y, Z (rows) along the base's axes."""

    since_s: float
    on_table: bool
    axes: Array
    in_coil: bool = False


class NineAxisBench(World):
    """A sensor that feels the earth's turn, gravity and the earth's field, and the table's turns.

    The base is north, east, down. Truth below `simulation.nine_axis`: `latitude`; `heading_error`
    of the `plate` and of the `table` (their north lies east of north by that); `placing_error`,
    the size of what the sensor's `heading` and `tilt` are wrong by, anew every time it is put or
    mounted; `magnetic_field` (`north`, `east`, `down`); `table_field`, where the table disturbs it:
    `plate` (`x`, `y`, `z`), fixed to its plate, and `motors` (`north`, `east`, `down`), what they
    add at 100 deg/s; `coil_mounting_error`, by which the sensor's axes are turned from those of the
    three-axis coil; `sensor` (see there), which is on from the beginning where `powered_at_start`
    says so. The table is that of `simulation.fog`. In the middle of the coil the sensor feels its
    field and the room's `ambient_field`, as the gaussmeter's probe does at its place beside it.
    """

    preparations: tuple[str, ...] = ("mount-table", "connect-cables", "dut-power-on")
    on_table = True

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
        tilt, turned_rad = (placing.quantity(angle, "rad") for angle in ("tilt", "heading"))
        self._misplaced_rad = np.array([tilt, tilt, turned_rad])
        field = ("north", "east", "down")
        self._field_nT = np.array(own.quantities("magnetic_field", field, "nT"))
        room = truth.section("room").quantity("temperature", "degC")
        table_field = own.section("table_field") if "table_field" in own else Truth({}, own.where)
        self._plate_nT = np.array(table_field.errors("plate", AXES, "nT"))
        self._motors_nT = np.array(table_field.errors("motors", field, "nT"))
        turned = "coil_mounting_error" in own
        lies = small_rotation(own, "coil_mounting_error") if turned else np.eye(3)
        coils = truth.section("coils")
        self._pairs = [HelmholtzPair(axis, coils.section(axis)) for axis in AXES]
        self._probe_mm = np.array(truth.quantities("probe_position", AXES, "mm"))
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
                f"pose-{name}": (
                    partial(self._put, f"pose-{name}", axes),
                    f"The simulated sensor stands on the plate, {name}.",
                )
                for name, axes in DIRECTIONS.items()
            },
            **{
                name: (
                    partial(self._mount, name, axes),
                    "The simulated sensor is mounted on the turntable.",
                )
                for name, axes in MOUNTINGS.items()
            },
            IN_COIL: (
                partial(self._put, IN_COIL, lies @ np.array(COIL_AXES)),
                "The simulated sensor stands in the middle of the coils, X Y Z along x y z.",
            ),
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

    def mean_probe_field_mT(self, edges_s: Array) -> Array:
        """Return the mean field at the probe in the coil, shape (intervals, 3)."""
        mean_A = np.column_stack([self.currents[axis].mean_current(edges_s) for axis in AXES])
        return np.asarray(self.ambient_mT + mean_A @ self._mT_per_A_at(self._probe_mm).T)

    def _coil_field_nT(self, time_s: Array) -> Array:
        """Return the field in the middle of the coil along north, east, down, (times, 3)."""
        now_A = np.column_stack([self.currents[axis].current(time_s) for axis in AXES])
        field_mT = self.ambient_mT + now_A @ self._mT_per_A_at(np.zeros(3)).T
        return NT_PER_MT * field_mT @ np.array(COIL_AXES)

    def _mT_per_A_at(self, place_mm: Array) -> Array:
        return field_matrix_mT_per_A(self._pairs, place_mm * 1e-3)

    def attitude(self, time_s: Array) -> Array:
        """Return where X, Y, Z (rows) point along north, east, down, shape (times, 3, 3)."""
        return self._moving(np.asarray(time_s, dtype=np.float64))[0]

    def _mount(self, prompt_id: str, axes: Axes, time_s: float) -> None:
        if self._put_last != prompt_id:  # nobody takes it off to mount it the same way
            self._put(prompt_id, axes, time_s)

    def _put(self, prompt_id: str, axes: Axes | Array, time_s: float) -> None:
        with self.lock:
            # A run that goes on in a world begun anew finds the sensor as it stood.
            self._times_put[prompt_id] += 1
            self._put_last = prompt_id
            name = f"nine-axis placing {prompt_id} {self._times_put[prompt_id]}"
            rng = generator(self._seed, name)
            wrong = Rotation.from_rotvec(self._misplaced_rad * rng.standard_normal(3))
            placed = np.array(axes) @ wrong.as_matrix().T
            on_table, in_coil = prompt_id in MOUNTINGS, prompt_id == IN_COIL
            self._places.append(_Place(time_s, on_table, placed, in_coil))
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
            if place.in_coil:
                field[here] = self._coil_field_nT(nodes.time_s[here]) @ place.axes.T
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
