"""The results of a gyro over temperature, each axis by itself, in the order of the contract."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procedures.estimation.channel import Channel, Screened, screen
from procedures.estimation.measured import Measured
from procedures.estimation.noise import grid_index
from station.findings import Analysis, Estimate, Flag, Published, undetermined

from .checks import chamber_lag, data_flags, no_curve, result_flags, rows_flags, thermometers_of
from .dataset import FEWEST_ROWS, AnalysisSettings, Array, Index, Soak, TemperatureDataset, soaks_of
from .model import Setting
from .parameters import UNITS
from .solution import PASSED, BiasFit, fit_bias

SETTINGS = AnalysisSettings()
MIN_RANGE_DEGC = 2.0
FAR = 1e9
"""Standard deviations beyond which a row is wild before there is a solution: none is."""
SPANS = 20.0
"""Of nine tenths of the rows: a row so far from their middle is of no gyro, whatever the curve."""
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
    """Return the results of a dataset; all null where it has too few rows."""
    if len(dataset.time_s) < FEWEST_ROWS:
        return _nothing(dataset)
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
        switched_on(dataset, index, grid),
    )
    lag = None
    refused = bool(thermometers.refusals)
    if thermometers.gyro is not None and thermometers.chamber_good and not refused:
        measured = np.isin(grid, index)
        lag = chamber_lag(temperature, thermometers.chamber, interval_s, measured)
    soaks = soaks_of(dataset, temperature[index])
    estimates: list[Estimate] = []
    published: list[Published] = []
    flags: list[Flag] = [*thermometers.flags, *thermometers.refusals]
    axes = []
    for column, (axis, direction) in enumerate(dataset.directions.items()):
        earth = direction.earth_deg_per_h(dataset.latitude_rad)
        own = dataset.rate_deg_per_h[:, column] - earth
        screened, rate, fit = _solved(axis, index, own, setting, settings.outlier, refused)
        if fit is not None and (late := rows_flags(axis, rate, setting, fit)):
            fit = None
            flags += late
        of_axis = estimates_of(axis, dataset, setting, fit, soaks, lag, thermometers.u_degC)
        estimates += of_axis
        published += published_values(axis, own, soaks, dataset.reference_degC)
        flags += data_flags(dataset, axis, screened, settings)
        flags += result_flags(dataset, setting, axis, fit, of_axis, settings)
        axes.append(AxisOverTemperature(axis, time_s, rate, setting, fit))
    return TemperatureAnalysis(estimates, published, flags, tuple(axes))


def _nothing(dataset: TemperatureDataset) -> TemperatureAnalysis:
    """Return that nothing is known of any axis."""
    axes = [*dataset.directions]
    return TemperatureAnalysis(
        [undetermined(name, axis, unit, METHOD) for axis in axes for name, unit in UNITS.items()],
        [own for axis in axes for own in published_values(axis, np.empty(0), (), 0.0)],
        [no_curve(axis, [*UNITS]) for axis in axes],
    )


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


def switched_on(dataset: TemperatureDataset, index: Index, grid: Index) -> Array:
    """Return a column of zero mean for each switch-on after the first, on the grid (n,)."""
    if dataset.switch_on is None:
        return np.empty((len(grid), 0))
    numbers = dataset.switch_on[np.searchsorted(index, grid)]
    columns = [(numbers == number).astype(float) for number in np.unique(numbers)[1:]]
    columns = [column - column.mean() for column in columns]
    return np.column_stack([np.empty((len(grid), 0)), *columns])


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
    rate = _filled(_begun(screened).on_grid(index))
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


def _begun(screened: Screened) -> Screened:
    """Return an output without the rows that would bend the first solution beyond use.

    A board that stood still counts what it missed into one row.
    """
    low, middle, high = np.quantile(screened.there, (0.05, 0.5, 0.95))
    far = np.abs(screened.values - middle) > SPANS * (high - low + screened.step)
    return replace(screened, wild=screened.wild | far)


def _filled(values: Array) -> Array:
    """Return values on a grid (m,), interpolated where nothing is."""
    grid, good = np.arange(len(values)), np.isfinite(values)
    return np.interp(grid, grid[good], values[good]) if good.any() else np.zeros(len(grid))


METHOD = "maximum-likelihood"
INNER = 0.9
"""Part of the range over which the largest slope is looked for."""
PLACES = 181
DRAWS = 500
"""Curves about the solution, and as many opposite ones."""


def estimates_of(
    axis: str,
    dataset: TemperatureDataset,
    setting: Setting,
    fit: BiasFit | None,
    soaks: Sequence[Soak],
    lag: Measured | None,
    u_degC: float,
) -> list[Estimate]:
    """Return one estimate for each result of an axis; those without a value are undetermined.

    `u_degC` is what rounding and steps leave unknown of the temperature.
    """
    values: dict[str, Measured | None] = dict.fromkeys(UNITS)
    values["chamber_lag"] = lag
    if fit is not None:
        values |= _of_curve(dataset, setting, fit, soaks, u_degC)
        for name, place in (("bias_rate_sensitivity", "s"), ("hysteresis", "H")):
            if fit.alone.get(place) and fit.lag_seen:
                values[name] = Measured(*fit.value_of(place))
        if fit.lag_seen:
            values["sensor_lag"] = Measured(*fit.value_of("lag"))
    estimates = []
    for name, unit in UNITS.items():
        method = "least-squares" if name == "chamber_lag" else METHOD
        measured = values[name]
        if measured is None:
            estimates.append(undetermined(name, axis, unit, method))
            continue
        depends, extra = {}, {}
        if name == "bias" and fit is not None:
            north, up = dataset.directions[axis].sensitivities(dataset.latitude_rad)
            depends = {f"azimuth_{axis}": -north, f"elevation_{axis}": -up}
            low, high = setting.domain
            held_at = {"temperature": f"{dataset.reference_degC:g} degC"}
            if dataset.gyro_degC is None:
                held_at["thermometer"] = "the chamber's thermometer"
            extra = {
                "conditions": held_at,
                "model": {
                    "basis": "chebyshev",
                    "domain": [low, high],
                    "unit": "degC",
                    "coefficients": fit.curve().tolist(),
                },
            }
        freedom = measured.degrees_of_freedom
        estimates.append(
            Estimate(name, axis, measured.value, unit, measured.u, freedom, method, depends, extra)
        )
    return estimates


def _of_curve(
    dataset: TemperatureDataset,
    setting: Setting,
    fit: BiasFit,
    soaks: Sequence[Soak],
    u_degC: float,
) -> dict[str, Measured | None]:
    low, high = setting.domain
    reference = dataset.reference_degC
    curve, per_degC = fit.curve(), 2.0 / (high - low)
    inner = fit.slope_rows(np.linspace(-INNER, INNER, PLACES)) * per_degC
    values: dict[str, Measured | None] = {"largest_bias_slope": _largest(fit, inner)}
    if low <= reference <= high:
        at = setting.scaled(np.array([reference]))
        bias, u = fit.bias_at(float(at[0]))
        slope = float(fit.slope_rows(at)[0] @ curve) * per_degC
        values["bias"] = Measured(bias, float(np.hypot(u, slope * u_degC)))
        ends = np.array([soak.temperature_degC for soak in soaks])
        ends = ends[np.abs(ends - reference) >= APART_DEGC]
        if len(ends):
            there, spans = setting.scaled(ends), ends - reference
            rows = (fit.rows(there) - fit.rows(at)) / spans[:, None]
            more = fit.slope_rows(there) @ curve * per_degC * u_degC / spans
            values["bias_temperature_sensitivity"] = _largest(fit, rows, more)
    return values


def _largest(fit: BiasFit, rows: Array, more: Array | None = None) -> Measured:
    """Return the largest size of what follows from the curve by `rows` (n, order + 1).

    `more` (n,) is what else is unknown of each. The largest of noisy values is too large, and it
    may be another: u is the root mean square by which the largest of curves drawn about the
    solution stand off its own.
    """
    width = rows.shape[1]
    scale, axes = np.linalg.eigh(fit.covariance[:width, :width])
    # Orthogonal draws: where one place is by far the largest, u is just its own.
    drawn = np.linalg.qr(np.random.default_rng(DRAWS).standard_normal((DRAWS, width)))[0]
    root = (axes * np.sqrt(np.maximum(scale, 0.0))) @ axes.T
    apart = np.sqrt(DRAWS) * np.vstack([drawn, -drawn]) @ root @ rows.T
    value = rows @ fit.sizes[:width]
    at = int(np.argmax(np.abs(value)))
    largest = float(np.abs(value[at]))
    off = np.abs(value + apart).max(axis=1) - largest
    further = 0.0 if more is None else float(more[at])
    return Measured(largest, float(np.sqrt(np.mean(off**2) + further**2)))


PUBLISHED = "soak-means"
NEAR_DEGC = 10.0
APART_DEGC = 5.0


def published_values(
    axis: str, rate: Array, soaks: Sequence[Soak], reference_degC: float
) -> list[Published]:
    """Return the soak means' bias and sensitivity; `rate` (n,) in deg/h without the earth's."""
    values: dict[str, float | None] = {"bias": None, "bias_temperature_sensitivity": None}
    means = [(soak.temperature_degC, float(np.nanmean(rate[soak.rows]))) for soak in soaks]
    if means:
        at, bias = min(means, key=lambda mean: abs(mean[0] - reference_degC))
        if abs(at - reference_degC) <= NEAR_DEGC:
            values["bias"] = bias
            slopes = [
                abs(other - bias) / abs(there - at)
                for there, other in means
                if abs(there - at) >= APART_DEGC
            ]
            values["bias_temperature_sensitivity"] = max(slopes, default=None)
    return [Published(name, axis, value, UNITS[name], PUBLISHED) for name, value in values.items()]
