"""An inertial navigation system on a table: what it takes for its heading, pitch and roll.

The attitude that it computes is E C, C being the true one. A strapdown navigator turns its attitude
by what its gyros measure and takes the earth rate out; its accelerometers level it. So E follows

    dE/dt = E [C e + w] - [w' + k d x d'] E,   [v] a = v x a,

with e the gyros' errors, w the earth rate, w' what the navigator takes for it, and k the levelling:
d' = E d is what it holds for the vertical d. Solved panel by panel: exactly in the earth's turn, to
first order in the small angle that is gained within a panel, by Gauss's quadrature over the
table's movement. The panels begin anew wherever an axis changes its acceleration and are a few
degrees or seconds long, so that neither who looks nor when makes a difference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.coils import small_rotation
from sim_instruments.world.noise import ReadingNoise, generator
from sim_instruments.world.piecewise import Array, Rows, gauss
from sim_instruments.world.table import MOMENT_S, Table, earth_rate_rad_per_s

ORDER = 3
PANEL_DEG = 12.0
PANEL_TURNING_S, PANEL_RESTING_S = 2.0, 15.0
AT_ONCE = 4096
"""So many panels are computed together, which bounds the memory."""


class ErrorTrajectory:
    """The rotation E, as a quaternion (w, x, y, z), from an alignment on.

    `errors(begin_s, at_s, end_s)` returns, for panels with the times `at_s` in them, C e in rad/s,
    shape (panels, times, 3), and what the gyros' noise makes of them in rad, (panels, 3), both
    along n. `rates` are w and w' in rad/s, `levelling` is k in 1/s.
    """

    def __init__(
        self,
        begin_s: float,
        error: Array,
        table: Table,
        errors: Callable[[Array, Array, Array], tuple[Array, Array]],
        rates: tuple[Array, Array],
        levelling: float,
    ) -> None:
        self._table, self._errors = table, errors
        self._earth, self._assumed = rates
        self._levelling = levelling
        # Time, E, and when the stretch of constant acceleration began that the time is in.
        self._nodes = Rows(6)
        self._nodes.add(begin_s, *quaternions(error[None])[0], begin_s)

    def forget_after(self, time_s: float) -> None:
        """Compute again what comes after a time."""
        kept = np.searchsorted(self._nodes.first, time_s, side="right")
        self._nodes.cut(max(int(kept), 1))

    def at(self, time_s: Array) -> Array:
        """Return E at each time, none of which is before the beginning, shape (times, 4)."""
        edges, stretches = self._panels(float(time_s.max()))
        # All but the last panels in parts, which bounds the memory.
        while edges.size > AT_ONCE:
            some = edges[: AT_ONCE + 1]
            self._follow(some, quaternions(self._gain(some[:-1], some[1:])), stretches[:AT_ONCE])
            edges, stretches = edges[AT_ONCE:], stretches[AT_ONCE:]
        known = self._nodes.all[self._nodes.at(time_s), 0]
        k = edges.searchsorted(time_s, side="right")
        begin_s = np.where(k > 0, edges[k - 1], known)
        starts, ends = np.concatenate((edges[:-1], begin_s)), np.concatenate((edges[1:], time_s))
        turns = quaternions(self._gain(starts, ends))
        self._follow(edges, turns[: edges.size - 1], stretches)
        error = self._nodes.all[self._nodes.at(begin_s), 1:5]
        return self._over(error, time_s - begin_s, turns[edges.size - 1 :])

    def _panels(self, to_s: float) -> tuple[Array, Array]:
        """Return the edges of the panels from the last node on, and the stretches that they end in.

        The edges are equally far from each other from the beginning of a stretch on, however far
        it was known when somebody looked.
        """
        from_s, stretch_s = self._nodes.all[-1, [0, 5]].tolist()
        to_s = max(to_s, from_s)
        if self._table.rests_from_s < from_s:
            numbers = ((np.array([from_s, to_s]) - stretch_s) / PANEL_RESTING_S).astype(np.int64)
            edges = stretch_s + np.arange(numbers[0], numbers[1] + 1) * PANEL_RESTING_S
            edges = np.concatenate(([from_s], edges[edges > from_s]))
            return edges, np.full(edges.size - 1, stretch_s)
        starts = self._table.breakpoints(np.nextafter(from_s, -np.inf), to_s)
        if not starts.size or starts[0] > from_s:
            starts = np.concatenate(([stretch_s], starts))
        ends = np.concatenate((starts[1:], [to_s]))
        speed, acceleration = self._table.speed_and_acceleration(starts)
        # Where it turns: the positive root of a h²/2 + v h = PANEL_DEG.
        turns = (speed > 0.0) | (acceleration > 0.0)
        root = np.sqrt(speed**2 + 2.0 * PANEL_DEG * acceleration)
        root = 2.0 * PANEL_DEG / np.where(turns, speed + root, 1.0)
        longest_s = np.where(turns, np.clip(root, MOMENT_S, PANEL_TURNING_S), PANEL_RESTING_S)
        count = ((ends - starts) / longest_s).astype(np.int64) + 1
        owner = np.repeat(np.arange(starts.size), count)
        number = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
        edges = starts[owner] + number * longest_s[owner]
        new = edges > from_s
        return np.concatenate(([from_s], edges[new])), starts[owner[new]]

    def _gain(self, begin_s: Array, end_s: Array) -> Array:
        """Return the turns that E takes on its right over panels, in rad along n, (panels, 3)."""
        points, weights = gauss(ORDER)
        length = (end_s - begin_s)[:, None]
        at_s = begin_s[:, None] + length * (0.5 + 0.5 * points)
        share = 0.5 * weights * length
        rates, noise = self._errors(begin_s, at_s, end_s)
        # What was gained early in the panel has been levelled since.
        left = np.exp(-self._levelling * (end_s[:, None] - at_s))
        level = np.array((left, left, np.ones_like(left))).transpose(1, 2, 0)
        gained = np.einsum("pk,pki,pki->pi", share, level, rates)
        return np.asarray(gained + noise + length * self._earth)

    def _over(self, error: Array, length_s: Array, turns: Array) -> Array:
        """Return E at the ends of parts of panels, from what it is where they begin."""
        w, x, y, z = error.T
        tilt = 2.0 * np.array((y * z - w * x, -x * z - w * y, np.zeros_like(w))).T
        length = length_s[:, None]
        levelled = -np.expm1(-self._levelling * length) * tilt
        back = quaternions(levelled - length * self._assumed)
        return product(product(back, error), turns)

    def _follow(self, edges_s: Array, turns: Array, stretches_s: Array) -> None:
        """Add the nodes at the ends of panels, one after another, which takes most of the time.

        The same as `_over`, in numbers of Python's own.
        """
        if edges_s.size < 2:
            return
        length = np.diff(edges_s)
        share = (-np.expm1(-self._levelling * length)).tolist()
        earth = (-0.5 * length[:, None] * self._assumed).tolist()
        w, x, y, z = self._nodes.all[-1, 1:5].tolist()
        for end_s, level, (ex, ey, ez), (rw, rx, ry, rz), stretch_s in zip(
            edges_s[1:].tolist(), share, earth, turns.tolist(), stretches_s.tolist(), strict=True
        ):
            bx, by = ex + level * (y * z - w * x), ey - level * (x * z + w * y)
            bw = 1.0 - 0.5 * (bx * bx + by * by + ez * ez)
            w, x, y, z = (
                bw * w - bx * x - by * y - ez * z,
                bw * x + bx * w + by * z - ez * y,
                bw * y - bx * z + by * w + ez * x,
                bw * z + bx * y - by * x + ez * w,
            )
            w, x, y, z = (
                w * rw - x * rx - y * ry - z * rz,
                w * rx + x * rw + y * rz - z * ry,
                w * ry - x * rz + y * rw + z * rx,
                w * rz + x * ry - y * rx + z * rw,
            )
            scale = 1.5 - 0.5 * (w * w + x * x + y * y + z * z)
            w, x, y, z = scale * w, scale * x, scale * y, scale * z
            self._nodes.add(end_s, w, x, y, z, stretch_s)


def quaternions(turn_rad: Array) -> Array:
    """Return the quaternions (w, x, y, z) of rotation vectors, shape (vectors, 4)."""
    angle = np.linalg.norm(turn_rad, axis=1, keepdims=True)
    return np.concatenate((np.cos(0.5 * angle), 0.5 * np.sinc(angle / (2 * np.pi)) * turn_rad), 1)


def product(left: Array, right: Array) -> Array:
    """Return the products of quaternions, row by row."""
    a, b, c, d = left.T
    w, x, y, z = right.T
    return np.array(
        (
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        )
    ).T


def matrices(quaternion: Array) -> Array:
    """Return the matrices of unit quaternions, shape (quaternions, 3, 3)."""
    w, x, y, z = quaternion.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.array(rows).transpose(2, 0, 1)


NOISE_CELL_S = 0.05


@dataclass
class _Alignment:
    """One alignment and the navigation after it; `ready_s` is None until it was looked for."""

    begin_s: float
    latitude_deg: float
    error_rad: Array
    mounting: Array
    end_s: float = np.inf
    ready_s: float | None = None
    trajectory: ErrorTrajectory | None = None


class Gyros(Protocol):
    """The three gyros in the navigator, along its axes."""

    def errors_rad_per_s(self, time_s: Array, rate_rad_per_s: Array) -> Array:
        """Return measured less true rate, noise aside, for true rates along x, y, z, (times, 3)."""

    def noise_rad(self, time_s: Array) -> Array:
        """Return the integral of the white noise from 0 s to each time, (times, 3)."""


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
        self, truth: Truth, table: Table, gyros: Gyros, latitude_deg: float, seed: int
    ) -> None:
        self._table, self._gyros, self._seed = table, gyros, seed
        self._earth = earth_rate_rad_per_s(latitude_deg)
        # From the navigator's axes to those of the plate.
        self._mounting = self._as_mounted = small_rotation(truth, "mounting_error").T
        alignment = truth.section("alignment")
        self._takes_s = alignment.quantity("duration", "s")
        level, heading = (alignment.quantity(f"{of}_error", "rad") for of in ("level", "heading"))
        self._misaligned_rad = np.array([level, level, heading])
        levels_in_s = truth.quantity("levelling", "s")
        if min(levels_in_s, self._takes_s) <= 0.0:
            raise SimulationError(f"{truth.where}: times must be positive")
        self._levelling = 1.0 / levels_in_s
        level, heading = (truth.quantity(f"{of}_noise", "rad") for of in ("level", "heading"))
        sigma = np.array([level, level, heading])
        self._noise = ReadingNoise(sigma, NOISE_CELL_S, generator(seed, "navigator-noise"))
        self.powered = False
        self._alignments: list[_Alignment] = []

    def switch(self, time_s: float, on: bool) -> None:
        """Switch on or off from a time on; switched off it forgets its attitude."""
        self.powered = on
        if not on:
            self._end(time_s)

    def align(self, time_s: float, latitude_deg: float) -> None:
        """Begin to align, at a stated latitude; nothing happens while it is off."""
        if self.powered:
            self._end(time_s)
            rng = generator(self._seed, f"alignment {len(self._alignments)}")
            error_rad = self._misaligned_rad * rng.standard_normal(3)
            self._alignments.append(_Alignment(time_s, latitude_deg, error_rad, self._mounting))

    def turn_on_plate(self, time_s: float) -> None:
        """Be turned by half a turn about z by a hand, after which it must align again."""
        self._end(time_s)
        self._mounting = np.diag([-1.0, -1.0, 1.0]) @ self._mounting

    def mount(self, axes: Array, time_s: float) -> None:
        """Be mounted another way round, its x, y, z (columns) along the plate's; it aligns anew."""
        self._end(time_s)
        self._mounting = axes @ self._as_mounted

    def aligned(self, time_s: float) -> bool:
        """Return whether it knows its attitude at a time, by the commands of the table so far."""
        return any(self._ready_s(past) <= time_s < past.end_s for past in self._alignments)

    def attitude_deg(self, time_s: Array) -> Array:
        """Return heading (0 to 360), pitch and roll at each time, (times, 3); zeros unaligned."""
        result = np.zeros((time_s.size, 3))
        for alignment in self._alignments:
            here = (time_s >= alignment.begin_s) & (time_s < alignment.end_s)
            if here.any():
                here &= time_s >= self._ready_s(alignment)
            if here.any():
                result[here] = self._of(alignment, time_s[here])
        return result

    def forget_after(self, time_s: float) -> None:
        """Compute again what comes after a time, from which the table or the gyros do otherwise."""
        if self._alignments:
            last = self._alignments[-1]
            if last.ready_s is not None and last.ready_s > time_s:
                last.ready_s = last.trajectory = None
            if last.trajectory is not None:
                last.trajectory.forget_after(time_s)

    def _end(self, time_s: float) -> None:
        if self._alignments:
            last = self._alignments[-1]
            last.end_s = min(last.end_s, time_s)

    def _ready_s(self, alignment: _Alignment) -> float:
        if alignment.ready_s is None:
            alignment.ready_s = self._table.still_from(alignment.begin_s, self._takes_s)
        return alignment.ready_s

    def _trajectory(self, alignment: _Alignment) -> ErrorTrajectory:
        if alignment.trajectory is None:
            rates = self._earth, earth_rate_rad_per_s(alignment.latitude_deg)
            alignment.trajectory = ErrorTrajectory(
                self._ready_s(alignment),
                alignment.error_rad,
                self._table,
                partial(self._errors, alignment.mounting),
                rates,
                self._levelling,
            )
        return alignment.trajectory

    def _of(self, alignment: _Alignment, time_s: Array) -> Array:
        noise = quaternions(self._noise.at(time_s))
        error = product(noise, self._trajectory(alignment).at(time_s))
        return angles_deg(matrices(error) @ self._table.attitude(time_s) @ alignment.mounting)

    def _errors(
        self, mounting: Array, begin_s: Array, at_s: Array, end_s: Array
    ) -> tuple[Array, Array]:
        times = at_s.ravel()
        plate, rate = self._table.motion(times)
        body = plate @ mounting
        felt = np.einsum("nji,nj->ni", body, rate + self._earth)
        errors = np.einsum("nij,nj->ni", body, self._gyros.errors_rad_per_s(times, felt))
        # The noise is white: any attitude within the panel does.
        somewhere = body.reshape(*at_s.shape, 3, 3)[:, at_s.shape[1] // 2]
        walks = self._gyros.noise_rad(np.concatenate((begin_s, end_s)))
        noise = walks[begin_s.size :] - walks[: begin_s.size]
        return errors.reshape(*at_s.shape, 3), np.einsum("pij,pj->pi", somewhere, noise)


def angles_deg(attitude: Array) -> Array:
    """Return heading, pitch and roll of attitudes C_b^n, shape (attitudes, 3)."""
    heading = np.degrees(np.arctan2(attitude[:, 1, 0], attitude[:, 0, 0]))
    across = np.hypot(attitude[:, 2, 1], attitude[:, 2, 2])
    pitch = np.degrees(np.arctan2(-attitude[:, 2, 0], across))
    roll = np.degrees(np.arctan2(attitude[:, 2, 1], attitude[:, 2, 2]))
    # Once more, since a heading just below zero is rounded to 360.
    return np.array((heading % 360.0 % 360.0, pitch, roll)).T
