"""All records at once: response, asymmetry, switch-ons, bias, drift, walk and lean of a gyro.

mean_j = K_i W_j + A |W_j| + d_r W_j + b_r + ramp_r t_j + c cos_j + s sin_j + walk_j + noise_j for a
record j of rate i in switch-on r; the d_r add to zero, ramp and walk have zero mean over the
records of a switch-on. The size of the walk is found by restricted maximum likelihood. Where K
drifts, drift_r W_j t_j is beside these, and how the output runs within the records decides it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.reml import Stretch, components_at, fit

from .dataset import Array
from .noise import Within
from .scale_drift import Runs
from .screening import Kept

SAME_RATE = 1e-6
WIDER = 0.7
"""Standard uncertainties by which the walk is taken larger in u: its size is not well known."""
FITS, NEVER = 1e-2, 1e-6
"""Chance of noise leaving as much with a drift alone, and of noise making as much of a drift."""
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


def drift_alone(system: System, walk: float) -> bool:
    """Return whether one scale factor that drifts explains what no steady one without drift does.

    A drift looks like a nonlinearity and an asymmetry together, which have many more terms: where
    it leaves nothing to them, and none of them is as it would be without it, it is the cause.
    """
    rates, switch_ons = len(system.layout.rates), len(system.layout.repeats)
    first = rates + 3 * switch_ons
    weight = 1.0 / np.sqrt(1.0 + walk * system.walk)
    design, data = system.design * weight[:, None], system.data * weight
    steady = np.column_stack((design[:, :rates].sum(axis=1), design[:, rates + 1 :]))
    still = np.column_stack(
        (design[:, :rates].sum(axis=1), design[:, rates + 1 : first - switch_ons], design[:, -2:])
    )
    free, drifting, fixed = (_left(columns, data) for columns in (design, steady, still))
    explained = float(chdtrc(rates, max(drifting - free, 0.0))) > FITS
    return explained and float(chdtrc(switch_ons, max(fixed - drifting, 0.0))) < NEVER


def _left(columns: Array, data: Array) -> float:
    """Return the squares that columns of any size leave of data."""
    width = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(width > 0.0, width, 1.0)
    rest = data - scaled @ np.linalg.lstsq(scaled, data, rcond=DETERMINED)[0]
    return float(rest @ rest)


def fit_records(records: Sequence[Kept], system: System) -> JointFit:
    """Return the joint solution of the records' rows."""
    layout, columns, data, sigma = system.layout, system.columns, system.means, system.sigma
    design, turned = system.design, system.data
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
        stretch = Stretch(turned, parts, rest, reduced)
        components = fit([stretch])
        theta, theta_u = components.theta, components.u
        without = components_at([stretch], np.zeros(1))
        gain = without.restricted_deviance - components.restricted_deviance
    variance = theta @ parts + rest
    weighted = reduced / variance[:, None]
    inverse = np.linalg.inv(reduced.T @ weighted)
    wider = (theta + WIDER * theta_u) @ parts + rest
    covariance = np.linalg.inv(reduced.T @ (reduced / wider[:, None]))
    solved = inverse @ (weighted.T @ turned)
    left = turned - reduced @ solved
    back = basis / width[:, None]
    value = back @ solved
    apart = data - columns @ value
    strayed = 0.0
    if system.drifting:
        first = len(layout.rates) + 3 * len(layout.repeats)
        hours = _since_mean_h(records, layout)[layout.rate_of >= 0]
        rates = value[first + layout.repeat_of[layout.rate_of >= 0]]
        strayed = float(np.sqrt(np.mean((rates * hours) ** 2)))
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
        strayed,
        float(theta_u[0]),
    )


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
