"""The results of a gyro over temperature, each axis by itself."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from procedures.estimation.channel import Channel, Screened, screen
from procedures.estimation.noise import grid_index
from station.findings import Analysis, Estimate, Flag, Published

from .dataset import AnalysisSettings, Array, Index, TemperatureDataset
from .fit import PASSED, BiasFit, Setting, fit_bias, rows_late
from .flags import data_flags, result_flags, rows_flag
from .published import published_values
from .results import estimates_of
from .soaks import soaks_of
from .thermometers import chamber_lag, thermometers_of

SETTINGS = AnalysisSettings()
MIN_RANGE_DEGC = 2.0
FEWEST_ROWS = 60
FAR = 1e9
"""Standard deviations beyond which a row is wild before there is a solution: none is."""
MAX_ROUNDS = 3


@dataclass(frozen=True)
class AxisOverTemperature:
    """One axis: `time_s` (m,) of the grid, its output without the earth's rate, and the fit."""

    axis: str
    time_s: Array
    rate_deg_per_h: Array
    setting: Setting
    fit: BiasFit | None


@dataclass(frozen=True)
class TemperatureAnalysis(Analysis):
    """The results, and what they rest on."""

    axes: tuple[AxisOverTemperature, ...] = ()


def analyse(
    dataset: TemperatureDataset, settings: AnalysisSettings = SETTINGS
) -> TemperatureAnalysis:
    """Return the results of a dataset."""
    interval_s = dataset.sample_interval_s
    index = grid_index(dataset.time_s, interval_s)
    grid = np.arange(int(index[-1]) + 1)
    time_s = dataset.time_s[0] + interval_s * grid
    thermometers = thermometers_of(dataset)
    temperature = thermometers.temperature_degC
    setting = Setting(
        temperature,
        interval_s,
        None if dataset.gyro_degC is None else dataset.sensor_lag_prior_s,
        passed_both_ways(temperature),
    )
    lag = None
    refused = bool(thermometers.refusals)
    if thermometers.gyro is not None and thermometers.chamber_good and not refused:
        lag = chamber_lag(temperature, thermometers.chamber, interval_s)
    soaks = soaks_of(dataset, temperature[index])
    estimates: list[Estimate] = []
    published: list[Published] = []
    flags: list[Flag] = [*thermometers.flags, *thermometers.refusals]
    axes = []
    for column, (axis, direction) in enumerate(dataset.directions.items()):
        earth = direction.earth_deg_per_h(dataset.latitude_rad)
        own = dataset.rate_deg_per_h[:, column] - earth
        screened, rate, fit = _solved(axis, index, own, setting, settings.outlier, refused)
        late = None if fit is None else rows_late(rate, setting, fit)
        if late is not None:
            fit = None
            flags.append(rows_flag(axis, late))
        of_axis = estimates_of(axis, dataset, setting, fit, soaks, lag, thermometers.u_degC)
        estimates += of_axis
        published += published_values(axis, own, soaks, dataset.reference_degC)
        flags += data_flags(dataset, axis, screened, settings)
        flags += result_flags(dataset, setting, axis, fit, of_axis, settings)
        axes.append(AxisOverTemperature(axis, time_s, rate, setting, fit))
    return TemperatureAnalysis(estimates, published, flags, tuple(axes))


def passed_both_ways(temperature: Array) -> bool:
    """Return whether a fifth of the range of temperatures (n,) was passed warming and cooling."""
    low, high = float(temperature.min()), float(temperature.max())
    if high - low < MIN_RANGE_DEGC:
        return False
    places = np.linspace(low, high, 101)
    up = np.zeros(len(places), dtype=bool)
    down = up.copy()
    for row in range(1, len(temperature)):
        begin, end = temperature[row - 1], temperature[row]
        if end > begin:
            up |= (places >= begin) & (places <= end)
        elif end < begin:
            down |= (places >= end) & (places <= begin)
    return bool(np.mean(up & down) >= PASSED)


def _solved(
    axis: str, index: Index, own: Array, setting: Setting, beyond: float, refused: bool
) -> tuple[Screened, Array, BiasFit | None]:
    """Return one axis screened, its rows on the grid (m,), and the solution, None without one.

    Wild rows are those far from the solution: a quiet gyro follows the corners of a ramp farther
    than its noise goes. What is missing is filled in by the solution.
    """
    output = Channel(f"the output of {axis}", "the gyro", "deg/h", limit_code="overload")
    screened = screen(output, own, FAR)
    rate = _filled(screened.on_grid(index))
    enough = int(screened.good.sum()) >= FEWEST_ROWS
    if refused or not enough or float(np.ptp(setting.temperature)) < MIN_RANGE_DEGC:
        return screened, rate, None
    setting = replace(setting, step=screened.step)
    fit = fit_bias(rate, setting)
    good, good_before = screened.good, np.ones(len(rate), dtype=bool)
    around = screened
    for _ in range(MAX_ROUNDS):
        left = np.where(good, own - fit.fitted[index], np.nan)
        around = screen(output, left, beyond)
        on_grid = replace(around, frozen=around.frozen & False).on_grid(index)
        here = np.isfinite(on_grid)
        if bool(np.array_equal(here, good_before)):
            break
        good_before = here
        rate = fit.fitted + _filled(on_grid)
        fit = fit_bias(rate, setting)
    return replace(screened, wild=around.wild, beyond=beyond), rate, fit


def _filled(values: Array) -> Array:
    """Return values on a grid (m,), interpolated where nothing is."""
    grid, good = np.arange(len(values)), np.isfinite(values)
    return np.interp(grid, grid[good], values[good]) if good.any() else np.zeros(len(grid))
