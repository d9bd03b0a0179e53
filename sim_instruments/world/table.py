"""A three-axis table: from the true angles of its axes, each known over all time, its attitude.

Frames: n is north, east, down; at angles of zero the inner axis' plate lies along n, its x forward,
y right, z down. A positive turn is right-handed about the axis' direction, so that one about z
(down) is clockwise from above, and a heading grows.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.chamber import ignore_change
from sim_instruments.world.coils import AXES
from sim_instruments.world.laser_gyro import EARTH_RATE_DEG_PER_H
from sim_instruments.world.noise import Wander, generator
from sim_instruments.world.piecewise import Array
from sim_instruments.world.rotation import RotationHistory

RINGS = ("outer", "middle", "inner")
WANDER_CELL_S = 10.0
MOMENT_S = 1e-3
DEG = np.pi / 180.0
RAD_PER_S = np.pi / 180.0 / 3600.0
"""One degree per hour."""


def earth_rate_rad_per_s(latitude_deg: float) -> Array:
    """Return the earth's rate along north, east and down at a latitude."""
    latitude = np.radians(latitude_deg)
    along = np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    return np.asarray(EARTH_RATE_DEG_PER_H * RAD_PER_S * along)


class Motion(NamedTuple):
    """Plate to n, shape (times, 3, 3), and the plate's rate against n, along n, in rad/s."""

    attitude: Array
    rate_rad_per_s: Array


class _Ring:
    """One axis: its direction when the axes outside of it are at zero."""

    def __init__(self, truth: Truth, changed: Callable[[], None]) -> None:
        self.number = truth.integer("axis", 1)
        along = truth.text("along")
        if along not in AXES:
            raise SimulationError(f"{truth.where}.along: x, y or z was expected, got {along!r}")
        lean = truth.section("lean")
        towards = [
            1.0 if axis == along else np.tan(lean.quantity(f"towards_{axis}", "rad"))
            for axis in AXES
        ]
        sense = -1.0 if truth.switch("reversed") else 1.0
        self.direction = sense * np.array(towards) / np.linalg.norm(towards)
        x, y, z = self.direction
        self._cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        self._square = self._cross @ self._cross
        self.rotation = RotationHistory(truth.quantity("angle_at_start", "deg"), changed)

    def turned(self, angle_deg: Array) -> Array:
        """Return the rotations by angles, shape (angles, 3, 3)."""
        angle = (angle_deg * DEG)[:, None, None]
        return np.asarray(
            np.eye(3) + np.sin(angle) * self._cross + (1.0 - np.cos(angle)) * self._square
        )


class Table:
    """Three axes, from the `outer` one, which carries the others, to the `inner` one.

    Truth: for each its number (`axis`) by which the controller calls it, the direction that it is
    `along`, from which it leans (`lean`) `towards_…` the two others, `angle_at_start`, and
    `reversed` where it turns against its stated sense; `wander` by which each axis truly moves
    about where its encoder has it. Who turns the table turns the
    histories of its axes; `changed` is called with the time from which something does.
    """

    def __init__(
        self,
        truth: Truth,
        rng: np.random.Generator,
        changed: Callable[[float], None] = ignore_change,
    ) -> None:
        self._changed = changed
        self._rings = [
            _Ring(truth.section(name), partial(self._moved, place))
            for place, name in enumerate(RINGS)
        ]
        self._resting: tuple[Array, list[Array]] | None = None
        self._by_number = {ring.number: ring.rotation for ring in self._rings}
        if sorted(self._by_number) != [1, 2, 3]:
            raise SimulationError(f"{truth.where}: the axes must have the numbers 1, 2 and 3")
        wander = np.full(3, truth.quantity("wander", "deg"))
        self._wander = Wander(wander, WANDER_CELL_S, rng)

    @classmethod
    def of_bench(cls, truth: Truth, changed: Callable[[float], None]) -> Table:
        """Return the table of a bench, described below `fog.table`."""
        rng = generator(truth.integer("seed", 0), "table")
        return cls(truth.section("fog").section("table"), rng, changed)

    def axis(self, number: int) -> RotationHistory:
        """Return where an axis truly is; SimulationError when there is none of that number."""
        if number not in self._by_number:
            raise SimulationError(f"the simulated table has the axes 1, 2 and 3, not {number}")
        return self._by_number[number]

    @property
    def rests_from_s(self) -> float:
        """The time from which all axes stand still as commanded; infinite if never."""
        return max(ring.rotation.at_rest_from_s for ring in self._rings)

    def motion(self, time_s: Array) -> Motion:
        """Return attitude and rate of the plate at each time, as the axes are commanded."""
        return self._motion(time_s)[0]

    def attitude(self, time_s: Array) -> Array:
        """Return plate to n at each time, the wander of the axes included, (times, 3, 3)."""
        (attitude, _), axes = self._motion(time_s)
        wander = DEG * self._wander.at(time_s)
        outer, middle, inner = axes
        x, y, z = (wander[:, :1] * outer + wander[:, 1:2] * middle + wander[:, 2:] * inner).T
        none = np.zeros_like(x)
        cross = np.array(((none, -z, y), (z, none, -x), (-y, x, none))).transpose(2, 0, 1)
        turned = cross @ attitude
        # To second order: an attitude near the vertical must be a rotation to be taken apart.
        return np.asarray(attitude + turned + 0.5 * (cross @ turned))

    def _motion(self, time_s: Array) -> tuple[Motion, list[Array]]:
        """Return the motion, and the directions of the axes along n, each (times or 1, 3)."""
        if time_s.size and self.rests_from_s <= time_s.min():
            if self._resting is None:
                motion, axes = self._computed(time_s[:1])
                self._resting = motion.attitude, axes
            attitude, axes = self._resting
            return Motion(
                np.broadcast_to(attitude, (time_s.size, 3, 3)), np.zeros((time_s.size, 3))
            ), axes
        return self._computed(time_s)

    def _computed(self, time_s: Array) -> tuple[Motion, list[Array]]:
        attitude = np.broadcast_to(np.eye(3), (time_s.size, 3, 3))
        rate, axes = np.zeros((time_s.size, 3)), []
        for ring in self._rings:
            angle_deg, speed = ring.rotation.angle_and_rate(time_s)
            axes.append(attitude @ ring.direction)
            rate += (speed * DEG)[:, None] * axes[-1]
            attitude = attitude @ ring.turned(angle_deg)
        return Motion(attitude, rate), axes

    def breakpoints(self, first_s: float, last_s: float) -> Array:
        """Return the times between two others at which the acceleration of an axis changes."""
        times = [ring.rotation.breakpoints(first_s, last_s) for ring in self._rings]
        together = np.concatenate(times)
        return np.unique(together) if together.size else together

    def speed_and_acceleration(self, time_s: Array) -> tuple[Array, Array]:
        """Return the largest rate and acceleration of an axis just after each time.

        In deg/s and deg/s²; right where no acceleration changes within a millisecond.
        """
        both_s = np.concatenate((time_s, time_s + MOMENT_S))
        rates = np.array([ring.rotation.rate_deg_per_s(both_s) for ring in self._rings])
        now, later = rates[:, : time_s.size], rates[:, time_s.size :]
        return np.abs(now).max(axis=0), np.abs(later - now).max(axis=0) / MOMENT_S

    def still_from(self, time_s: float, for_s: float) -> float:
        """Return when the table will have stood still for a time that began at `time_s` or later.

        By what the axes have been commanded so far; infinite when they turn for ever.
        """
        edges = [time_s, *self.breakpoints(time_s, np.inf).tolist(), np.inf]
        rested_s = time_s
        for begin_s, end_s in pairwise(edges):
            middle = np.array([begin_s + min(0.37 * (end_s - begin_s), 1.0)])
            if any(ring.rotation.rate_deg_per_s(middle)[0] for ring in self._rings):
                rested_s = end_s
            elif end_s - rested_s >= for_s:
                return rested_s + for_s
        return np.inf

    def _moved(self, place: int) -> None:
        self._resting = None
        self._changed(self._rings[place].rotation.commanded_s)
