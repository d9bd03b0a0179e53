"""Step 4: a drive navigated in position and velocity, before and after compensation.

The errors are those against the reference trajectory, horizontal, from its position and velocity at
the beginning on; height and vertical velocity are the reference's. How they depend on the curve's
coefficients, the sensors' biases, the first attitude and the noise is found by navigating the drive
once more with each of them changed a little.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from procedures.common.constants import ARCMIN_PER_RAD, ARCSEC_PER_RAD, SECONDS_PER_HOUR
from procedures.estimation.linear import robust_sigma
from procedures.estimation.strapdown import State, blocks_of, navigate, radii_m, rotation

from .curve import Curve
from .dataset import AXES, PPM, Array, Drive, Trajectory, rotation_to_navigation
from .verification import compensate

STEP_S = 1.0
DRAWS, SEED = 64, 0
"""Drives with noise of their own, by whose scatter the noise of the sensors is in u."""
WITHIN = 5.99
"""Chi-square of two components that 95 % stay below."""
M_PER_S2_PER_UG = 9.80665e-6
FEWEST_BENDS = 3
GYRO_BIAS, ACCELEROMETER_BIAS = "gyro_bias", "accelerometer_bias"
HEADING, LEVEL, FIX = "initial_heading", "initial_level", "reference_position"
CURVE_BIAS, NOISE, FIRST = "curve_bias", "noise", "first_velocity"
POSITION, VELOCITY = slice(0, 2), slice(2, 4)
NAMES = (
    "position_error",
    "final_position_error",
    "velocity_error",
)
RUNS = ("uncompensated", "compensated")


@dataclass(frozen=True)
class Size:
    """The size of an error, m or m/s, when it is so, and what it depends on."""

    value: float
    at_s: float
    u: float
    degrees_of_freedom: float
    sensitivities: Mapping[str, float]


@dataclass(frozen=True)
class Navigated:
    """Errors (2, n, 4) without and with compensation: north, east in m, and their velocities.

    `shifts` are the changes (m, n, 4) of these by one unit of each input, by its name; of the model
    of an axis, by each coefficient. `velocity_m_per_s` (n, 2) is the reference's.
    """

    time_s: Array
    error: Array
    shifts: Mapping[str, Array]
    velocity_m_per_s: Array
    attitude: Array
    offset_s: float = 0.0

    def size(
        self, curves: Mapping[str, Curve], name: str, run: int, stated: Mapping[str, float]
    ) -> Size:
        """Return the largest or final error of a run; `name` is one of `NAMES`.

        An error within the 95 % ellipse of its uncertainty about zero has no direction: u is then
        that of the whole vector, as sizes differ at most as vectors do. `stated` has standard
        uncertainties by the names of inputs.
        """
        part = VELOCITY if name == "velocity_error" else POSITION
        error = self.error[run][:, part]
        length = np.linalg.norm(error, axis=1)
        row = -1 if name == "final_position_error" else int(np.argmax(length))
        along = error[row][:, None] / max(float(length[row]), 1e-12)
        depends = self._depends(curves, row, part, run)
        shares = [depends.noise, *depends.model.values()]
        shares += [stated.get(what, 0.0) * own for what, own in depends.inputs.items()]
        covariance = sum(own.T @ own for own in shares) + 1e-12 * np.eye(2)
        if float(error[row] @ np.linalg.solve(covariance, error[row])) < WITHIN:
            along = np.eye(2)

        def size_of(shares: Array) -> float:
            own = shares @ along
            return float(own[0, 0]) if own.size == 1 else float(np.linalg.norm(own))

        noise, model, freedom = size_of(depends.noise) ** 2, 0.0, math.inf
        for axis, own in depends.model.items():
            model += size_of(own) ** 2
            freedom = min(freedom, max(curves[axis].degrees_of_freedom, 1.0))
        variance = noise + model + size_of(depends.late) ** 2
        spread = noise**2 / DRAWS + model**2 / freedom
        return Size(
            float(length[row]),
            float(self.time_s[row]),
            max(math.sqrt(variance), 1e-6),
            variance**2 / spread if spread else math.inf,
            {what: size_of(own) for what, own in depends.inputs.items()},
        )

    def _depends(self, curves: Mapping[str, Curve], row: int, part: slice, run: int) -> _Depends:
        """Return what the error at a row depends on."""

        def by(what: str) -> Array:
            return np.asarray(self.shifts[what][:, row, part])

        inputs = {what: by(what) for what in (GYRO_BIAS, ACCELEROMETER_BIAS, HEADING, LEVEL)}
        model = {}
        if run:
            inputs[GYRO_BIAS] = inputs[GYRO_BIAS] + by(CURVE_BIAS)
            for axis, curve in curves.items():
                model[axis] = root_of(curve.covariance) @ by(f"model_{axis}")
                if curve.check is not None:
                    inputs[f"checks_{axis}"] = by(f"checks_{axis}")
        late = np.zeros((1, 2))
        if part == POSITION:
            inputs[FIX] = math.sqrt(2.0) / 1000.0 * np.eye(2)
            late = self.offset_s * self.velocity_m_per_s[row][None, :]
        noise = np.concatenate((by(NOISE) / math.sqrt(DRAWS), by(FIRST)))
        return _Depends(noise, model, inputs, late)


@dataclass(frozen=True)
class _Depends:
    """What an error of two components depends on, each (k, 2): of independent unit deviations.

    `model` by axis, `inputs` by name for one unit of it; `late` is what a time offset makes.
    """

    noise: Array
    model: Mapping[str, Array]
    inputs: Mapping[str, Array]
    late: Array


def root_of(covariance: Array) -> Array:
    """Return a matrix whose square, R^T R, is a covariance (k, k)."""
    sizes, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(sizes, 0.0))).T)


def first_attitude(drive: Drive) -> Array:
    """Return what takes the body into north, east, down where the drive began, (3, 3)."""
    angles = (drive.first_heading_deg, drive.first_pitch_deg or 0.0, drive.first_roll_deg or 0.0)
    return np.asarray(rotation_to_navigation(np.array([angles]))[0])


def covered(drive: Drive, trajectory: Trajectory) -> slice:
    """Return the rows of a drive within the times of its reference, from the first on."""
    last = np.searchsorted(drive.time_s, trajectory.time_s[-1], side="right")
    return slice(0, int(last))


def at_times(trajectory: Trajectory, time_s: Array) -> tuple[Array, Array, Array, Array]:
    """Return latitude and longitude in rad, height and velocity (n, 3) at times, by splines."""
    longitude = np.unwrap(trajectory.longitude_deg, period=360.0)
    columns = np.column_stack(
        (
            np.radians(trajectory.latitude_deg),
            np.radians(longitude),
            trajectory.height_m,
            trajectory.velocity_m_per_s,
        )
    )
    values = CubicSpline(trajectory.time_s, columns)(time_s)
    return values[:, 0], values[:, 1], values[:, 2], values[:, 3:]


def ways_m(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return how far a reference came, north, east, down (n-1, 3): by position, by velocity."""
    latitude = np.radians(trajectory.latitude_deg)
    longitude = np.radians(np.unwrap(trajectory.longitude_deg, period=360.0))
    along, across = radii_m(latitude)
    steps = (
        np.diff(latitude) * along[1:],
        np.diff(longitude) * across[1:] * np.cos(latitude[1:]),
        -np.diff(trajectory.height_m),
    )
    added = cumulative_trapezoid(trajectory.velocity_m_per_s, trajectory.time_s, axis=0)
    return np.cumsum(np.column_stack(steps), axis=0), added


def velocity_doubt(trajectory: Trajectory) -> Array:
    """Return how well a reference knows the horizontal velocity at which navigation begins, (2,).

    That is its noise, and by how much it leads elsewhere than the positions.
    """
    moved, added = ways_m(trajectory)
    lasts_s = float(trajectory.time_s[-1] - trajectory.time_s[0])
    leads = np.abs(moved[-1] - added[-1]) / lasts_s
    return np.asarray(np.hypot(white_noise(trajectory.velocity_m_per_s), leads)[:2])


def navigate_drive(drive: Drive, curves: Mapping[str, Curve]) -> Navigated:
    """Return the errors of a drive that has specific force, reference and first attitude."""
    assert drive.reference is not None
    assert drive.specific_force_m_per_s2 is not None
    rows = covered(drive, drive.reference)
    time_s, force = drive.time_s[rows], drive.specific_force_m_per_s2[rows]
    better = np.radians(compensate(drive, curves)[rows])
    rates = np.stack((np.radians(drive.rate_deg_per_s[rows]), better))
    per_block = max(1, round(STEP_S / float(np.median(np.diff(time_s)))))
    blocks = blocks_of(time_s, rates, force, per_block)
    ends = np.searchsorted(time_s, blocks.time_s)
    latitude, longitude, height, velocity = at_times(drive.reference, blocks.time_s)
    changes = _Changes(np.diff(blocks.time_s))
    spans = changes.spans_s[:, None]

    def block_sums(values: Array) -> Array:
        return np.diff(cumulative_trapezoid(values, time_s, axis=0, initial=0.0)[ends], axis=0)

    def about(column: int, angles: Array) -> Array:
        turned = np.zeros((len(spans), 3))
        turned[:, column] = angles
        return turned

    for column, axis in enumerate(AXES):
        unit = np.eye(3)[column]
        tiny = 0.01
        bias = math.radians(1.0) / SECONDS_PER_HOUR
        changes.add(GYRO_BIAS, tiny, turned=unit * bias * spans)
        changes.add(ACCELEROMETER_BIAS, 1.0, pushed=unit * M_PER_S2_PER_UG * spans)
        if axis not in curves:
            changes.add(CURVE_BIAS, 1.0)
            continue
        curve, heat = curves[axis], drive.temperature_degC[rows, column]
        taken = -better[:, column : column + 1] / PPM
        columns = block_sums(taken * curve.columns(heat))
        changes.add(CURVE_BIAS, tiny, turned=about(column, columns @ curve.by_bias))
        for share in columns.T:
            changes.add(f"model_{axis}", 1.0, turned=about(column, share))
        doubt = block_sums(taken * curve.check_ppm(heat)[:, None])[:, 0]
        changes.add(f"checks_{axis}", 1.0, turned=about(column, doubt))
    for doubt in np.diag(velocity_doubt(drive.reference)):
        changes.add(FIRST, 1.0, speed=doubt)
    changes.add(HEADING, 1.0, leans=np.array([0.0, 0.0, 1.0 / ARCMIN_PER_RAD]))
    for lean in np.eye(3)[:2]:
        changes.add(LEVEL, 1.0, leans=lean / ARCSEC_PER_RAD)
    generator = np.random.default_rng(SEED)
    root = np.sqrt(block_sums(np.gradient(time_s)[:, None]))
    shape = (len(spans), 3)
    for _ in range(DRAWS):
        turned, pushed = (
            generator.standard_normal(shape) * root * white_noise(values)
            for values in (rates[0], force)
        )
        changes.add(NOISE, 1.0, turned=turned, pushed=pushed)

    count = len(changes.names)
    start = State(
        np.full(count, latitude[0]),
        np.full(count, longitude[0]),
        velocity[0, :2] + np.array(changes.speeds),
        rotation(np.array(changes.leans)) @ first_attitude(drive),
    )
    of = np.ones(count, dtype=np.int64)
    of[0] = 0
    track = navigate(
        blocks,
        start,
        height,
        velocity[:, 2],
        of,
        np.array(changes.turned),
        np.array(changes.pushed),
    )
    along, across = radii_m(latitude)
    north = (track.latitude_rad.T - latitude) * (along + height)
    east = (track.longitude_rad.T - longitude) * (across + height) * np.cos(latitude)
    moved = np.moveaxis(track.velocity_m_per_s, 1, 0) - velocity[:, :2]
    errors = np.concatenate((np.stack((north, east), axis=-1), moved), axis=-1)
    steps = (errors - errors[1]) / np.array(changes.sizes)[:, None, None]
    names = np.array(changes.names)
    shifts = {name: steps[names == name] for name in dict.fromkeys(changes.names[2:])}
    return Navigated(blocks.time_s, errors[:2], shifts, velocity[:, :2], track.attitude)


class _Changes:
    """What is changed in each variant of a drive, the plain and the compensated one first."""

    def __init__(self, spans_s: Array) -> None:
        self.spans_s = spans_s
        self.names: list[str] = []
        self.sizes: list[float] = []
        self.turned: list[Array] = []
        self.pushed: list[Array] = []
        self.leans: list[Array] = []
        self.speeds: list[Array] = []
        for run in RUNS:
            self.add(run, 1.0)

    def add(
        self,
        name: str,
        size: float,
        *,
        turned: Array | float = 0.0,
        pushed: Array | float = 0.0,
        leans: Array | None = None,
        speed: Array | None = None,
    ) -> None:
        """Add a variant, `size` units of an input off; what a unit of it does is given."""
        self.speeds.append(np.zeros(2) if speed is None else size * speed)
        shape = (len(self.spans_s), 3)
        self.names.append(name)
        self.sizes.append(size)
        self.turned.append(np.broadcast_to(size * np.asarray(turned), shape))
        self.pushed.append(np.broadcast_to(size * np.asarray(pushed), shape))
        self.leans.append(np.zeros(3) if leans is None else size * leans)


def white_noise(values: Array) -> Array:
    """Return the noise of each column (n, 3), by fourth differences, which no motion moves."""
    bent = np.diff(values, 4, axis=0)
    if len(bent) < FEWEST_BENDS:
        return np.zeros(3)
    return np.array([robust_sigma(column) for column in bent.T]) / math.sqrt(70.0)
