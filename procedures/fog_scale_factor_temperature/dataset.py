"""What the analysis of a gyro's scale factor against temperature needs, whoever recorded it.

The recorded turns, how far each missed its commanded angle, and the turns of one axis, set by set.
A turn is a rotation of the body in the navigation frame, C_after C_before^T; its part about the
vertical is what the gyro that points up has sensed. With the x axis up the pitch is 90 deg and
heading alone means nothing, the rotation does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from procedures.common.constants import FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.common.places import AtPlaces

from .parameters import PUBLISHED_ORDER, USUAL_REFERENCE_DEGC

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Names = NDArray[np.str_]
Index = NDArray[np.int64]

TurnSense = Literal["heading", "about-up"]
AXES = ("x", "y", "z")
PPM = 1e6
COVERED = 0.8
NEXT_SET = 1.6
SAME_TEMPERATURE_DEGC = 0.5
SAME_COMMAND_DEG = 90.0
"""Commands are those of the encoder in a run, and no two of them are quite the same."""


@dataclass(frozen=True)
class TurnTable:
    """Turns of a three-axis table, one row each, in the order in which they were made.

    Every array has shape (rows,) but the attitudes. `set_number` counts the rounds over the axes;
    `axis` is the body axis that points up and that the turn is about; `commanded_deg` is signed in
    the table's sense, 0 for a wait at rest. `attitude_before_deg` and `attitude_after_deg` (rows,
    3) are heading, pitch and roll (NED, C_b^n = Rz Ry Rx), pitch and roll NaN where the navigator
    gives heading alone. Temperatures are the turned gyro's own; the chamber's is NaN where it was
    not read.
    """

    set_number: Index
    before_s: Array
    after_s: Array
    axis: Names
    commanded_deg: Array
    attitude_before_deg: Array
    attitude_after_deg: Array
    temperature_before_degC: Array
    temperature_after_degC: Array
    chamber_degC: Array

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.before_s)

    def of(self, rows: Mask | Index | slice) -> TurnTable:
        """Return some of the rows."""
        return TurnTable(**{name: column[rows] for name, column in vars(self).items()})

    @property
    def temperature_degC(self) -> Array:
        """The model's argument: the mean of the gyro's temperature before and after, (rows,)."""
        return 0.5 * (self.temperature_before_degC + self.temperature_after_degC)

    @property
    def duration_s(self) -> Array:
        """Time between the two readings of a turn, (rows,)."""
        return self.after_s - self.before_s

    @property
    def middle_s(self) -> Array:
        """Time in the middle of a turn, (rows,)."""
        return 0.5 * (self.before_s + self.after_s)


@dataclass(frozen=True)
class Trajectory:
    """Where a vehicle truly was, at times (n,) that rise; velocity (n, 3) is north, east, down."""

    time_s: Array
    latitude_deg: Array
    longitude_deg: Array
    height_m: Array
    velocity_m_per_s: Array


@dataclass(frozen=True)
class Drive:
    """A drive for the vehicle test: body rates and gyro temperatures at times that rise.

    `rate_deg_per_s` and `temperature_degC` have shape (rows, 3): x forward, y right, z down, earth
    rate included. `heading_deg` (rows,) is a reference heading; without one the vehicle ends in the
    heading in which it began. `first_heading_known` says whether `first_heading_deg`, the
    heading in which it began, is more than a guess. `specific_force_m_per_s2` (rows, 3) along the
    same axes is minus gravity at rest; with it, `reference` and the first attitude a drive shows
    errors of position and velocity.
    """

    time_s: Array
    rate_deg_per_s: Array
    temperature_degC: Array
    latitude_deg: float
    heading_deg: Array | None = None
    first_heading_deg: float = 0.0
    first_heading_known: bool = False
    first_pitch_deg: float | None = None
    first_roll_deg: float | None = None
    specific_force_m_per_s2: Array | None = None
    reference: Trajectory | None = None


@dataclass(frozen=True)
class FogDataset:
    """All that is known of a gyro over temperature.

    `turns` are those that the model is fitted to, `verification` those of another ramp and `drive`
    a vehicle test; neither enters the fit. `gyro_bias_deg_per_h` is the specification, a standard
    uncertainty, None where it is not given. The noises are those that the data sheets state.
    `history` holds temperatures against time for the report, in degC, by name: arrays (rows, 2) of
    time in s and temperature. `places` has what a thermometer with places read at the end of the
    soak and in that hour of the ramp in which it is widest, none where there was none.
    """

    turns: TurnTable
    turn_sense: TurnSense
    full_attitude: bool
    gyro_bias_deg_per_h: float | None = None
    heading_resolution_deg: float = 0.0
    angle_random_walk_deg_per_sqrt_h: float | None = None
    turntable_accuracy_arcsec: float | None = None
    reference_temperature_degC: float = USUAL_REFERENCE_DEGC
    initial_order: int = PUBLISHED_ORDER
    temperature_range_degC: tuple[float, float] | None = None
    verification: TurnTable | None = None
    drive: Drive | None = None
    history: Mapping[str, Array] = field(default_factory=dict)
    places: tuple[AtPlaces, ...] = ()


def wrapped_deg(angle_deg: Array) -> Array:
    """Return angles in (-180, 180] deg."""
    return np.asarray(180.0 - np.mod(180.0 - angle_deg, 360.0))


def rotation_to_navigation(attitude_deg: Array) -> Array:
    """Return C_b^n = Rz(heading) Ry(pitch) Rx(roll) of attitudes (n, 3) in deg, shape (n, 3, 3)."""
    heading, pitch, roll = np.radians(attitude_deg).T
    sh, ch, sp, cp = np.sin(heading), np.cos(heading), np.sin(pitch), np.cos(pitch)
    sr, cr = np.sin(roll), np.cos(roll)
    rows = (
        (ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr),
        (sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.moveaxis(np.array(rows), 2, 0)


def turned_about_down_deg(before_deg: Array, after_deg: Array, full_attitude: bool) -> Array:
    """Return the rotation about the vertical downwards, in the sense of growing heading, wrapped.

    Attitudes have shape (n, 3); without full attitude only the headings are looked at.
    """
    if not full_attitude:
        return wrapped_deg(after_deg[:, 0] - before_deg[:, 0])
    turned = rotation_to_navigation(after_deg) @ np.swapaxes(
        rotation_to_navigation(before_deg), 1, 2
    )
    sine, cosine = turned[:, 1, 0] - turned[:, 0, 1], turned[:, 0, 0] + turned[:, 1, 1]
    return np.asarray(np.degrees(np.arctan2(sine, cosine)))


def turn_errors_deg(turns: TurnTable, sense: TurnSense, full_attitude: bool) -> Array:
    """Return the measured less the commanded angle in the table's sense, wrapped, shape (rows,).

    Source: fog-scale-factor-temperature document, step 3: the difference of heading.

    It is commanded x scale-factor error + bias x time; `sense` says what a positive commanded turn
    is: growing heading, or a positive rotation about the axis that points up.
    """
    down = turned_about_down_deg(turns.attitude_before_deg, turns.attitude_after_deg, full_attitude)
    own = down if sense == "heading" else -down
    return wrapped_deg(own - turns.commanded_deg)


@dataclass(frozen=True)
class AxisTurns:
    """The turns of one axis that can be used at all, every array (n,); `error_deg` as measured."""

    axis: str
    rows: Index
    set_number: Index
    middle_s: Array
    duration_s: Array
    commanded_deg: Array
    error_deg: Array
    temperature_degC: Array
    usable: Mask

    @property
    def data_ppm(self) -> Array:
        """Turn errors in millionths of a turn."""
        return self.error_deg / FULL_TURN_DEG * PPM

    @property
    def turns(self) -> Array:
        """Commanded turns, signed."""
        return self.commanded_deg / FULL_TURN_DEG

    @property
    def sensing(self) -> Mask:
        """Whether a row is a turn; a wait shows the bias alone."""
        return np.asarray(np.abs(self.commanded_deg) > SAME_COMMAND_DEG)

    @property
    def by_bias_ppm(self) -> Array:
        """What a bias of 1 deg/h adds to `data_ppm`."""
        return self.duration_s / SECONDS_PER_HOUR / FULL_TURN_DEG * PPM

    @cached_property
    def set_interval_s(self) -> float:
        """The usual time from a set to the next; the record's length where there is but one."""
        starts = np.array([self.middle_s[self.set_number == n].min() for n in self.sets()])
        steps = np.diff(np.sort(starts))
        steps = steps[steps > 0.0]
        return float(np.median(steps)) if len(steps) else float(max(np.ptp(self.middle_s), 1.0))

    def sets(self) -> Index:
        """Return the numbers of the sets, each once."""
        return np.unique(self.set_number)


def is_paired(turns: AxisTurns) -> bool:
    """Whether turns of another command, or waits, stand beside nearly every turn.

    Beside is within the same set or the next: only there can the bias be separated from the scale
    factor however it changes with temperature.
    """
    sensing = turns.usable & turns.sensing
    if not bool(sensing.any()):
        return False
    within_s = NEXT_SET * turns.set_interval_s
    near = np.abs(np.subtract.outer(turns.middle_s, turns.middle_s)) <= within_s
    apart_deg = np.abs(np.subtract.outer(turns.commanded_deg, turns.commanded_deg))
    other = apart_deg > SAME_COMMAND_DEG
    covered = np.any(near & other & turns.usable[None, :], axis=1)
    return bool(covered[sensing].mean() >= COVERED)


def set_means(set_number: Index, *columns: Array) -> list[Array]:
    """Return the means of columns (n,) over each set, in the order of the sets' numbers."""
    _, place, count = np.unique(set_number, return_inverse=True, return_counts=True)
    return [np.bincount(place, column) / count for column in columns]


def distinct_temperatures(temperature_degC: Array) -> int:
    """Return at how many temperatures there are turns, those within half a degree taken as one."""
    return len(np.unique(np.floor(temperature_degC / SAME_TEMPERATURE_DEGC)))


@dataclass(frozen=True)
class SetOfTurns:
    """Rows of one set, (k,), and its scale-factor error in ppm; `u` is in noises of a turn.

    Turns of both senses, or a turn and a wait, separate the bias of their set from its scale
    factor, if nothing came between them: over a gap the bias changes.
    """

    rows: Index
    error_ppm: float
    u: float
    bias_deg_per_h: float


def sets_with_bias(turns: AxisTurns, rows: Mask, data_ppm: Array) -> Iterator[SetOfTurns]:
    """Yield the sets of these rows that resolve their bias, which is taken off of `data_ppm` (n,).

    A set that was interrupted for longer than from one set to the next counts as several.
    """
    for own in _uninterrupted(turns, rows):
        scale = turns.turns[own]
        if float(np.ptp(scale)) * FULL_TURN_DEG > SAME_COMMAND_DEG:
            design = np.column_stack((scale, turns.by_bias_ppm[own]))
            inverse = np.linalg.inv(design.T @ design)
            solved = inverse @ (design.T @ data_ppm[own])
            u = float(np.sqrt(inverse[0, 0]))
            yield SetOfTurns(own, float(solved[0]), u, float(solved[1]))


def _uninterrupted(turns: AxisTurns, rows: Mask) -> Iterator[Index]:
    """Yield the rows of each set, and of each part of an interrupted one, in the order of time."""
    for number in np.unique(turns.set_number[rows]):
        own = np.flatnonzero(rows & (turns.set_number == number))
        own = own[np.argsort(turns.middle_s[own], kind="stable")]
        gaps = np.diff(turns.middle_s[own]) > turns.set_interval_s
        yield from np.split(own, np.flatnonzero(gaps) + 1)


def noise_of_sets(
    turns: AxisTurns, rows: Mask, left_ppm: Array, columns: int
) -> tuple[float, float] | None:
    """Return the noise of a turn as the sets scatter about a curve, and its degrees of freedom.

    A table that wanders slowly has the same error at the end of a turn and at the beginning of the
    one back: it adds in their scale factor and cancels in their bias, so that residuals of single
    turns show too little. None where no more sets are left than the curve has `columns`.
    """
    scaled = [turn_set.error_ppm / turn_set.u for turn_set in sets_with_bias(turns, rows, left_ppm)]
    free = len(scaled) - columns
    if free < 1:
        return None
    return float(np.sqrt(np.sum(np.square(scaled)) / free)), float(free)
