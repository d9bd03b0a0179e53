"""What a drive with a reference trajectory shows of itself: missing parts, wrong units and axes.

Each column is held against another that says the same: the reference's velocity against its
positions, rates against the reference's course, specific force against its acceleration and
gravity.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.flags import not_identifiable
from procedures.estimation.strapdown import gravity_m_per_s2
from station.findings import Flag, contradiction

from .curve import Curve
from .dataset import Array, Drive, Trajectory, wrapped_deg
from .navigation import (
    NAMES,
    RUNS,
    VELOCITY,
    Navigated,
    at_times,
    covered,
    first_attitude,
    navigate_drive,
    ways_m,
)

G = 9.80665
MIN_COVERED = 0.5
LONGEST_GAP_S = 2.0
LEAST_MOVED_M, DISAGREES = 3.0, 0.2
FAR_DEG = 1.0
SLOWEST_M_PER_S, LEAST_TURNED_DEG = 2.0, 45.0
SUITS, DENIED = 0.3, 0.6
"""Of the rms of what a column must show: what a reading of it may leave, and what denies it."""
LEAST_ACCELERATION, OFF_G = 0.2, 0.1
MAX_NAMED = 3
LATE_SIGMAS, LATE_STEPS = 5.0, 0.2
LEAST_VELOCITY = 0.5
REST_M_PER_S, LEAST_REST_S = 0.1, 2.0
"""Slower, and for so long, a vehicle stands; its accelerometers then show how level it is."""
OFF_LEVEL_DEG, OFF_GRAVITY = 0.05, 0.005
"""What accelerometers of navigators do not show by their own errors, in deg and of gravity."""
RATES, FORCE = "rate_x_deg_per_s", "specific_force_x_m_per_s2"


@dataclass(frozen=True)
class _Reading:
    """Another meaning of three columns, and the matrix (3, 3) that makes them as stated."""

    unit: str
    axes: str
    matrix: Array

    @property
    def what(self) -> str:
        """Both, as a sentence ends with them."""
        if not self.unit:
            return self.axes
        return f"they are in {self.unit}" + (f" and {self.axes}" if self.axes else "")


AXES_MEANT = (
    ("", np.eye(3)),
    ("all their signs are reversed", -np.eye(3)),
    ("their x is reversed", np.diag([-1.0, 1.0, 1.0])),
    ("their y is reversed", np.diag([1.0, -1.0, 1.0])),
    ("their z is reversed", np.diag([1.0, 1.0, -1.0])),
    ("their y and z are reversed", np.diag([1.0, -1.0, -1.0])),
    ("their x and y are exchanged", np.eye(3)[[1, 0, 2]]),
    ("their x and z are exchanged", np.eye(3)[[2, 1, 0]]),
    ("their y and z are exchanged", np.eye(3)[[0, 2, 1]]),
    (
        "their x and y are exchanged and z is reversed",
        np.diag([1.0, 1.0, -1.0]) @ np.eye(3)[[1, 0, 2]],
    ),
)
LEVEL_AXES = [item for item in AXES_MEANT[1:] if item[1][2, 2] == 1.0]


def navigated(
    drive: Drive | None, curves: Mapping[str, Curve]
) -> tuple[Navigated | None, list[Flag]]:
    """Return the navigation of a drive, None where it lacks a part or denies itself, and flags."""
    if drive is None or (drive.specific_force_m_per_s2 is None and drive.reference is None):
        return None, []
    lacking = _lacking(drive)
    if not curves:
        lacking = "no axis has a curve"
    if lacking:
        lacking_text = f"The drive shows no errors of position and velocity: {lacking}."
        names = [f"{name}_{run}" for name in NAMES for run in RUNS]
        return None, [not_identifiable(lacking_text, names)]
    denied = _denied(drive)
    if denied:
        return None, denied
    done = navigate_drive(drive, curves)
    denied = _force(drive, done) or _level_rates(drive, done, curves)
    if denied:
        return None, denied
    offset_s, u_s = _time_offset(done)
    step_s = float(np.median(np.diff(drive.time_s)))
    rest = _at_rest(drive)
    if abs(offset_s) <= LATE_SIGMAS * u_s or abs(offset_s) <= LATE_STEPS * step_s:
        return done, rest
    late_text = (
        f"The drive and its reference are {abs(1000.0 * offset_s):.3g} ms apart in time, "
        f"{abs(offset_s) / step_s:.2g} sample intervals: the time stamps of one of them are not "
        "those of its values. What this makes of position is in u."
    )
    flag = contradiction("t_s", late_text, offset_s=offset_s)
    return replace(done, offset_s=offset_s), [flag, *rest]


def _at_rest(drive: Drive) -> list[Flag]:
    """Return the flag of a first attitude, or a scale, that the force of the first rest denies."""
    assert drive.specific_force_m_per_s2 is not None and drive.reference is not None
    inside = covered(drive, drive.reference)
    time_s = drive.time_s[inside]
    speed = np.linalg.norm(drive.reference.velocity_m_per_s, axis=1)
    moves = np.interp(time_s, drive.reference.time_s, speed) > REST_M_PER_S
    stood = int(np.argmax(moves)) if moves.any() else len(time_s)
    if stood < 2 or float(np.ptp(time_s[:stood])) < LEAST_REST_S:
        return []
    rows = drive.specific_force_m_per_s2[inside][:stood]
    x, y, z = rows.mean(axis=0)
    size = math.sqrt(x * x + y * y + z * z)
    if abs(size - G) > OFF_GRAVITY * G:
        size_text = (
            f"At rest the specific force is {size:.4g} m/s^2, and gravity {G:.4g} m/s^2: look at "
            "the scale of its columns."
        )
        return [contradiction(FORCE, size_text)]
    shown = math.degrees(math.asin(x / size)), math.degrees(math.atan2(-y, -z))
    stated = drive.first_pitch_deg or 0.0, drive.first_roll_deg or 0.0
    noise_deg = math.degrees(float(rows.std(axis=0).max()) / math.sqrt(stood) / G)
    off_deg = [abs(own - said) for own, said in zip(shown, stated, strict=True)]
    if max(off_deg) <= OFF_LEVEL_DEG + LATE_SIGMAS * noise_deg:
        return []
    level_text = (
        f"At rest the specific force shows a pitch of {shown[0]:.3f} deg and a roll of "
        f"{shown[1]:.3f} deg, stated are {stated[0]:.3f} deg and {stated[1]:.3f} deg: look at "
        "these conditions and at the accelerometers. What this makes of position is not in u."
    )
    name = "initial_pitch" if off_deg[0] >= off_deg[1] else "initial_roll"
    return [contradiction(name, level_text)]


def _lacking(drive: Drive) -> str:
    """Return what a drive lacks for navigation, as it ends a sentence; empty where nothing."""
    if drive.specific_force_m_per_s2 is None:
        return "it has a reference trajectory and no specific force"
    if drive.reference is None:
        return "it has specific force and no reference trajectory"
    stated = {
        "initial_heading": drive.first_heading_known,
        "initial_pitch": drive.first_pitch_deg is not None,
        "initial_roll": drive.first_roll_deg is not None,
    }
    unstated = [f"`{name}`" for name, known in stated.items() if not known]
    if unstated:
        return f"the conditions do not state {', '.join(unstated)}"
    times = drive.reference.time_s
    inside = drive.time_s[covered(drive, drive.reference)]
    whole_s = float(np.ptp(drive.time_s))
    if len(inside) < 2 or times[0] > inside[0] or np.ptp(inside) < MIN_COVERED * whole_s:
        return "the times of its reference do not hold its beginning and half of it"
    gaps = (("drive", inside), ("reference", times))
    for name, own in gaps:
        longest = float(np.max(np.diff(own)))
        if longest > LONGEST_GAP_S:
            return f"its file {name} has a gap of {longest:.3g} s"
    return ""


def _denied(drive: Drive) -> list[Flag]:
    """Return the flag of a reference that denies itself, or of rates that it denies."""
    assert drive.reference is not None
    return _reference(drive.reference, drive.latitude_deg) or _rates(drive, drive.reference)


def _reference(trajectory: Trajectory, latitude_deg: float) -> list[Flag]:
    """Return the flag of positions that are not where velocity leads."""
    names = ("latitude_deg", "longitude_deg", "height_m")
    for name, moved, own in zip(names, *(way.T for way in ways_m(trajectory)), strict=True):
        scale = max(_rms(moved), _rms(own))
        if _rms(moved - own) > max(DISAGREES * scale, LEAST_MOVED_M):
            denied_text = (
                f"The reference contradicts itself: its {name} changes by {np.ptp(moved):.3g} m "
                f"where its velocity adds up to {np.ptp(own):.3g} m. Check units, signs and the "
                "order of its columns."
            )
            return [contradiction(name, denied_text)]
    middle_deg = float(np.mean(trajectory.latitude_deg))
    if abs(middle_deg - latitude_deg) > FAR_DEG:
        far_text = (
            f"The reference is at a latitude of {middle_deg:.3g} deg, the conditions state "
            f"{latitude_deg:.3g} deg."
        )
        return [contradiction("latitude", far_text)]
    return []


def _rates(drive: Drive, trajectory: Trajectory) -> list[Flag]:
    """Return the flag of rates that do not turn the vehicle as the reference's course turns."""
    rows = covered(drive, trajectory)
    time_s = drive.time_s[rows]
    seconds = np.arange(time_s[0], time_s[-1], 1.0)
    _, _, _, velocity = at_times(trajectory, seconds)
    fast = np.linalg.norm(velocity[:, :2], axis=1) > SLOWEST_M_PER_S
    bearing = np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))
    moving = fast[1:] & fast[:-1]
    turned = wrapped_deg(np.diff(bearing))[moving]
    if float(np.sum(np.abs(turned))) < LEAST_TURNED_DEG:
        return []
    angle = cumulative_trapezoid(drive.rate_deg_per_s[rows], time_s, axis=0, initial=0.0)
    parts = np.column_stack([np.interp(seconds, time_s, own) for own in angle.T])
    parts = np.diff(parts, axis=0)[moving]
    down = first_attitude(drive)[2]
    size = _rms(turned)

    def rest(matrix: Array) -> float:
        return _rms(parts @ matrix.T @ down - turned) / size

    if rest(np.eye(3)) <= DENIED:
        return []
    units = {"rad/s": float(np.degrees(1.0)), "deg/h": 1.0 / SECONDS_PER_HOUR}
    suits = [reading for reading in _readings(units) if rest(reading.matrix) < SUITS]
    denied_text = (
        "The rates of the drive do not turn as the course of its reference does. "
        "Check units and axes (x forward, y right, z down) of the rates."
    )
    return [_with(contradiction(RATES, denied_text), suits)]


def _level_rates(drive: Drive, done: Navigated, curves: Mapping[str, Curve]) -> list[Flag]:
    """Return the flag of rates about level axes that navigate better under other names."""
    size = _rms(done.error[1][:, VELOCITY])
    if size < LEAST_VELOCITY:
        return []
    better = []
    for axes, matrix in LEVEL_AXES:
        other = replace(drive, rate_deg_per_s=drive.rate_deg_per_s @ matrix.T)
        if _rms(navigate_drive(other, curves).error[1][:, VELOCITY]) < SUITS * size:
            better.append(_Reading("", axes, matrix))
    if not better:
        return []
    denied_text = (
        f"Navigated, the drive is up to {np.max(np.abs(done.error[1][:, VELOCITY])):.3g} m/s from "
        f"the velocity of its reference. Check axes (x forward, y right, z down) "
        "of the rates."
    )
    return [_with(contradiction(RATES, denied_text), better)]


def _force(drive: Drive, done: Navigated) -> list[Flag]:
    """Return the flag of specific force that is not the reference's acceleration less gravity."""
    assert drive.specific_force_m_per_s2 is not None
    rows = covered(drive, drive.reference) if drive.reference is not None else slice(None)
    time_s = drive.time_s[rows]
    summed = cumulative_trapezoid(drive.specific_force_m_per_s2[rows], time_s, axis=0, initial=0.0)
    ends = np.searchsorted(time_s, done.time_s)
    spans = np.diff(done.time_s)[:, None]
    force = np.diff(summed[ends], axis=0) / spans
    gravity = float(gravity_m_per_s2(np.radians(drive.latitude_deg), 0.0))
    level = np.diff(done.velocity_m_per_s, axis=0) / spans
    wanted = np.column_stack((level, np.full(len(level), -gravity)))
    wanted = np.einsum("nji,nj->ni", done.attitude[:-1], wanted)
    lively = wanted - wanted.mean(axis=0)
    size = _rms(lively)

    def suits(matrix: Array, part: float) -> bool:
        read = force @ matrix.T
        off = read.mean(axis=0) - wanted.mean(axis=0)
        moved = _rms(read - read.mean(axis=0) - lively)
        still = size < LEAST_ACCELERATION
        return float(np.linalg.norm(off)) < OFF_G * G and (still or moved < part * size)

    if suits(np.eye(3), DENIED):
        return []
    units = {"g": G, "mg": G / 1000.0}
    other = [reading for reading in _readings(units) if suits(reading.matrix, DENIED)]
    mean = float(np.linalg.norm(force.mean(axis=0)))
    denied_text = (
        f"The specific force of the drive, {mean:.3g} m/s^2 on the average, is not the "
        f"acceleration of its reference less gravity. At rest and level it is "
        "-9.8 m/s^2 along z (down). Check its units, signs and axes, and the initial attitude."
    )
    return [_with(contradiction(FORCE, denied_text), other)]


def _time_offset(done: Navigated) -> tuple[float, float]:
    """Return by how much the drive is ahead of its reference, in s, and the standard uncertainty.

    By how errors of velocity change where velocity changes; those of the gyros grow slowly.
    """
    acceleration = np.gradient(done.velocity_m_per_s, done.time_s, axis=0)
    change = np.diff(acceleration, axis=0)[1:-1].ravel()
    left = np.diff(done.error[1][:, VELOCITY], axis=0)[1:-1].ravel()
    square = float(change @ change)
    if len(change) == 0 or square == 0.0:
        return 0.0, 0.0
    offset = float(change @ left) / square
    rest = left - offset * change
    return offset, _rms(rest) / float(np.sqrt(square))


def _readings(units: Mapping[str, float]) -> Iterator[_Reading]:
    """Yield other readings of three columns: units, axes, and both."""
    for unit, factor in (("", 1.0), *units.items()):
        for axes, matrix in AXES_MEANT:
            if unit or axes:
                yield _Reading(unit, axes, factor * matrix)


def _with(flag: Flag, suits: list[_Reading]) -> Flag:
    """Return the flag of columns with the readings that suit; a unit alone comes first."""
    plain = [reading for reading in suits if not reading.axes] or suits
    named = [reading.what for reading in plain[:MAX_NAMED]]
    if not named:
        return flag
    agree_text = f"The columns agree with the reference if {', or if '.join(named)}."
    details = {**flag.details, "readings": named}
    return replace(flag, message=f"{flag.message} {agree_text}", details=details)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
