"""An inertial navigation system on a table: what it takes for its heading, pitch and roll."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sim_instruments.seeds import generator
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.coils import small_rotation
from sim_instruments.world.fog_gyro import RAD_PER_S, FogGyros
from sim_instruments.world.fog_trajectory import ErrorCourse, matrices, product, quaternions
from sim_instruments.world.laser_gyro import EARTH_RATE_DEG_PER_H
from sim_instruments.world.random_noise import Readings
from sim_instruments.world.table import Table

Array = npt.NDArray[np.float64]

NOISE_CELL_S = 0.05


@dataclass
class _Alignment:
    """One alignment and the navigation after it; `ready_s` is None until it was looked for."""

    begin_s: float
    latitude_deg: float
    error_rad: Array
    end_s: float = np.inf
    ready_s: float | None = None
    course: ErrorCourse | None = None


class Navigator:
    """A strapdown navigator with the gyros x forward, y right, z down; n is north, east, down.

    Its attitude is C_b^n = Rz(heading) Ry(pitch) Rx(roll). Truth: `mounting_error` of its axes on
    the table's plate; `alignment` with its `duration`, for which it must stand still (it begins
    again whenever it is turned), and the sizes of what it gets wrong, `heading_error` and
    `level_error`; `levelling`, the time constant by which its accelerometers bring it back to the
    vertical; `heading_noise` and `level_noise` of what it puts out. The heading is corrected by
    nothing.
    """

    def __init__(
        self, truth: Truth, table: Table, gyros: FogGyros, latitude_deg: float, seed: int
    ) -> None:
        self._table, self._gyros, self._seed = table, gyros, seed
        self._earth = earth_rate_rad_per_s(latitude_deg)
        # From the navigator's axes to those of the plate.
        self._mounting = small_rotation(truth, "mounting_error").T
        alignment = truth.section("alignment")
        self._takes_s = alignment.quantity("duration", "s")
        level, heading = (alignment.quantity(f"{one}_error", "rad") for one in ("level", "heading"))
        self._misaligned_rad = np.array([level, level, heading])
        levels_in_s = truth.quantity("levelling", "s")
        if min(levels_in_s, self._takes_s) <= 0.0:
            raise SimulationError(f"{truth.where}: times must be positive")
        self._levelling = 1.0 / levels_in_s
        level, heading = (truth.quantity(f"{one}_noise", "rad") for one in ("level", "heading"))
        sigma = np.array([level, level, heading])
        self._noise = Readings(sigma, NOISE_CELL_S, generator(seed, "navigator-noise"))
        self.powered = False
        self._alignments: list[_Alignment] = []

    def switch(self, time_s: float, on: bool) -> None:
        """Switch on or off from a time on; switched off it forgets its attitude."""
        self.powered = on
        if not on:
            self._end(time_s)

    def align(self, time_s: float, latitude_deg: float) -> None:
        """Begin to align, at a latitude that it is told; nothing happens while it is off."""
        if self.powered:
            self._end(time_s)
            rng = generator(self._seed, f"alignment {len(self._alignments)}")
            error_rad = self._misaligned_rad * rng.standard_normal(3)
            self._alignments.append(_Alignment(time_s, latitude_deg, error_rad))

    def aligned(self, time_s: float) -> bool:
        """Return whether it knows its attitude at a time, by what the table was told so far."""
        return any(self._ready_s(one) <= time_s < one.end_s for one in self._alignments)

    def attitude_deg(self, time_s: Array) -> Array:
        """Return heading (0 to 360), pitch and roll at each time, (times, 3); zeros unaligned."""
        result = np.zeros((time_s.size, 3))
        for one in self._alignments:
            here = (time_s >= one.begin_s) & (time_s < one.end_s)
            if here.any():
                here &= time_s >= self._ready_s(one)
            if here.any():
                result[here] = self._of(one, time_s[here])
        return result

    def forget_after(self, time_s: float) -> None:
        """Compute again what comes after a time, from which the table or the gyros do otherwise."""
        if self._alignments:
            last = self._alignments[-1]
            if last.ready_s is not None and last.ready_s > time_s:
                last.ready_s = last.course = None
            if last.course is not None:
                last.course.forget_after(time_s)

    def _end(self, time_s: float) -> None:
        if self._alignments:
            last = self._alignments[-1]
            last.end_s = min(last.end_s, time_s)

    def _ready_s(self, one: _Alignment) -> float:
        if one.ready_s is None:
            one.ready_s = self._table.still_from(one.begin_s, self._takes_s)
        return one.ready_s

    def _course(self, one: _Alignment) -> ErrorCourse:
        if one.course is None:
            rates = self._earth, earth_rate_rad_per_s(one.latitude_deg)
            one.course = ErrorCourse(
                self._ready_s(one), one.error_rad, self._table, self._errors, rates, self._levelling
            )
        return one.course

    def _of(self, one: _Alignment, time_s: Array) -> Array:
        noise = quaternions(self._noise.at(time_s))
        error = product(noise, self._course(one).at(time_s))
        return angles_deg(matrices(error) @ self._table.attitude(time_s) @ self._mounting)

    def _errors(self, begin_s: Array, at_s: Array, end_s: Array) -> tuple[Array, Array]:
        times = at_s.ravel()
        plate, rate = self._table.motion(times)
        body = plate @ self._mounting
        felt = np.einsum("nji,nj->ni", body, rate + self._earth)
        errors = np.einsum("nij,nj->ni", body, self._gyros.errors_rad_per_s(times, felt))
        # The noise is white: any attitude within the panel does.
        somewhere = body.reshape(*at_s.shape, 3, 3)[:, at_s.shape[1] // 2]
        walks = self._gyros.noise_rad(np.concatenate((begin_s, end_s)))
        noise = walks[begin_s.size :] - walks[: begin_s.size]
        return errors.reshape(*at_s.shape, 3), np.einsum("pij,pj->pi", somewhere, noise)


def earth_rate_rad_per_s(latitude_deg: float) -> Array:
    """Return the earth's rate along north, east and down at a latitude."""
    latitude = np.radians(latitude_deg)
    along = np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    return np.asarray(EARTH_RATE_DEG_PER_H * RAD_PER_S * along)


def angles_deg(attitude: Array) -> Array:
    """Return heading, pitch and roll of attitudes C_b^n, shape (attitudes, 3)."""
    heading = np.degrees(np.arctan2(attitude[:, 1, 0], attitude[:, 0, 0]))
    across = np.hypot(attitude[:, 2, 1], attitude[:, 2, 2])
    pitch = np.degrees(np.arctan2(-attitude[:, 2, 0], across))
    roll = np.degrees(np.arctan2(attitude[:, 2, 1], attitude[:, 2, 2]))
    # Once more, since a heading just below zero is rounded to 360.
    return np.array((heading % 360.0 % 360.0, pitch, roll)).T
