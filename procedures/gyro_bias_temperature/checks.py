"""The thermometers of the gyro and of the chamber: what they read, and whether that can be.

Readings that are none are filled in by what drives the thermometer: the chamber's by its set-point,
the gyro's by the chamber, behind its lag. What contradicts the columns as they are named is not
mended: nothing is reported from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.optimize import minimize_scalar

from procedures.estimation.channel import Channel, Screened, screen
from procedures.estimation.channel import flags as channel_flags
from procedures.estimation.direction import earth_flags
from procedures.estimation.flags import Gaps, gaps_of, not_identifiable, too_stiff
from procedures.estimation.measured import Measured
from procedures.estimation.noise import grid_index
from procedures.estimation.plausibility import Bounds, implausible
from procedures.estimation.rate_spectrum import coefficients, noise_variances
from procedures.estimation.readings import (
    Reading,
    Remainder,
    exchanged,
    named,
    shifted,
    suiting,
)
from procedures.estimation.recorder import largest_jump
from procedures.estimation.reml import Stretch, solve
from station.findings import Estimate, Flag, contradiction

from .dataset import AnalysisSettings, Array, Index, Mask, TemperatureDataset, soaks_of
from .model import Lags, Setting, lagged
from .parameters import UNITS
from .solution import BiasFit

GYRO, CHAMBER, SET_POINT = "gyro_temperature_degC", "chamber_temperature_degC", "set_point_degC"
COLDEST_DEGC, HOTTEST_DEGC = -100.0, 400.0
"""No gyro is tested beyond, in kelvin either."""
HARMLESS_DEGC = 0.4
"""An air that is controlled jumps about by so much, and no result feels it."""
QUIET_DEGC, NARROWEST, WIDEST = 0.05, 5, 121
"""Noise and rounding of a gyro's thermometer; with more, what it leaves of the chamber's lagged
temperature is averaged over so many rows, lest its rate be noise."""
MIN_GOOD = 0.5
"""Of a thermometer's readings; what is filled in for more would be no measurement."""
STEPS_MENDED = 3
MAX_OFF_DEGC = 5.0
"""By so much the ends of soaks may be off their set-points, in the chamber's air."""
MAX_WARMER_DEGC = 25.0
"""By so much a gyro warms itself."""
GAINS = 0.94, 1.06
"""Change of a thermometer over that of the set-point."""
LATE_S = (-3600.0, -1800.0, -1200.0, -600.0, 600.0, 1200.0, 1800.0, 3600.0)
"""How late rows may be: a second lag of a gyro looks late by less."""
FOLLOWS_DEGC = 0.1
"""What a thermometer that stands as stated may leave of a first-order lag, whatever its cause."""
BETTER = 0.7
"""Part of the rms that temperatures as stated leave, which those read otherwise must not leave."""
AS_GOOD = 2.0
"""Times the rms of the best reading: another one leaves more, and is none."""
SLOW_S = 1800.0
"""Temperatures nearer in time are no second proof."""
ROWS_LATE = (-60, -45, -30, -20, -15, -10, -5, 5, 10, 15, 20, 30, 45, 60)
LONGEST_GAP = 0.5
"""Of the lag: a longer gap divides the record."""
LAG_SHARES = 0.1, 0.5
"""Parts of the lag that are tried with rows read otherwise, which may be of it."""
SHIFT_SEEN = 30.0
"""In -2 ln of the likelihood: no lag of a sound record falls behind a delay by a tenth of it."""
STEPPED_SET_POINT_DEGC, SETTLING_ROWS = 3.0, 20
"""From row to row: the air jumps with a set-point that does."""
THEN = "Their temperature is filled in by that of {}."
STEPPED = (
    "The readings after it are set back to those before it, and half of the step is in u of the "
    "bias. Look at the thermometer's place and its cable."
)
UNITS_OF_TEMPERATURE = {"degrees Fahrenheit": (1.8, 32.0), "kelvin": (1.0, 273.15)}
"""Degrees in one degC, and where 0 degC is."""
COARSE = "where it stands still, so does its rounding: u of the bias holds that."

SHORTEST_ROWS = 0.2
"""Of an interval: a lag below it cannot be distinguished from none."""
MAX_PART = 0.3
"""Of the record: a longer lag has no end to be seen."""
IN_A_ROW = 0.005
"""Of an interval: what rows that are means leave unknown of the corners of a ramp."""
MIN_RANGE = 2.0
MOVED_DEGC = 10.0
"""A chamber does not move by so much while its set-point stands."""


def chamber_lag(
    gyro: Array, chamber: Array, interval_s: float, good: Mask | None = None
) -> Measured | None:
    """Return the first-order lag in s of a gyro's thermometer (n,) behind a chamber's, degC.

    The two may differ by a constant, and begin apart. Rows that are not `good` do not count; after
    a stretch of them that is no small part of the lag, in which the way of the air is not known,
    the two begin apart again. None where the chamber hardly moved.
    """
    rows = np.ones(len(gyro), dtype=bool) if good is None else good
    measured = np.flatnonzero(rows)
    if not len(measured) or float(np.ptp(chamber[rows])) < MIN_RANGE:
        return None
    whole = _lag_of_stretches(gyro, chamber, interval_s, rows, [])
    longest_s = LONGEST_GAP * whole.value if whole is not None else 0.0
    gaps = interval_s * np.diff(measured)
    if whole is None or float(np.max(gaps, initial=0.0)) <= longest_s:
        return whole
    again = measured[1:][gaps > longest_s].tolist()
    return _lag_of_stretches(gyro, chamber, interval_s, rows, again)


def _lag_of_stretches(
    gyro: Array, chamber: Array, interval_s: float, rows: Mask, again: list[int]
) -> Measured | None:
    """Return the lag where the two begin apart at the first row and `again` at others."""
    time_s = interval_s * np.arange(len(gyro))
    edges = [0, *again, len(gyro)]

    def columns(lag_s: float) -> Array:
        behind, parts = np.empty(len(gyro)), [np.ones(len(gyro))]
        for start, stop in pairwise(edges):
            behind[start:stop] = lagged(chamber[start:stop], lag_s, interval_s)
            begins = np.zeros(len(gyro))
            begins[start:stop] = np.exp(-(time_s[start:stop] - time_s[start]) / lag_s)
            parts.append(begins)
        return np.column_stack([behind, *parts])[rows]

    def left(log_lag: float) -> Array:
        behind, *rest = columns(float(np.exp(log_lag))).T
        own, target = np.column_stack(rest), gyro[rows] - behind
        return np.asarray(target - own @ np.linalg.lstsq(own, target, rcond=None)[0])

    shortest, longest = SHORTEST_ROWS * interval_s, MAX_PART * float(time_s[-1])
    grid = np.linspace(np.log(shortest), np.log(longest), 25)
    squares = [float(np.sum(left(float(tried)) ** 2)) for tried in grid]
    at = int(np.argmin(squares))
    if at in (0, len(grid) - 1):
        return None
    best = minimize_scalar(
        lambda tried: float(np.sum(left(tried) ** 2)), bounds=(grid[at - 1], grid[at + 1])
    )
    lag_s = float(np.exp(best.x))
    residual = left(best.x)
    derivative = (left(best.x + 1e-3) - left(best.x - 1e-3)) / (2e-3 * lag_s)
    own = columns(lag_s)[:, 1:]
    derivative = derivative - own @ np.linalg.lstsq(own, derivative, rcond=None)[0]
    # Neighbours are correlated where the gyro is no first-order system: fewer of them count.
    lag_one = float(np.clip(residual[1:] @ residual[:-1] / (residual @ residual), 0.0, 0.99))
    variance = float(residual @ residual) / (len(residual) - 4) * (1 + lag_one) / (1 - lag_one)
    own_u = variance / float(derivative @ derivative)
    return Measured(lag_s, float(np.sqrt(own_u + (IN_A_ROW * interval_s) ** 2)))


@dataclass(frozen=True)
class Thermometers:
    """What the thermometers read, on the grid of the rows, degC; `gyro` is None without one.

    `flags` are of readings, `refusals` of columns that are not what they are called. `chamber_good`
    says that the chamber's column is; `u_degC` is what steps and rounding leave unknown.
    """

    chamber: Array
    gyro: Array | None
    flags: tuple[Flag, ...]
    refusals: tuple[Flag, ...]
    chamber_good: bool
    u_degC: float

    @property
    def temperature_degC(self) -> Array:
        """The temperature that the model follows."""
        return self.chamber if self.gyro is None else self.gyro


def thermometers_of(dataset: TemperatureDataset) -> Thermometers:
    """Return the thermometers of a dataset, screened, filled in and held against the set-points."""
    interval_s = dataset.sample_interval_s
    index = grid_index(dataset.time_s, interval_s)
    grid = np.arange(int(index[-1]) + 1)

    def placed(values: Array) -> Array:
        on_grid = np.full(len(grid), np.nan)
        on_grid[index] = values
        return on_grid

    set_point = np.interp(grid, index, dataset.set_point_degC)
    stepped = np.abs(np.diff(set_point, prepend=set_point[0])) > STEPPED_SET_POINT_DEGC
    free: Mask = maximum_filter1d(stepped.astype(np.uint8), SETTLING_ROWS, origin=-9) > 0
    air = _channel("the chamber's thermometer", "the set-point")
    screened, chamber, u_degC = _mended(air, placed(dataset.chamber_degC), free)
    raised = channel_flags([screened]) + _standing(set_point, chamber[screened.good])
    chamber = _filled(chamber, screened.good, set_point)
    chamber_flags = _standing_still(CHAMBER, screened.good[index])
    gyro, gyro_flags = None, list[Flag]()
    if dataset.gyro_degC is not None:
        own = _channel("the gyro's thermometer", "the chamber, behind its lag")
        screened, gyro, more_u = _mended(own, placed(dataset.gyro_degC), free & False)
        u_degC = more_u
        raised += channel_flags([screened])
        drive = set_point if chamber_flags else chamber
        gyro = _followed(gyro, screened, drive, interval_s)
        gyro_flags = _standing_still(GYRO, screened.good[index])
    asked = Temperatures(set_point, chamber, gyro)
    misread, columns = list[Flag](), set[str]()
    if not chamber_flags and not gyro_flags:
        misread, columns = _misread(asked, interval_s)
    if not misread:
        chamber_flags += _far_off(dataset, CHAMBER, chamber, set_point, index)
        if gyro is not None and not gyro_flags:
            gyro_flags = _far_off(dataset, GYRO, gyro, set_point, index)
    followed = CHAMBER if gyro is None else GYRO
    refusals = gyro_flags if gyro is not None else chamber_flags
    if followed in columns:
        refusals += misread
    else:
        raised += misread
    if gyro is not None:
        # The chamber's column serves the lag behind it alone.
        raised += chamber_flags
    good = not chamber_flags and CHAMBER not in columns
    return Thermometers(chamber, gyro, tuple(raised), tuple(refusals), good, u_degC)


def _followed(values: Array, screened: Screened, drive: Array, interval_s: float) -> Array:
    """Return a gyro's temperatures (n,), filled in and smoothed by those of what drives it."""
    blurred = float(np.hypot(screened.noise, screened.step / np.sqrt(12.0)))
    if not screened.good.any() or (blurred <= QUIET_DEGC and screened.good.all()):
        return values
    roughly = _filled(values, screened.good, np.zeros(len(values)))
    lag = chamber_lag(roughly, drive, interval_s, screened.good)
    like = np.zeros(len(values)) if lag is None else lagged(drive, lag.value, interval_s)
    values = _filled(values, screened.good, like)
    if blurred > QUIET_DEGC:
        wide = min(WIDEST, (blurred / QUIET_DEGC) ** 2 * NARROWEST)
        values = like + uniform_filter1d(values - like, int(wide) | 1)
    return values


def _channel(name: str, filled_by: str) -> Channel:
    return Channel(
        name,
        name,
        "degC",
        COLDEST_DEGC,
        HOTTEST_DEGC,
        harmless=HARMLESS_DEGC,
        slow=True,
        then=THEN.format(filled_by),
        when_coarse=COARSE,
        when_stepped=STEPPED,
    )


def _mended(channel: Channel, values: Array, free: Mask) -> tuple[Screened, Array, float]:
    """Return a thermometer screened, its readings without steps, and what is unknown of them."""
    mended = values.copy()
    first = now = screen(channel, mended, free=free)
    steps = 0.0
    for _ in range(STEPS_MENDED):
        if now.jump is None:
            break
        mended[now.jump.row :] -= now.jump.size
        steps = max(steps, abs(now.jump.size))
        now = screen(channel, mended, free=free)
    rounding = now.u_of_step(1.0) if now.coarse else 0.0
    return replace(now, jump=first.jump), mended, float(np.hypot(0.5 * steps, rounding))


def _filled(values: Array, good: Mask, like: Array) -> Array:
    """Return values (n,) that are `like` others, and as far from them as around, where not good."""
    if good.all() or not good.any():
        return values
    rows = np.arange(len(values))
    apart = np.interp(rows, rows[good], (values - like)[good])
    return np.where(good, values, like + apart)


def _standing(set_point: Array, chamber: Array) -> list[Flag]:
    """Return the flag of a set-point that stands while the chamber's temperature moves."""
    moved = float(np.ptp(chamber)) if len(chamber) else 0.0
    if moved < MOVED_DEGC or float(np.ptp(set_point)) >= MIN_RANGE:
        return []
    standing_text = (
        f"The column {SET_POINT} stands at {set_point[0]:.4g} degC while the chamber's temperature "
        f"changes by {moved:.3g} degC: it is not what was commanded. The thermometers are not "
        "checked by it, and the values as published may be off; correct the column."
    )
    return [contradiction(SET_POINT, standing_text, moved_degC=moved)]


def _standing_still(column: str, good: Mask) -> list[Flag]:
    """Return why a thermometer of whose rows too few are `good` is none, or nothing."""
    share = float(np.mean(good))
    if share >= MIN_GOOD:
        return []
    stands_text = (
        f"Of the column {column} {100.0 * (1.0 - share):.0f} % are no readings: the "
        "thermometer stood still, or was not connected. Nothing is reported from it."
    )
    return [contradiction(column, stands_text, part=1.0 - share)]


def _far_off(
    dataset: TemperatureDataset, column: str, values: Array, set_point: Array, index: Index
) -> list[Flag]:
    """Return the flag of a thermometer (n,) that no set-point can have led to, or none."""
    ends = soaks_of(dataset, values[index])
    if not ends or float(np.ptp(set_point)) < MIN_RANGE:
        return []
    asked = np.array([float(np.mean(dataset.set_point_degC[soak.rows])) for soak in ends])
    off = float(np.median(np.array([soak.temperature_degC for soak in ends]) - asked))
    limit = MAX_OFF_DEGC if column == CHAMBER else MAX_WARMER_DEGC
    look = "Nothing is reported from it; look at its unit, and whether the column is another."
    offset = Bounds(column, f"The column {column} less the set-point", -limit, limit, "degC", look)
    name = f"The change of the column {column} over that of the set-point"
    gain = _behind(values, set_point, dataset.sample_interval_s, limit)[1]
    return implausible(off, offset) or implausible(gain, Bounds(column, name, *GAINS, "", look))


@dataclass(frozen=True)
class Temperatures:
    """Set-points and thermometers on the grid of the rows (n,), degC."""

    set_point: Array
    chamber: Array
    gyro: Array | None


def _misread(stated: Temperatures, interval_s: float) -> tuple[list[Flag], set[str]]:
    """Return the flag of temperatures that follow one another only read otherwise, and of which."""
    parts = 1 if stated.gyro is None else 2

    def remainder(read: Temperatures) -> Remainder:
        squares = _behind(read.chamber, read.set_point, interval_s, MAX_OFF_DEGC)[0]
        if read.gyro is not None:
            squares += _behind(read.gyro, read.chamber, interval_s, MAX_WARMER_DEGC)[0]
        count = len(read.chamber)
        return Remainder(count * squares, parts * count * interval_s / SLOW_S)

    left = remainder(stated)
    sound = left.squares <= parts * len(stated.chamber) * FOLLOWS_DEGC**2
    if sound or float(np.ptp(stated.set_point)) < MIN_RANGE:
        return [], set()
    tried = (
        suiting(stated, [kind], remainder, stated=left, better=BETTER)
        for kind in _readings(stated, interval_s)
    )
    best = sorted((suits[0] for suits in tried if suits), key=lambda suit: suit.squares)
    suits = [suit for suit in best if suit.squares <= AS_GOOD**2 * best[0].squares]
    if not suits:
        return [], set()
    follow_text = (
        f"The temperatures follow one another only if {named(suits)}. Nothing is reported from "
        "columns that are not what they are called; correct the table."
    )
    likeliest = suits[0].reading
    flag = contradiction(likeliest.statement, follow_text, **likeliest.details)
    return [flag], {column for suit in suits for column in suit.reading.details["columns"]}


def _readings(stated: Temperatures, interval_s: float) -> Sequence[Sequence[Reading[Temperatures]]]:
    """Return what laboratories mix up: units, the two thermometers, rows."""
    columns = {"set_point": SET_POINT, "chamber": CHAMBER}
    both = []
    if stated.gyro is not None:
        columns["gyro"] = GYRO
        both = [("chamber", "gyro")]
    units = [
        _reading(f"{{}} in {unit}", names, columns, partial(_in_unit, names, *scale))
        for unit, scale in UNITS_OF_TEMPERATURE.items()
        for names in [*((name,) for name in columns), *both]
    ]
    swapped = [_reading("{} exchanged", names, columns, exchanged(*names)) for names in both]
    rows = sorted({round(late_s / interval_s) for late_s in LATE_S} - {0})
    late = [[_late(name, columns, own) for own in rows] for name in columns]
    return units, swapped, *late


def _late(name: str, columns: Mapping[str, str], rows: int) -> Reading[Temperatures]:
    what = f"{{}} {abs(rows)} rows too {'late' if rows > 0 else 'early'}"
    return _reading(what, (name,), columns, shifted((name,), rows))


def _reading(
    what: str, names: Sequence[str], columns: Mapping[str, str], apply: Callable[..., Temperatures]
) -> Reading[Temperatures]:
    own = [columns[name] for name in names]
    subject = " and ".join(own) + (" stand" if len(own) > 1 else " stands")
    return Reading(what.format(subject), apply, own[-1], {"columns": own})


def _in_unit(names: Sequence[str], degrees: float, zero: float, read: Temperatures) -> Temperatures:
    return replace(read, **{name: (getattr(read, name) - zero) / degrees for name in names})


def _behind(values: Array, drive: Array, interval_s: float, limit: float) -> tuple[float, float]:
    """Return the mean square that the best lag behind a drive (n,) leaves, and the gain.

    Beside the lag, `values` (n,) may be off by `limit`.
    """

    def left(log_lag: float) -> Array:
        apart = values - lagged(drive, float(np.exp(log_lag)), interval_s)
        return np.asarray(apart - np.clip(apart.mean(), -limit, limit))

    shortest, longest = SHORTEST_ROWS * interval_s, MAX_PART * interval_s * len(values)
    bounds = (np.log(shortest), np.log(longest))
    best = minimize_scalar(lambda own: float(np.mean(left(own) ** 2)), bounds=bounds)
    behind = lagged(drive, float(np.exp(best.x)), interval_s)
    centred = behind - behind.mean()
    gain = float(centred @ values) / max(float(centred @ centred), 1e-30)
    return float(best.fun), gain


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


def rows_flags(axis: str, rate: Array, setting: Setting, solution: BiasFit) -> list[Flag]:
    """Return the flag of an output (n,) that is not in its rows, or none.

    A lag is no delay: with the temperatures as late as the output the data are likelier by far.
    """
    data = coefficients(rate - rate.mean())
    variance = solution.theta @ noise_variances(len(rate), setting.interval_s)[1:]
    variance = variance + setting.step**2 / 12.0
    order, width, lags_s = solution.order, solution.half_width_degC, np.array(solution.lags_s)
    if setting.lag_prior_s is not None:
        lags_s = np.maximum(lags_s, 0.5 * setting.lag_prior_s)
    tried_s = [solution.lags_s, *(tuple((share * lags_s).tolist()) for share in LAG_SHARES)]

    def left(read: Setting, own_s: Lags) -> float:
        columns = coefficients(read.columns(order, own_s, width))
        residuals = solve(Stretch(data, variance[None], variance, columns), variance).residuals
        known = float(np.sum((np.array(own_s) / read.priors_s) ** 2))
        return float(np.sum(residuals**2 / variance)) + known

    def remainder(read: Setting) -> Remainder:
        return Remainder(min(left(read, own_s) for own_s in tried_s), len(rate) - order)

    late = [
        Reading(
            f"{abs(rows)} rows {'late' if rows > 0 else 'early'}",
            shifted(("temperature",), -rows),
            "rate_deg_per_h",
            {"rows": rows},
        )
        for rows in ROWS_LATE
    ]
    # Neighbours suit nearly as well: the best of them stands for all.
    tried = [(reading, own) for reading in late if (own := reading.apply(setting)) is not None]
    nearest, _ = min(tried, key=lambda pair: remainder(pair[1]).squares)
    stated = remainder(setting)
    better = float(np.sqrt(max(1.0 - SHIFT_SEEN / max(stated.squares, 1.0), 0.0)))
    suits = suiting(setting, [[nearest]], remainder, stated=stated, better=better)
    if not suits:
        return []
    late_text = (
        f"The output of {axis} fits the temperatures far better where it is taken for "
        f"{suits[0].reading.what}: it is not in its rows. Nothing is reported from it; put the "
        "columns into their rows."
    )
    likeliest = suits[0].reading
    return [contradiction(likeliest.statement, late_text, axis, **likeliest.details)]


def no_curve(axis: str, lacking: Sequence[str]) -> Flag:
    """Return the flag of an axis without a solution."""
    sentence = (
        f"There is no curve of {axis}: the temperature hardly moved, too few rows are left, or "
        "a column is not what it is called."
    )
    return not_identifiable(sentence, lacking, axis)


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
        return [no_curve(axis, lacking)]
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
    """Return the flag of a lag that stands on what was stated beforehand, on 0 s always."""
    prior = dataset.sensor_lag_prior_s
    _, u = fit.value_of("lag")
    if dataset.gyro_degC is None or u < 0.7 * prior:
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
