"""What `validate` says of a plan that has no fault: how well it determines the results."""

from __future__ import annotations

import math

import numpy as np

from procedures.nine_axis_calibration.dataset import Prior
from procedures.nine_axis_calibration.expected import Expectation, expected_uncertainty
from procedures.nine_axis_calibration.parameters import NineAxisParameters
from procedures.nine_axis_calibration.parameters import Prior as PriorModel
from station.report.numbers import format_duration, format_number

PPM = 1e6


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
    turning_s = sum(one.dwell_s for one in turns)
    bias = float(np.max(expected.bias_deg_per_h))
    noise_ppm = PPM * expected.scale_factor
    total_ppm = math.hypot(noise_ppm, parameters.prior.clock_ppm)
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
        f"misalignment: u = {format_number(_leans_arcsec(parameters), 2)} arcsec, in the frame of "
        "the mounting; noise adds next to nothing",
    )


def _leans_arcsec(parameters: NineAxisParameters) -> float:
    """Return what mounting and table leave open of a misalignment."""
    prior = prior_of(parameters.prior)
    return 3600.0 * math.degrees(math.hypot(prior.mounting_rad, prior.table_axes_rad))
