"""Step 4: turn errors of another ramp and a drive's heading, before and after compensation.

Compensation divides: a true rate is the measured one over 1 + delta(T). Multiplied instead, an
error of 500 ppm becomes one of 1000.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from procedures.common.constants import EARTH_RATE_DEG_PER_H, SECONDS_PER_HOUR
from procedures.estimation.linear import robust_sigma
from station.findings import Flag, contradiction

from .curve import Curve
from .dataset import AXES, PPM, Array, AxisTurns, Drive, is_paired, sets_with_bias, wrapped_deg
from .solution import AxisFit

OUTSIDE_DEGC = 1.0
FEWEST = 6
CALM = 0.95
DISAGREES = 2.0
"""Rms over its uncertainty. Ramps in other directions differ by the lag of a thermometer, too."""
LEVEL_TIME_S = 60.0
LARGEST_ERROR_DEG = 20.0
MIN_U_DEG = 1e-6


@dataclass(frozen=True)
class Verified:
    """Turns of a verification ramp, one axis: errors before and after compensation.

    `before_ppm` and `after_ppm` (n,) have the bias taken off where turns of both senses show it;
    `u_ppm` (n,) is the type A uncertainty of `after_ppm`, `by_bias_ppm` (n,) what a bias of 1 deg/h
    would add. `beyond_ppm` is the rms of `after_ppm` that all this does not explain, zero where it
    may be chance. `worst` is the place of the largest magnitude after compensation; `outside`
    counts turns that lie more than a degree outside the calibrated range.
    """

    axis: str
    temperature_degC: Array
    before_ppm: Array
    after_ppm: Array
    u_ppm: Array
    by_bias_ppm: Array
    worst: int
    outside: int
    beyond_ppm: float = 0.0


def verify_axis(
    turns: AxisTurns, fit: AxisFit, gyro_bias_deg_per_h: float = 0.0
) -> Verified | None:
    """Return the errors of an axis' verification turns; None without turns or without a model.

    In a set with turns of both senses, or with a wait, the bias is taken off; among such sets a
    turn that stands alone, with its bias, proves nothing and is left out. Outside the calibrated
    range the model is held at its ends, as the compensation does.
    """
    curve = fit.curve
    if curve is None:
        return None
    errors = _set_by_set(turns, curve, fit.noise_ppm)
    sensing = turns.usable & turns.sensing
    if is_paired(turns):
        sensing &= errors[-1] == 0.0
    if not bool(sensing.any()):
        return None
    left, own_u, own_bias = (error[sensing] for error in errors)
    heat = turns.temperature_degC[sensing]
    before = left + curve.error_ppm(heat)
    after = compensated_ppm(curve, heat, before)
    low, high = curve.domain_degC
    outside = (heat < low - OUTSIDE_DEGC) | (heat > high + OUTSIDE_DEGC)
    u = np.hypot(own_u, curve.standard_uncertainty_ppm(heat))
    by_bias = own_bias - curve.error_by_bias_ppm(heat)
    explained = np.hypot(np.hypot(u, curve.check_ppm(heat)), by_bias * gyro_bias_deg_per_h)
    return Verified(
        turns.axis,
        heat,
        before,
        after,
        u,
        by_bias,
        int(np.argmax(np.abs(after))),
        int(outside.sum()),
        _beyond_ppm(after[~outside], explained[~outside]),
    )


def _beyond_ppm(after: Array, explained: Array) -> float:
    """Return the rms that the uncertainties do not explain; zero where it may be chance.

    The wild turns of a ramp are none of the curve's: the largest twentieth does not count.
    """
    if len(after) < FEWEST or not bool(np.all(explained > 0.0)):
        return 0.0
    calm = np.argsort(np.abs(after / explained))[: int(np.ceil(CALM * len(after)))]
    square, usual = float(np.mean(after[calm] ** 2)), float(np.mean(explained[calm] ** 2))
    if square <= (DISAGREES**2) * usual:
        return 0.0
    return float(np.sqrt(square - usual))


def compensated_ppm(curve: Curve, temperature_degC: Array, error_ppm: Array) -> Array:
    """Return what compensation leaves of scale-factor errors, in ppm."""
    model = 1.0 + curve.error_ppm(temperature_degC) / PPM
    return np.asarray(((1.0 + error_ppm / PPM) / model - 1.0) * PPM)


def _set_by_set(
    turns: AxisTurns, curve: Curve, noise_ppm: float | None
) -> tuple[Array, Array, Array]:
    """Return what the curve leaves of each turn's scale-factor error, and what that depends on.

    That is its uncertainty, and what 1 deg/h of bias adds. The curve is taken off first: the turns
    of a set have not quite the same temperature.
    """
    left, u, by_bias = (np.full(len(turns.rows), np.nan) for _ in range(3))
    noise = noise_ppm or 0.0
    data = turns.data_ppm - turns.turns * curve.error_ppm(turns.temperature_degC)
    alone = turns.usable & turns.sensing
    scale = turns.turns[alone]
    left[alone] = data[alone] / scale
    u[alone], by_bias[alone] = noise / np.abs(scale), turns.by_bias_ppm[alone] / scale
    for turn_set in sets_with_bias(turns, turns.usable, data):
        left[turn_set.rows], u[turn_set.rows], by_bias[turn_set.rows] = (
            turn_set.error_ppm,
            noise * turn_set.u,
            0.0,
        )
    return left, u, by_bias


@dataclass(frozen=True)
class Driven:
    """The vehicle test: error of heading at its end, without and with compensation, in deg.

    `time_s`, `raw_deg` and `compensated_deg` (n,) are the courses of the heading. Errors are None
    where they are too large to be those of a drive that closes. `noise_u_deg` comes of the rates'
    noise, `model_u_deg` of the model, `by_bias_deg` is what a bias of 1 deg/h in the model takes
    off; `outside` is the part of the time outside the calibrated range.
    """

    time_s: Array
    raw_deg: Array
    compensated_deg: Array
    raw_error_deg: float | None
    compensated_error_deg: float | None
    noise_u_deg: float
    model_u_deg: float
    by_bias_deg: float
    duration_h: float
    turned_deg: float
    outside: float


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

    Rates (x forward, y right, z down) less the earth's turn the attitude, Euler angles in NED, at
    first level and at `first_heading_deg`. Midpoint steps; each interval has the mean of the rates
    at its ends. The file holds no accelerations: where the heading at the start is not known the
    vehicle is taken to be level on the average of a minute, which keeps the horizontal part of the
    earth's rate, whose direction is then unknown, out of the tilt.
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
    headings = [heading]
    for step_s, rate in zip(steps_s, rates, strict=True):
        change_of_heading = change(roll, pitch, heading, rate)
        half = 0.5 * step_s
        two = change(
            roll + half * change_of_heading[0],
            pitch + half * change_of_heading[1],
            heading + half * change_of_heading[2],
            rate,
        )
        roll, pitch = roll + step_s * two[0], pitch + step_s * two[1]
        heading += step_s * two[2]
        headings.append(heading)
    return np.asarray(np.degrees(np.array(headings)))


def evaluate_drive(drive: Drive, curves: Mapping[str, Curve]) -> Driven:
    """Return the heading's error at the end of a drive, without and with compensation."""
    raw = heading_deg(drive, drive.rate_deg_per_s)
    better = heading_deg(drive, compensate(drive, curves))
    errors = [_error_deg(drive, headings_deg) for headings_deg in (raw, better)]
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
        noise_u_deg=max(_noise_deg(drive), MIN_U_DEG),
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


def verification_flags(verified: Verified | None) -> list[Flag]:
    """Return the flags of a verification ramp that denies the curve, or went beyond its range."""
    if verified is None:
        return []
    flags = []
    if verified.beyond_ppm > 0.0:
        rms = float(np.sqrt(np.mean(verified.after_ppm**2)))
        denied_text = (
            f"The verification ramp contradicts the curve of {verified.axis}: after compensation "
            f"its turns are {rms:.3g} ppm rms off, of which {verified.beyond_ppm:.3g} ppm are no "
            "noise. The curve's uncertainty holds that; hysteresis, a thermometer that lags, or a "
            "gyro that changed."
        )
        flags.append(contradiction("verification", denied_text, verified.axis, rms_ppm=rms))
    if not verified.outside:
        return flags
    outside_text = (
        f"{verified.outside} verification turns about {verified.axis} were made outside the "
        "calibrated range; there the compensation holds the value at the end of the range."
    )
    details = {"count": verified.outside}
    return [*flags, Flag("extrapolation", outside_text, verified.axis, details)]
