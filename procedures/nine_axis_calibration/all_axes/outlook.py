"""How well a plan's directions determine accelerometers and frame, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from procedures.common.constants import ARCSEC_PER_RAD, FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.nine_axis_calibration.directions import AXES
from procedures.nine_axis_calibration.parameters import NineAxisParameters
from procedures.nine_axis_calibration.pose import ATTITUDES, UP
from station.report.numbers import format_number

from .inertial import SENSOR, B, Inertial, K, M, Orientation, solve_inertial
from .reading import lean_rad
from .stands import Array, OtherAxes, direction
from .waves import Response

NOISE_G = 1e-4
"""Of an accelerometer in one second: what sensors of this class have."""
FACES_DOWN = ("-X", "-Y", "-Z")


def outlook_of_other_axes(
    parameters: NineAxisParameters, expected: Inertial | None
) -> Iterator[str]:
    """Yield in lines what the directions determine, and what each further pose adds to it."""
    if expected is None:
        yield (
            "accelerometers: not determined, and misalignments hold the mounting; they need "
            "directions that face down, such as `poses: [-X, -Y, -Z]`"
        )
        return
    bias_ug, scale_ppm, lean_arcsec = sizes(expected)
    yield (
        f"accelerometers: u = {format_number(bias_ug, 2)} ug of the bias, "
        f"{format_number(scale_ppm, 2)} ppm of the scale factor; misalignment in their frame: "
        f"u = {format_number(lean_arcsec, 2)} arcsec"
    )
    for word in parameters.poses:
        others = [other for other in parameters.poses if other != word]
        without = expected_inertial(parameters, others)
        if without is None:
            yield f"  without pose {word} the accelerometers are not determined"
            continue
        bias, scale, lean = sizes(without)
        yield (
            f"  without pose {word}: {format_number(bias, 2)} ug, {format_number(scale, 2)} ppm, "
            f"{format_number(lean, 2)} arcsec"
        )


def sizes(expected: Inertial) -> tuple[float, float, float]:
    """Return the largest u of a bias in ug, of a scale factor in ppm, of a gyro's lean in arcsec.

    The last is NaN where not all gyros are turned.
    """
    u = np.sqrt(np.diag(expected.covariance))
    lean = float(np.max(u[M:SENSOR])) if expected.gyros else math.nan
    return 1e6 * float(np.max(u[B])), 1e6 * float(np.max(u[K])), ARCSEC_PER_RAD * lean


def expected_inertial(parameters: NineAxisParameters, poses: Sequence[str]) -> Inertial | None:
    """Return the fit of noiseless means with the u that the plan's times allow; None as there."""
    orientations = [
        *_at_rest(parameters, poses),
        *(_turned(parameters, word) for word in parameters.all_turned),
    ]
    prior = parameters.prior
    data = OtherAxes(
        (),
        (),
        parameters.latitude_deg,
        math.radians(prior.tilt_arcmin / 60.0),
        parameters.local_gravity_g,
        prior.local_gravity_g,
        second_order_u=prior.accelerometer_second_order_ug_per_g2 * 1e-6,
    )
    return solve_inertial(orientations, data)


def _at_rest(parameters: NineAxisParameters, poses: Sequence[str]) -> Iterator[Orientation]:
    prior = parameters.prior
    for position in parameters.all_positions:
        up = np.asarray(ATTITUDES[position] @ UP, dtype=np.float64)
        lean = lean_rad(prior, up, prior.tilt_arcmin)
        yield _orientation(parameters, up, lean, parameters.static_time_s)
    for word in poses:
        named = direction(word)
        assert named is not None
        lean = lean_rad(prior, named, prior.tilt_arcmin)
        yield _orientation(parameters, named, lean, parameters.pose_time_s)


def _turned(parameters: NineAxisParameters, word: str) -> Orientation:
    up, prior = direction(word), parameters.prior
    assert up is not None
    mounting = prior.tilt_arcmin if prior.mounting_arcmin is None else prior.mounting_arcmin
    own = [turn for turn in parameters.all_turns if turn.axis == word]
    rate = np.array([turn.rate_deg_per_s for turn in own])
    time_s = np.array([turn.turns * FULL_TURN_DEG for turn in own]) / np.abs(rate)
    noise = parameters.angle_random_walk_deg_per_sqrt_h / math.sqrt(SECONDS_PER_HOUR)
    gain_u = noise / math.sqrt(float(np.sum(rate**2 * time_s)))
    none = np.zeros((0, 3))
    response = Response(
        up, np.full(3, gain_u), np.zeros(0), none, none, np.zeros(3)
    )  # The square of the rate takes the force of all but the slowest records.
    slow_s = float(time_s[np.abs(rate) == np.abs(rate).min()].sum())
    return _orientation(parameters, up, lean_rad(prior, up, mounting), slow_s, response)


def _orientation(
    parameters: NineAxisParameters,
    up: Array,
    u_rad: float,
    time_s: float,
    response: Response | None = None,
) -> Orientation:
    name = "+".join(AXES[n] for n in np.flatnonzero(up))
    force_u = np.full(3, NOISE_G / math.sqrt(time_s))
    return Orientation(name, up, u_rad, parameters.local_gravity_g * up, force_u, response)
