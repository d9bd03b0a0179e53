"""Step 4, second half: a drive's rates integrated to heading, without and with compensation.

Body rates (x forward, y right, z down) less the earth's rate turn the attitude, Euler angles in
NED. The file holds no accelerations: where the heading at the start is not known the vehicle is
taken to be level on the average of a minute, which keeps the horizontal part of the earth's rate,
whose direction is then unknown, out of the tilt.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from procedures.estimation.robust import robust_sigma

from .curve import Curve
from .dataset import AXES, Array, Drive
from .findings import Driven
from .turning import PPM, SECONDS_PER_HOUR, wrapped_deg

EARTH_RATE_DEG_PER_H = 15.041067
LEVEL_TIME_S = 60.0
LARGEST_ERROR_DEG = 20.0
OUTSIDE_DEGC = 1.0
LEAST_U_DEG = 1e-6


def compensate(drive: Drive, curves: Mapping[str, Curve]) -> Array:
    """Return the drive's rates over 1 + delta(T), (rows, 3); axes without a model as measured."""
    rate = drive.rate_deg_per_s.copy()
    for column, axis in enumerate(AXES):
        if axis in curves:
            error_ppm = curves[axis].error_ppm(drive.temperature_degC[:, column])
            rate[:, column] /= 1.0 + error_ppm / PPM
    return rate


def heading_deg(drive: Drive, rate_deg_per_s: Array) -> Array:
    """Return the heading at each time, not wrapped, shape (rows,), from body rates (rows, 3).

    Begins level at `first_heading_deg`. Midpoint steps; each interval has the mean of the rates at
    its ends.
    """
    rates = np.radians(0.5 * (rate_deg_per_s[1:] + rate_deg_per_s[:-1])).tolist()
    steps_s = np.diff(drive.time_s).tolist()
    earth = math.radians(EARTH_RATE_DEG_PER_H / SECONDS_PER_HOUR)
    latitude = math.radians(drive.latitude_deg)
    north, down = earth * math.cos(latitude), -earth * math.sin(latitude)
    pull = 0.0 if drive.first_heading_known else 1.0 / LEVEL_TIME_S

    def change(
        roll: float, pitch: float, heading: float, rate: list[float]
    ) -> tuple[float, float, float]:
        sr, cr, sp, cp = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
        toward, across = north * math.cos(heading), north * math.sin(heading)
        p = rate[0] - (cp * toward - sp * down)
        q = rate[1] - (sr * sp * toward - cr * across + sr * cp * down)
        r = rate[2] - (cr * sp * toward + sr * across + cr * cp * down)
        turning = (q * sr + r * cr) / cp
        return p + turning * sp - pull * roll, q * cr - r * sr - pull * pitch, turning

    roll, pitch, heading = 0.0, 0.0, math.radians(drive.first_heading_deg)
    course = [heading]
    for step_s, rate in zip(steps_s, rates, strict=True):
        one = change(roll, pitch, heading, rate)
        half = 0.5 * step_s
        two = change(roll + half * one[0], pitch + half * one[1], heading + half * one[2], rate)
        roll, pitch = roll + step_s * two[0], pitch + step_s * two[1]
        heading += step_s * two[2]
        course.append(heading)
    return np.asarray(np.degrees(np.array(course)))


def evaluate_drive(drive: Drive, curves: Mapping[str, Curve]) -> Driven:
    """Return the heading's error at the end of a drive, without and with compensation."""
    raw = heading_deg(drive, drive.rate_deg_per_s)
    better = heading_deg(drive, compensate(drive, curves))
    errors = [_error_deg(drive, course) for course in (raw, better)]
    closes = abs(errors[1]) <= LARGEST_ERROR_DEG and _follows(drive, better)
    steps_s = np.diff(drive.time_s)
    heat, outside = drive.temperature_degC[:, 2], 0.0
    model = by_bias = 0.0
    if "z" in curves:
        low, high = curves["z"].domain_degC
        beyond = (heat < low - OUTSIDE_DEGC) | (heat > high + OUTSIDE_DEGC)
        outside = float(np.mean(beyond))
        turned = drive.rate_deg_per_s[:-1, 2] * steps_s / PPM
        share = turned @ curves["z"].columns(heat[:-1])
        model = float(np.sqrt(share @ curves["z"].covariance @ share))
        model = float(np.hypot(model, turned @ curves["z"].check_ppm(heat[:-1])))
        by_bias = float(share @ curves["z"].by_bias)
    return Driven(
        time_s=drive.time_s,
        raw_deg=raw,
        compensated_deg=better,
        raw_error_deg=errors[0] if closes else None,
        compensated_error_deg=errors[1] if closes else None,
        noise_u_deg=max(_noise_deg(drive), LEAST_U_DEG),
        model_u_deg=model,
        by_bias_deg=by_bias,
        duration_h=float(np.ptp(drive.time_s)) / SECONDS_PER_HOUR,
        turned_deg=float(np.sum(np.abs(drive.rate_deg_per_s[:-1, 2]) * steps_s)),
        outside=outside,
    )


def _follows(drive: Drive, course_deg: Array) -> bool:
    """Whether a course is near the reference heading all the way, where there is one."""
    if drive.heading_deg is None:
        return True
    off = course_deg - course_deg[0] - (drive.heading_deg - drive.heading_deg[0])
    return bool(np.max(np.abs(wrapped_deg(off))) <= LARGEST_ERROR_DEG)


def _error_deg(drive: Drive, course_deg: Array) -> float:
    true_deg = 0.0
    if drive.heading_deg is not None:
        true_deg = float(drive.heading_deg[-1] - drive.heading_deg[0])
    return float(wrapped_deg(np.array([course_deg[-1] - course_deg[0] - true_deg]))[0])


def _noise_deg(drive: Drive) -> float:
    """Return what the white noise of the rate adds up to in heading.

    From its second differences, which turns of a vehicle hardly move.
    """
    rate = drive.rate_deg_per_s[:, 2]
    if len(rate) < 5:
        return 0.0
    sigma = robust_sigma(np.diff(rate, 2)) / math.sqrt(6.0)
    return sigma * float(np.sqrt(np.sum(np.diff(drive.time_s) ** 2)))
