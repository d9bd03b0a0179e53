"""All records at once: response, asymmetry, switch-ons, bias, drift, walk and lean of a gyro.

mean_j = K_i W_j + A |W_j| + d_r W_j + b_r + ramp_r t_j + c cos_j + s sin_j + walk_j + noise_j for a
record j of rate i in switch-on r; the d_r add to zero, ramp and walk have zero mean over the
records of a switch-on. The size of the walk is found by restricted maximum likelihood. Where K
drifts, drift_r W_j t_j is beside these, and how the output runs within the records decides it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation import reml
from procedures.estimation.alternatives import RIVAL
from procedures.estimation.measured import Measured, root

from .dataset import PPM, Array
from .screening import Kept, Runs, Within

SAME_RATE = 1e-6
WIDER = 0.7
"""Standard uncertainties by which the walk is taken larger in u: its size is not well known."""
MAX_DEGREE = 2
"""Of the curves in the rate that a scale factor may have beside one that has no form."""
LIKELIER = 6.0
"""Of the information criterion: a drift is solved for from twenty times as likely on."""
DETERMINED = 1e-5
"""Singular values of scaled columns below this part of the largest are none."""


@dataclass(frozen=True)
class Layout:
    """What the records are of: `rates` (m,) in deg/h as turned, `repeats` (n,), and their places.

    `rate_of` (r,) is -1 where the table stood.
    """

    rates: Array
    nominal: Array
    repeats: tuple[int, ...]
    rate_of: Array
    repeat_of: Array


@dataclass(frozen=True)
class JointFit:
    """The solution: `value` and `covariance` of all columns, in deg/h and ratios.

    Columns stand as K_i (m), A, contrasts of d (n - 1), b (n), ramps in deg/h per h (n), drifts of
    K per h (n) where `drifting`, c, s. `strayed` is by how much, rms, K then was another one than
    at the mean time.
    `seen` (p, q) spans what the data determine of columns over their `width` (p,). `walk` is the
    square of the walk's size in (deg/h)²/h, `walk_u` its uncertainty, `walk_gain` how much it
    lowers -2 ln L; `chi_square` is that of the records about the solution, with `freedom`.
    """

    layout: Layout
    value: Array
    covariance: Array
    seen: Array
    width: Array
    walk: float
    walk_gain: float
    chi_square: float
    freedom: int
    residual: Array
    residual_u: Array
    drifting: bool
    strayed: float
    walk_u: float

    def determined(self, gradient: Array) -> bool:
        """Return whether the data determine a combination of the columns."""
        scaled = gradient / self.width
        outside = scaled - self.seen @ (self.seen.T @ scaled)
        return bool(np.linalg.norm(outside) <= DETERMINED * np.linalg.norm(scaled))

    @property
    def rates(self) -> int:
        """How many rates there are."""
        return len(self.layout.rates)

    @property
    def switch_ons(self) -> int:
        """How many switch-ons there are."""
        return len(self.layout.repeats)

    @property
    def asymmetry(self) -> int:
        """The place of A."""
        return self.rates

    def scale_factors(self) -> Array:
        """Return the columns' part in each K_i, (m, p)."""
        return np.eye(self.rates, len(self.value))

    def departures(self) -> Array:
        """Return the columns' part in each d_r, (n, p)."""
        parts = np.zeros((self.switch_ons, len(self.value)))
        first = self.rates + 1
        parts[:, first : first + self.switch_ons - 1] = contrasts(self.switch_ons)
        return parts

    def biases(self) -> Array:
        """Return the columns' part in each b_r, (n, p)."""
        return self._block(self.rates + self.switch_ons)

    def ramps(self) -> Array:
        """Return the columns' part in each ramp, (n, p)."""
        return self._block(self.rates + 2 * self.switch_ons)

    def drifts(self) -> Array:
        """Return the columns' part in each drift of K, (n, p); none of a K that does not drift."""
        block = self._block(self.rates + 3 * self.switch_ons)
        return block if self.drifting else block[:0]

    def _block(self, first: int) -> Array:
        return np.eye(len(self.value))[first : first + self.switch_ons]


def contrasts(count: int) -> Array:
    """Return an orthonormal basis (n, n - 1) of numbers that add to zero."""
    full, _ = np.linalg.qr(np.column_stack((np.ones(count), np.eye(count)[:, : count - 1])))
    return np.asarray(full[:, 1:])


def layout_of(records: Sequence[Kept]) -> Layout:
    """Return which record is of which rate and switch-on."""
    nominal = np.array([abs(kept.record.commanded_deg_per_s) for kept in records])
    size = np.rint(nominal / SAME_RATE) * SAME_RATE
    rates = np.unique(size[size > 0.0])
    rate_of = np.where(size > 0.0, np.searchsorted(rates, size), -1)
    table = np.array([abs(kept.table) for kept in records])
    turned = np.array([table[rate_of == i].mean() for i in range(len(rates))])
    repeats = tuple(dict.fromkeys(kept.record.repeat for kept in records))
    repeat_of = np.array([repeats.index(kept.record.repeat) for kept in records])
    return Layout(turned, rates, repeats, rate_of, repeat_of)


@dataclass(frozen=True)
class System:
    """All rows over their noise: `design` (k, p), `data` (k,), `walk` (k,) the variance that a walk
    of 1 (deg/h)²/h adds. `columns` (r, p) and `means` (r,) are those of the records as they are."""

    layout: Layout
    columns: Array
    means: Array
    sigma: Array
    design: Array
    data: Array
    walk: Array
    drifting: bool


def system_of(
    records: Sequence[Kept], within: Within, own_variance: Array, scale: float, runs: Runs | None
) -> System:
    """Return the rows of all records; `own_variance` (r,) in (deg/h)² is what else each mean has.

    With `runs` the scale factor may drift.
    """
    layout = layout_of(records)
    columns = _columns(records, layout, drifting=runs is not None)
    data = np.array([kept.mean for kept in records])
    table = np.array([kept.table for kept in records])
    data = data - np.where(layout.rate_of < 0, scale * table, 0.0)  # a table that hardly moves
    lengths_s = np.array([kept.length_s for kept in records])
    sigma = np.sqrt(within.variance(lengths_s) + own_variance)
    walk = _walk_covariance(records, layout) / np.outer(sigma, sigma)
    size, shape = np.linalg.eigh(walk)
    # The walk and the noise are independent along these directions, so that all is diagonal.
    design = shape.T @ (columns / sigma[:, None])
    turned = shape.T @ (data / sigma)
    known = np.linalg.cholesky(within.normal)
    extra = np.zeros((2, columns.shape[1]))
    extra[:, -2:] = known.T
    design = np.vstack((design, extra))
    turned = np.append(turned, np.linalg.solve(known, within.right))
    if runs is not None:
        design = np.vstack((design, _run_columns(records, layout, columns.shape[1], runs)))
        turned = np.append(turned, runs.slope / runs.u)
    parts = np.zeros(len(turned))
    parts[: len(size)] = np.maximum(size, 0.0)
    return System(layout, columns, data, sigma, design, turned, parts, runs is not None)


def solution_of(
    records: Sequence[Kept], within: Within, own_variance: Array, scale: float, runs: Runs
) -> JointFit:
    """Return the solution of the records, with a drift of K where that is likelier."""
    steady = fit_records(records, system_of(records, within, own_variance, scale, None))
    if steady.rates < 2:
        return steady
    drifting = system_of(records, within, own_variance, scale, runs)
    return mixed(records, drifting, steady) or steady


def forms_of(layout: Layout, width: int) -> list[Array]:
    """Return the terms (width, q) of K without a form in the rate, and as polynomials of it."""
    rates = len(layout.rates)
    degrees = range(min(MAX_DEGREE, rates - 2) + 1)
    part = layout.rates / layout.rates.max()
    forms = [np.eye(rates), *(np.vander(part, degree + 1, increasing=True) for degree in degrees)]
    return [np.vstack((form, np.zeros((width - rates, form.shape[1])))) for form in forms]


def mixed(records: Sequence[Kept], system: System, steady: JointFit) -> JointFit | None:
    """Return the solution with a drift of K where that is likelier; None where a steady one is.

    From record to record a drift looks like a nonlinearity and an asymmetry together, which have
    many more terms than a drift beside a smooth curve. What the likely models differ by is in the
    covariance. The bias walks as in the `steady` solution.
    """
    rates, switch_ons = len(system.layout.rates), len(system.layout.repeats)
    first, width = rates + 3 * switch_ons, system.design.shape[1]
    columns = np.eye(width)
    others = np.column_stack((columns[:, rates:first], columns[:, first + switch_ons :]))
    each = columns[:, first : first + switch_ons]
    drifts = [each[:, :0], each, *([each.sum(axis=1)[:, None]] if switch_ons > 1 else [])]
    forms = forms_of(system.layout, width)
    models = [[np.column_stack((form, others, d)) for form in forms] for d in drifts]
    weight = 1.0 / np.sqrt(1.0 + steady.walk * system.walk)
    design, data = system.design * weight[:, None], system.data * weight
    cost = np.log(len(data))
    values = np.array(
        [[_left(design @ terms, data) + cost * terms.shape[1] for terms in row] for row in models]
    )
    if values[1:].min() > values[0].min() - LIKELIER:
        return None
    likely = np.argwhere(values < values.min() + RIVAL)
    parts = np.array([np.exp(0.5 * (values.min() - values[d, f])) for d, f in likely])
    parts /= parts.sum()
    fits = [fit_records(records, system, models[d][f]) for d, f in likely]
    value = np.asarray(sum(p * fit.value for p, fit in zip(parts, fits, strict=True)))
    moves = [fit.value - value for fit in fits]
    covariance = sum(
        part * (fit.covariance + np.outer(move, move))
        for part, fit, move in zip(parts, fits, moves, strict=True)
    )
    free, best = fit_records(records, system), fits[int(np.argmax(parts))]
    return replace(
        best,
        value=value,
        covariance=np.asarray(covariance),
        seen=free.seen,
        width=free.width,
        strayed=_strayed(records, system, value),
    )


def _left(columns: Array, data: Array) -> float:
    """Return the squares that columns of any size leave of data."""
    width = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(width > 0.0, width, 1.0)
    rest = data - scaled @ np.linalg.lstsq(scaled, data, rcond=DETERMINED)[0]
    return float(rest @ rest)


def fit_records(records: Sequence[Kept], system: System, terms: Array | None = None) -> JointFit:
    """Return the solution of the records' rows, of all columns or of `terms` (p, q) in them."""
    layout, columns, data, sigma = system.layout, system.columns, system.means, system.sigma
    terms = np.eye(columns.shape[1]) if terms is None else terms
    design, turned = system.design @ terms, system.data
    width = np.linalg.norm(design, axis=0)
    width = np.where(width > 0.0, width, 1.0)
    _, values, rows = np.linalg.svd(design / width, full_matrices=False)
    rank = int(np.sum(values > DETERMINED * values[0]))
    basis = rows[:rank].T
    reduced = design / width @ basis
    parts = system.walk[None]
    rest = np.ones(len(turned))
    freedom = len(turned) - rank
    theta = theta_u = np.zeros(1)
    gain = 0.0
    if freedom > 0 and parts.max() > 0.0:
        stretch = reml.Stretch(turned, parts, rest, reduced)
        components = reml.fit([stretch])
        theta, theta_u = components.theta, components.u
        without = reml.components_at([stretch], np.zeros(1))
        gain = without.restricted_deviance - components.restricted_deviance
    variance = theta @ parts + rest
    weighted = reduced / variance[:, None]
    inverse = np.linalg.inv(reduced.T @ weighted)
    wider = (theta + WIDER * theta_u) @ parts + rest
    covariance = np.linalg.inv(reduced.T @ (reduced / wider[:, None]))
    solved = inverse @ (weighted.T @ turned)
    left = turned - reduced @ solved
    back = terms @ (basis / width[:, None])
    value = back @ solved
    apart = data - columns @ value
    return JointFit(
        layout,
        value,
        back @ covariance @ back.T,
        basis,
        width,
        float(theta[0]),
        gain,
        float(left**2 @ (1.0 / variance)),
        freedom,
        apart,
        sigma,
        system.drifting,
        _strayed(records, system, value),
        float(theta_u[0]),
    )


def _strayed(records: Sequence[Kept], system: System, value: Array) -> float:
    """Return by how much, rms over the turning records, K was another one than at the mean time."""
    layout = system.layout
    if not system.drifting:
        return 0.0
    turning = layout.rate_of >= 0
    first = len(layout.rates) + 3 * len(layout.repeats)
    drifts = value[first + layout.repeat_of[turning]]
    return float(np.sqrt(np.mean((drifts * _since_mean_h(records, layout)[turning]) ** 2)))


def _columns(records: Sequence[Kept], layout: Layout, *, drifting: bool) -> Array:
    count = len(records)
    table = np.where(layout.rate_of < 0, 0.0, [kept.table for kept in records])
    own_rate = np.zeros((count, len(layout.rates)))
    turning = np.flatnonzero(layout.rate_of >= 0)
    own_rate[turning, layout.rate_of[turning]] = table[turning]
    own_repeat = np.eye(len(layout.repeats))[layout.repeat_of]
    departures = table[:, None] * (own_repeat @ contrasts(len(layout.repeats)))
    since_h = _since_mean_h(records, layout)[:, None]
    ramps = own_repeat * since_h
    drifts = own_repeat * since_h * table[:, None] if drifting else np.empty((count, 0))
    waves = np.array([kept.waves.mean(axis=0) for kept in records])
    return np.column_stack((own_rate, np.abs(table), departures, own_repeat, ramps, drifts, waves))


def _run_columns(records: Sequence[Kept], layout: Layout, width: int, runs: Runs) -> Array:
    """Return what a drift of K makes of how the output runs within each record, over its u."""
    rows = np.zeros((len(records), width))
    first = len(layout.rates) + 3 * len(layout.repeats)
    rows[np.arange(len(records)), first + layout.repeat_of] = runs.rate / runs.u
    return rows


def _since_mean_h(records: Sequence[Kept], layout: Layout) -> Array:
    """Return the records' middles from the mean of those of their switch-on, in h."""
    own_repeat = np.eye(len(layout.repeats))[layout.repeat_of]
    time_h = _middles_h(records)
    mean_h = own_repeat.T @ time_h / own_repeat.sum(axis=0)
    return np.asarray(time_h - mean_h[layout.repeat_of])


def _walk_covariance(records: Sequence[Kept], layout: Layout) -> Array:
    """Return the covariance (r, r) of the records' means for a walk of 1 (deg/h)²/h.

    Its mean over the records of a switch-on is zero.
    """
    time_h = _middles_h(records)
    length_h = np.array([kept.length_s for kept in records]) / SECONDS_PER_HOUR
    same = np.equal.outer(layout.repeat_of, layout.repeat_of)
    covariance = np.where(same, np.minimum.outer(time_h, time_h), 0.0)
    covariance[np.diag_indices_from(covariance)] -= length_h / 6.0
    centred = np.eye(len(records)) - same / same.sum(axis=1)[:, None]
    return np.asarray(centred @ covariance @ centred.T)


def _middles_h(records: Sequence[Kept]) -> Array:
    return (
        np.array([float(kept.record.time_s[kept.good].mean()) for kept in records])
        / SECONDS_PER_HOUR
    )


AGREE = 1e-3
"""By chance, rates of one scale factor agree worse than this seldom."""
DRAWS = 1000
NOTHING = 1e-9


@dataclass(frozen=True)
class Results:
    """What a gyro on a rate table gives, None where the data do not determine it.

    Ratios: `scale_factor`, `factors` K_i (m,) at `nominal` rates in deg/s with u (m,), NaN where
    not determined. In ppm: `nonlinearity` and `of_full_scale`, `asymmetry`, `repeatability`. `bias`
    in deg/h, the earth's rate in it. `agree` is whether the K_i differ by noise alone; `curve`
    (2, m) the distance from the line in both senses, over full scale, in ppm.
    """

    scale_factor: Measured | None
    nonlinearity: Measured | None
    of_full_scale: Measured | None
    asymmetry: Measured | None
    repeatability: Measured | None
    bias: Measured | None
    nominal: Array
    factors: Array
    factors_u: Array
    agree: bool
    curve: Array


def results_of(fit: JointFit, range_deg_per_s: float | None = None) -> Results:
    """Return the results of a solution; full scale is the largest input unless it is stated."""
    ratios, width = fit.scale_factors(), len(fit.value)
    rates = fit.layout.rates
    line = (rates**2 @ ratios) / float(rates @ rates) if len(rates) else np.zeros(width)
    has_line = bool(len(rates)) and fit.determined(line)
    scale = float(line @ fit.value)
    seen = np.array([fit.determined(ratio) for ratio in ratios], dtype=bool)
    factors = np.where(seen, ratios @ fit.value, np.nan)
    factors_u = np.where(seen, _u(fit, ratios), np.nan)
    spread = _spread(fit) if has_line else None
    even = np.zeros(width)
    even[fit.asymmetry] = 2.0 * PPM
    has_even = has_line and fit.determined(even)
    relative = (ratios - line) * PPM / scale if has_line else ratios
    nonlinearity = of_full_scale = None
    agree, curve = True, np.full((2, len(rates)), np.nan)
    if has_line and len(rates) > 1 and bool(seen.all()):
        nonlinearity, agree = _largest(fit, relative)
        if has_even:
            even_line = np.outer(rates - rates.mean(), even / 2.0) / scale
            full = rates.max()
            if range_deg_per_s is not None:
                full = range_deg_per_s * SECONDS_PER_HOUR
            both = [(rates[:, None] * relative + s * even_line) / full for s in (1.0, -1.0)]
            of_full_scale, _ = _largest(fit, np.vstack(both))
            curve = np.array([both[0] @ fit.value, -(both[1] @ fit.value)])
    counts = np.bincount(fit.layout.repeat_of, minlength=fit.switch_ons)
    mean = counts / counts.sum() @ fit.biases()
    return Results(
        _scale_factor(fit, line, spread) if has_line else None,
        nonlinearity,
        of_full_scale,
        _measured(fit, even / scale) if has_even else None,
        _repeatability(spread, scale) if spread else None,
        _measured(fit, mean) if fit.determined(mean) else None,
        fit.layout.nominal,
        factors,
        factors_u,
        agree,
        curve,
    )


def _u(fit: JointFit, gradients: Array) -> Array:
    squares = np.einsum("ij,jk,ik->i", gradients, fit.covariance, gradients)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def _measured(fit: JointFit, gradient: Array) -> Measured:
    return Measured(float(gradient @ fit.value), float(_u(fit, gradient[None])[0]))


def _largest(fit: JointFit, gradients: Array) -> tuple[Measured, bool]:
    """Return the largest magnitude of several combinations, and whether they are all noise.

    By chi-square. The largest of noise is no normal number about zero: u is then its root mean
    square, so that the interval holds zero. Otherwise u is that of the largest one.
    """
    values, covariance = gradients @ fit.value, gradients @ fit.covariance @ gradients.T
    size, shape = np.linalg.eigh(covariance)
    there = size > NOTHING * size.max()
    square = float(np.sum((shape.T @ values)[there] ** 2 / size[there]))
    worst = int(np.argmax(np.abs(values)))
    agree = square <= float(chdtri(int(there.sum()), AGREE))
    u = float(np.sqrt(covariance[worst, worst]))
    if agree:
        noise = np.random.default_rng(0).standard_normal((DRAWS, int(there.sum())))
        drawn = noise @ (shape[:, there] * np.sqrt(size[there])).T
        u = float(np.sqrt(np.mean(np.max(np.abs(drawn), axis=1) ** 2)))
    return Measured(abs(float(values[worst])), u), agree


@dataclass(frozen=True)
class _Spread:
    """Variance of these switch-ons' scale factors, noise in it and taken off, and its u."""

    square: float
    own: float
    u: float
    count: int


def _spread(fit: JointFit) -> _Spread | None:
    parts = fit.departures()
    if fit.switch_ons < 2 or not all(fit.determined(part) for part in parts):
        return None
    value = parts @ fit.value
    noise = parts @ fit.covariance @ parts.T
    freedom = fit.switch_ons - 1
    own = float(np.trace(noise)) / freedom
    away = 2.0 * value / freedom
    u = np.sqrt(float(away @ noise @ away) + 2.0 * float(np.sum(noise * noise)) / freedom**2)
    return _Spread(float(value @ value) / freedom, own, float(u), fit.switch_ons)


def _repeatability(spread: _Spread, scale: float) -> Measured:
    factor = (PPM / scale) ** 2
    return root((spread.square - spread.own) * factor, spread.u * factor)


def _scale_factor(fit: JointFit, line: Array, spread: _Spread | None) -> Measured:
    """Return K; where it differs between switch-ons or drifts, that is in its u.

    Of n switch-ons the spread has n - 1 degrees of freedom, also where it happens to be small: what
    it is taken off from is as uncertain as the whole of it (Welch and Satterthwaite).
    """
    measured = _measured(fit, line)
    variance = measured.u**2 + fit.strayed**2
    if spread is None:
        return Measured(measured.value, float(np.sqrt(variance)))
    scattered = max(spread.square - spread.own, 0.0) / spread.count
    variance += scattered
    freedom = None
    if spread.square > 0.0:
        freedom = (spread.count - 1) * (variance * spread.count / spread.square) ** 2
    return Measured(measured.value, float(np.sqrt(variance)), freedom)
