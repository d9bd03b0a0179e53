"""The results of a gyro over temperature, each axis by itself."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from procedures.estimation.noise import grid_index
from procedures.estimation.screening import Screened, screen
from station.findings import Analysis, Estimate, Flag, Published

from .chamber import chamber_lag
from .dataset import AnalysisSettings, Array, TemperatureDataset
from .fit import PASSED, BiasFit, Setting, fit_bias
from .flags import data_flags, result_flags
from .published import published_values
from .results import estimates_of
from .soaks import soaks_of

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
    temperature = np.interp(grid, index, dataset.temperature_degC)
    setting = Setting(
        temperature, interval_s, dataset.sensor_lag_prior_s, passed_both_ways(temperature)
    )
    lag = None
    if dataset.gyro_degC is not None:
        chamber = np.interp(grid, index, dataset.chamber_degC)
        lag = chamber_lag(temperature, chamber, interval_s)
    soaks = soaks_of(dataset, dataset.temperature_degC)
    estimates: list[Estimate] = []
    published: list[Published] = []
    flags: list[Flag] = []
    axes = []
    for column, (axis, direction) in enumerate(dataset.directions.items()):
        earth = direction.earth_deg_per_h(dataset.latitude_rad)
        own = dataset.rate_deg_per_h[:, column] - earth
        screened, rate, fit = _solved(dataset.time_s, own, setting, settings.outlier)
        of_axis = estimates_of(axis, dataset, setting, fit, soaks, lag)
        estimates += of_axis
        published += published_values(axis, own, soaks, dataset.reference_degC)
        flags += data_flags(dataset, axis, screened, settings)
        flags += result_flags(dataset, axis, fit, of_axis, settings)
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
    time_s: Array, own: Array, setting: Setting, beyond: float
) -> tuple[Screened, Array, BiasFit | None]:
    """Return one axis screened, its rows on the grid (m,), and the solution, None without one.

    Wild rows are those far from the solution: a quiet gyro follows the corners of a ramp farther
    than its noise goes.
    """
    interval_s = setting.interval_s
    screened = screen(time_s, own, interval_s, 0.0, FAR)
    rate = _filled(screened.rate)
    enough = len(screened.there) >= FEWEST_ROWS
    if not enough or float(np.ptp(setting.temperature)) < MIN_RANGE_DEGC:
        return screened, rate, None
    fit = fit_bias(rate, setting)
    there, grid_s = np.isfinite(screened.rate), interval_s * np.arange(float(len(rate)))
    wild = 0
    for _ in range(MAX_ROUNDS):
        left = (screened.rate - fit.fitted)[there]
        around = screen(grid_s[there], left, interval_s, 0.0, beyond)
        if around.wild == wild:
            break
        wild = around.wild
        padded = np.full(len(rate), np.nan)
        first = int(np.flatnonzero(there)[0])
        padded[first : first + len(around.rate)] = around.rate
        rate = fit.fitted + _filled(padded)
        fit = fit_bias(rate, setting)
    return replace(screened, wild=wild), rate, fit


def _filled(values: Array) -> Array:
    """Return values on a grid (m,), interpolated where nothing is."""
    grid, good = np.arange(len(values)), np.isfinite(values)
    return np.interp(grid, grid[good], values[good]) if good.any() else np.zeros(len(grid))
