"""What the reader must know about a bias over temperature, one flag a sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.estimation.channel import Screened
from procedures.estimation.channel import flags as channel_flags
from procedures.estimation.direction import earth_flags
from procedures.estimation.flags import Gaps, gaps_of, not_identifiable, too_stiff
from procedures.estimation.recorder import largest_jump
from station.findings import Estimate, Flag, contradiction

from .dataset import AnalysisSettings, TemperatureDataset
from .fit import BiasFit, Setting
from .units import UNITS

NEAR = 0.1
"""Part of the earth's rate within which the mean output is none of it, or its opposite."""
WHY = {
    "bias": "the reference temperature is outside the range of the record",
    "bias_temperature_sensitivity": "no soak ends 5 degC or more from the reference temperature, "
    "or that is outside the range of the record",
    "bias_rate_sensitivity": "the temperature changed at one rate only, which the curve, or the "
    "hysteresis, follows as well, or the lag behind the chamber does not show",
    "hysteresis": "less than a fifth of the range was passed both ways, or at one rate without "
    "soaks, or the lag behind the chamber does not show",
    "sensor_lag": "the bias does not show how far it is behind the chamber's temperature",
    "chamber_lag": "there is no thermometer of the gyro, or its lag behind the chamber has no end "
    "that can be seen",
}
"""Why a result is undetermined where there is a solution."""


def data_flags(
    dataset: TemperatureDataset, axis: str, screened: Screened, settings: AnalysisSettings
) -> list[Flag]:
    """Return the flags on the rows of one axis."""
    flags = channel_flags([screened], axis)
    gaps = gaps_of(dataset.time_s, dataset.sample_interval_s, settings.gap)
    then = "temperature and output are interpolated there"
    flags += (gaps or Gaps()).flags("The rows have", dataset.sample_interval_s, then, axis)
    return flags


def rows_flag(axis: str, late: int) -> Flag:
    """Return the flag of an output that is not in its rows, late by so many of them."""
    where = "late" if late > 0 else "early"
    sentence = (
        f"The output of {axis} fits the temperatures far better where it is taken for {abs(late)} "
        f"rows {where}: it is not in its rows. Nothing is reported from it; put the columns into "
        "their rows."
    )
    return contradiction("rate_deg_per_h", sentence, axis, rows=late)


def result_flags(
    dataset: TemperatureDataset,
    setting: Setting,
    axis: str,
    fit: BiasFit | None,
    estimates: Sequence[Estimate],
    settings: AnalysisSettings,
) -> list[Flag]:
    """Return the flags on the results of one axis."""
    named = {estimate.name: estimate for estimate in estimates}
    lacking = [name for name in UNITS if named[name].value is None]
    flags = []
    if fit is None:
        sentence = (
            f"There is no curve of {axis}: the temperature hardly moved, too few rows are left, or "
            "a column is not what it is called."
        )
        flags.append(not_identifiable(sentence, lacking, axis))
        return flags
    for name in lacking:
        sentence = f"{name.replace('_', ' ').capitalize()} is undetermined: {WHY[name]}."
        flags.append(not_identifiable(sentence, [name], axis))
    low, high = setting.domain
    if not low <= dataset.reference_degC <= high:
        sentence = (
            f"The reference temperature {dataset.reference_degC:g} degC is outside the record's "
            f"{low:.4g} degC to {high:.4g} degC; the curve says nothing there."
        )
        flags.append(Flag("extrapolation", sentence, axis, {"range": [low, high]}))
    for name in ("bias_rate_sensitivity", "hysteresis"):
        estimate = named[name]
        if estimate.value is None or not estimate.standard_uncertainty:
            continue
        in_u = abs(estimate.value) / estimate.standard_uncertainty
        if in_u < settings.not_significant:
            words = name.replace("_", " ")
            sentence = f"The {words} of {axis} cannot be distinguished from none ({in_u:.2g} u)."
            flags.append(Flag("not-significant", sentence, axis, {"name": name, "in_u": in_u}))
    flags += _prior(dataset, axis, fit)
    direction, latitude_rad = dataset.directions[axis], dataset.latitude_rad
    mean = direction.earth_deg_per_h(latitude_rad) + float(fit.curve()[0])
    flags += earth_flags(axis, direction, latitude_rad, mean, NEAR, NEAR)
    flags += _step(axis, fit)
    lag_one = _lag_one(fit)
    if lag_one > settings.model_too_stiff:
        follows = "curve, rate and hysteresis do not follow the output"
        flags.append(too_stiff(lag_one, f" of {axis}, long waves left out", follows, axis))
    return flags


def _prior(dataset: TemperatureDataset, axis: str, fit: BiasFit) -> list[Flag]:
    """Return the flag of a lag that stands on what was stated beforehand."""
    prior = dataset.sensor_lag_prior_s
    _, u = fit.value_of("lag")
    if dataset.gyro_degC is None or not prior or u < 0.7 * prior:
        return []
    sentence = (
        f"The lag of the sensor of {axis} rests on the stated {prior:g} s: the curve is nearly a "
        "line, on which lag and sensitivity to the rate of temperature are one."
    )
    return [Flag("lag-by-prior", sentence, axis, {"prior_s": prior, "u_s": u})]


def _step(axis: str, fit: BiasFit) -> list[Flag]:
    """Return the flag of an output that steps: noise of any colour has no jump that stands out."""
    jump = largest_jump(fit.residual, 1.0, 0.0)
    if jump is None:
        return []
    row, size = jump
    sentence = (
        f"At about row {row}, counted from 0, the output of {axis} steps by {size:.3g} deg/h where "
        "no part of the model does: it is taken for slow noise, and the results are less certain. "
        "Look for what was switched or touched then, and record again."
    )
    return [Flag("output-step", sentence, axis, {"row": row, "step": size})]


def _lag_one(fit: BiasFit) -> float:
    """Return the correlation of neighbouring residuals beyond what the fitted noise brings.

    Slow noise is in the model: only what goes on from row to row counts, second differences aside.
    """
    steps = np.diff(fit.residual)
    square = float(steps @ steps)
    if square == 0.0:
        return 0.0
    return float(steps[1:] @ steps[:-1]) / square + 0.5
