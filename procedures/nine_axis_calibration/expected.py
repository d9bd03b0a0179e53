"""What a plan will determine and how well, before anything moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.nine_axis_calibration.attitude import GyroGain, StaticMeans, solve_biases
from procedures.nine_axis_calibration.dataset import Prior
from procedures.nine_axis_calibration.pose import expected_rates
from procedures.nine_axis_calibration.positions import EAST_AXIS, earth_rate, gravity_pattern

Array = NDArray[np.float64]

SECONDS_PER_HOUR = 3600.0
ACCELEROMETER_NOISE_G = 1e-5


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
        np.array([expected_rates(one, latitude_deg) for one in positions]),
        np.full((count, 3), u),
        np.array([gravity_pattern(one) for one in positions]),
        np.full((count, 3), ACCELEROMETER_NOISE_G),
    )
    gain = GyroGain(np.ones(3), np.zeros(6), np.full(6, prior.misalignment_rad))
    solved = solve_biases(means, latitude_deg, prior, gain)
    turning = earth_rate(latitude_deg)
    east = int(np.sum([one in EAST_AXIS for one in positions])) / 3
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
