"""What a plan determines and how well, before anything moves; `validate` prints it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.common.constants import FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.common.gyro_source import IMU
from station import registry
from station.procedure import Problem, RecordUse
from station.report.numbers import format_duration, format_number
from station.roles.turntable import unnamed_axes

from .all_axes.outlook import expected_inertial, outlook_of_other_axes
from .attitude import GyroGain, StaticMeans, solve_biases
from .dataset import Array, Prior
from .in_coil import AMBIENT_MT, GAUSSMETER
from .parameters import COILS, NineAxisParameters
from .parameters import Prior as PriorModel
from .placing import RATES, TURNTABLE
from .pose import EAST_AXIS, earth_rate, expected_rates, gravity_pattern

if TYPE_CHECKING:
    from station.instruments.bench import Bench

IN_COIL = ("parameters", "magnetometer_in_coil")
TURNED_DOWN = ("parameters", "turned_down_rates")
RATE = "rate"
ACCELEROMETER_NOISE_G = 1e-5
PPM = 1e6


def records(parameters: NineAxisParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the table's angle, a coil's field."""
    angle = RecordUse(TURNTABLE, "angle", FULL_TURN_DEG, "deg")
    in_coil = parameters.magnetometer_in_coil
    if in_coil is None:
        return (angle,)
    return (angle, RecordUse(GAUSSMETER, "field", max(in_coil.levels_mT) + AMBIENT_MT, "mT"))


def check(parameters: NineAxisParameters, bench: Bench) -> Iterator[Problem]:
    """Yield each rate that the sensor cannot follow, and what the bench does not say of its table.

    A sensor's range is the bench file's `rate` limit of the imu.
    """
    table = bench.instruments.get(TURNTABLE)
    if table is not None and parameters.positioning == "table":
        for what in unnamed_axes(TURNTABLE, table.settings):
            yield Problem(("parameters", "positioning"), f"{what}, or take positioning: plate")
    gaussmeter = bench.instruments.get(GAUSSMETER)
    if (
        parameters.magnetometer_in_coil is not None
        and gaussmeter is not None
        and registry.load(registry.DRIVERS, gaussmeter.driver).axes < len(COILS)
    ):
        what = "the gaussmeter of this bench reads one axis; the magnetometer needs all three"
        yield Problem(IN_COIL, what)
    sensor = bench.instruments.get(IMU)
    if sensor is None:
        return
    driver = registry.load(registry.DRIVERS, sensor.driver)
    if refusal := getattr(driver, "rates_said", lambda rate_Hz: "")(parameters.sample_rate_Hz):
        yield Problem(("parameters", "sample_rate"), refusal)
    range_deg_per_s = sensor.limits.get(RATE)
    if range_deg_per_s is None:
        return
    turned_down = parameters.turned_down_rates_deg_per_s if parameters.turned_down else ()
    for rate in (*parameters.rates_deg_per_s, *turned_down):
        if rate >= range_deg_per_s:
            yield Problem(
                RATES if rate in parameters.rates_deg_per_s else TURNED_DOWN,
                f"{rate:g} deg/s is not below the gyro's range on this bench, "
                f"{range_deg_per_s:g} deg/s",
            )


@dataclass(frozen=True)
class Expectation:
    """Standard uncertainties to expect from white noise and the priors.

    `bias_deg_per_h` (3,) of the best estimate, `published_bias_deg_per_h` of the east axis alone,
    heading included; the same for the scale factor, as a ratio. `asymmetry` is a ratio, too.
    """

    bias_deg_per_h: Array
    published_bias_deg_per_h: float
    scale_factor: float
    published_scale_factor: float
    asymmetry: float


def expected_uncertainty(
    positions: Sequence[int],
    static_time_s: float,
    rates_deg_per_s: Array,
    dwell_s: Array,
    angle_random_walk_deg_per_sqrt_h: float,
    latitude_deg: float,
    prior: Prior,
) -> Expectation:
    """Return the bounds (Cramer-Rao) of a plan in white noise; rates and dwells (n,)."""
    u = angle_random_walk_deg_per_sqrt_h / np.sqrt(static_time_s / SECONDS_PER_HOUR)
    count = len(positions)
    means = StaticMeans(
        tuple(positions),
        np.array([expected_rates(position, latitude_deg) for position in positions]),
        np.full((count, 3), u),
        np.array([gravity_pattern(position) for position in positions]),
        np.full((count, 3), ACCELEROMETER_NOISE_G),
    )
    gain = GyroGain(np.ones(3), np.zeros(6), np.full(6, prior.misalignment_rad))
    solved = solve_biases(means, latitude_deg, prior, gain)
    turning = earth_rate(latitude_deg)
    east = int(np.sum([position in EAST_AXIS for position in positions])) / 3
    published = np.sqrt(
        u**2 / east + (turning[1] * prior.heading_rad) ** 2 + (turning[2] * prior.tilt_rad) ** 2
    )
    noise = (
        angle_random_walk_deg_per_sqrt_h / np.sqrt(dwell_s / SECONDS_PER_HOUR) / SECONDS_PER_HOUR
    )
    own = noise / (np.sqrt(2.0) * rates_deg_per_s)
    weight = 1.0 / own**2
    return Expectation(
        np.sqrt(np.diag(solved.covariance)),
        float(published),
        float(1.0 / np.sqrt(weight.sum())),
        float(np.sqrt(np.sum(own**2)) / len(own)),
        _asymmetry(noise, rates_deg_per_s),
    )


def _asymmetry(noise: Array, rates: Array) -> float:
    """Return the bound of the asymmetry: twice the slope of the senses' mean against the rate."""
    design = np.column_stack((np.ones(len(rates)), rates)) / (noise / np.sqrt(2.0))[:, None]
    return 2.0 * float(np.sqrt(np.linalg.inv(design.T @ design)[1, 1]))


def prior_of(model: PriorModel) -> Prior:
    """Return the prior of a plan or dataset as the analysis takes it."""
    mounting = model.tilt_arcmin if model.mounting_arcmin is None else model.mounting_arcmin
    return Prior(
        heading_rad=math.radians(model.heading_arcmin / 60.0),
        relative_heading_rad=math.radians(model.relative_heading_arcmin / 60.0),
        tilt_rad=math.radians(model.tilt_arcmin / 60.0),
        accelerometer_bias_g=model.accelerometer_bias_g,
        misalignment_rad=math.radians(model.misalignment_arcmin / 60.0),
        mounting_rad=math.radians(mounting / 60.0),
        table_axes_rad=math.radians(model.table_axes_arcsec / 3600.0),
    )


def expectation(parameters: NineAxisParameters) -> Expectation:
    """Return the uncertainties that a plan's noise and priors allow."""
    rates = np.array(parameters.rates_deg_per_s)
    turns = np.array([parameters.turns_at(rate) for rate in parameters.rates_deg_per_s])
    return expected_uncertainty(
        parameters.all_positions,
        parameters.static_time_s,
        rates,
        360.0 * turns / rates,
        parameters.angle_random_walk_deg_per_sqrt_h,
        parameters.latitude_deg,
        prior_of(parameters.prior),
    )


def outlook(parameters: NineAxisParameters) -> tuple[str, ...]:
    """Return in lines how long a plan turns and how well it determines what."""
    expected = expectation(parameters)
    turns = parameters.all_turns
    turning_s = sum(turn.dwell_s for turn in turns)
    bias = float(np.max(expected.bias_deg_per_h))
    noise_ppm = PPM * expected.scale_factor
    total_ppm = math.hypot(noise_ppm, parameters.prior.clock_ppm)
    accelerometers = expected_inertial(parameters, parameters.poses)
    in_mounting = (
        f"misalignment: u = {format_number(_leans_arcsec(parameters), 2)} arcsec, in the frame of "
        "the mounting; noise adds next to nothing"
    )
    return (
        f"{len(parameters.all_positions)} positions of "
        f"{format_duration(parameters.static_time_s)}, {len(turns)} records of whole turns, "
        f"{format_duration(turning_s)} in all.",
        f"bias: u = {format_number(bias, 2)} deg/h from all means; "
        f"{format_number(expected.published_bias_deg_per_h, 2)} deg/h as published, from the east "
        "axis alone, heading included",
        f"scale factor: u = {format_number(total_ppm, 2)} ppm, of which noise makes "
        f"{format_number(noise_ppm, 2)} ppm; it makes "
        f"{format_number(PPM * expected.published_scale_factor, 2)} ppm as published, or where the "
        "rates differ beyond noise",
        f"asymmetry: u = {format_number(PPM * expected.asymmetry, 2)} ppm",
        *(() if accelerometers is not None and accelerometers.gyros else (in_mounting,)),
        *outlook_of_other_axes(parameters, accelerometers),
    )


def _leans_arcsec(parameters: NineAxisParameters) -> float:
    """Return what mounting and table leave open of a misalignment."""
    prior = prior_of(parameters.prior)
    return 3600.0 * math.degrees(math.hypot(prior.mounting_rad, prior.table_axes_rad))
