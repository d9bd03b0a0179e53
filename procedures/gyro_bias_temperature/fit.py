"""Bias over temperature of one axis: curve, rate, hysteresis, lag and noise in one solution.

b = B(Te) + s dT/dt + (H/2) m, with Te behind T by a first-order lag and m the place in a play of
half width w on Te. In the basis of cosines the noise (N, B, K, by restricted likelihood) is nearly
independent from one coefficient to the next; the mean, which the basis lacks, is taken apart. The
lag is searched for, and its uncertainty goes through its derivative. Half widths are tried on a
grid and the solutions mixed as likely as each is: where the loop is lost in noise, its width is
unknown, and a single best one would make the loop larger than it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import minimize_scalar

from procedures.estimation.rate_spectrum import FLICKER, coefficients, noise_variances
from procedures.estimation.reml import Components, Stretch, fit, solve

from .dataset import Array
from .thermal import lagged, loop, rate_per_minute

HIGHEST_ORDER = 9
FEWER, MORE = 2, 3
"""Orders below and above the likeliest whose solutions are mixed with its own."""
MIN_SHARE = 1e-3
FIRST_ORDER = 4
NARROW, WIDE, WIDEST, USUAL_DEGC = 0.02, 0.15, 0.4, 8.0
"""Part of the range of temperature that the half width of a loop may be: wider ones look like the
curve. In a small range a usual width of 8 degC, if it is not nearly all of it."""
WIDTHS, NEAR, FINER = 12, 7, 1.3
MAX_ROUNDS, SETTLED = 8, 0.5
MAX_LAG = 5.0
"""The lag, in standard uncertainties of what is known of it beforehand."""
WALK_ALLOWED = 0.7
"""Standard uncertainties by which the random walk may be larger than estimated, for u."""
PASSED = 0.2
"""Part of the range that must be passed both ways before there is a loop to be seen."""
ALONE = 0.02
"""Part of a column that the others must leave for it to count as determined."""
STEP = 0.02
MIN_LAG = 0.01
"""Of an interval: what is known of a lag beforehand where it is stated to be none."""
WALK_MEAN = 1.0 / 3.0
"""Variance of the mean of a random walk from zero, over that of its end."""


StretchAt = Callable[[int, float, float], Stretch]
"""The record by order of the curve, lag in s and half width in degC."""


@dataclass(frozen=True)
class Setting:
    """Temperature (n,) on the grid of the rows, what is known beforehand, and what is asked for."""

    temperature: Array
    interval_s: float
    lag_prior_s: float
    has_loop: bool

    @property
    def domain(self) -> tuple[float, float]:
        """The lowest and highest temperature."""
        return float(self.temperature.min()), float(self.temperature.max())

    def scaled(self, temperature: Array) -> Array:
        """Return temperatures on the curve's domain, -1 to 1."""
        low, high = self.domain
        return np.asarray((2.0 * temperature - low - high) / (high - low))

    def columns(self, order: int, lag_s: float, width: float) -> Array:
        """Return the model's columns (n, p): polynomials 1..order, rate, half the loop."""
        effective = lagged(self.temperature, lag_s, self.interval_s)
        curve = chebyshev.chebvander(self.scaled(effective), order)[:, 1:]
        parts = [curve, rate_per_minute(self.temperature, self.interval_s)[:, None]]
        if self.has_loop:
            parts.append(0.5 * loop(effective, width)[:, None])
        return np.column_stack(parts)


@dataclass(frozen=True)
class BiasFit:
    """The solution of one axis: `sizes` (p,) with `covariance`, in the order of `names`.

    `names`: c0..c<order> of the curve in deg/h, at rest in mid-loop, `s`, `H` where there is a
    loop, and `lag` in s. `theta` are the squares of N (deg/h sqrt(s)), B, K. `alone` says of each
    of s and H whether the record tells it from the rest. `residual` and `fitted` (n,) in deg/h,
    `half_width_degC` are those of the likeliest loop.
    """

    order: int
    names: tuple[str, ...]
    sizes: Array
    covariance: Array
    theta: Array
    alone: dict[str, bool]
    half_width_degC: float
    residual: Array
    fitted: Array

    def place(self, name: str) -> int:
        """Return where a quantity stands."""
        return self.names.index(name)

    def value_of(self, name: str) -> tuple[float, float]:
        """Return a quantity and its standard uncertainty."""
        at = self.place(name)
        return float(self.sizes[at]), float(np.sqrt(self.covariance[at, at]))

    def curve(self) -> Array:
        """Return the curve's Chebyshev coefficients (order + 1,), lowest first."""
        return self.sizes[: self.order + 1].copy()

    def bias_at(self, scaled: float) -> tuple[float, float]:
        """Return the bias at a place of the domain and its standard uncertainty, deg/h."""
        return self._of_curve(self._row(scaled))

    def difference(self, first: float, second: float) -> tuple[float, float]:
        """Return the bias at one place less that at another, and its standard uncertainty."""
        return self._of_curve(self._row(first) - self._row(second))

    def slope_at(self, scaled: float) -> tuple[float, float]:
        """Return the curve's slope a unit of the scaled temperature, and its uncertainty."""
        units = np.eye(self.order + 1)
        slopes = [float(chebyshev.chebval(scaled, chebyshev.chebder(unit))) for unit in units]
        return self._of_curve(np.array(slopes))

    def _row(self, scaled: float) -> Array:
        return np.asarray(chebyshev.chebvander(np.array([scaled]), self.order)[0])

    def _of_curve(self, gradient: Array) -> tuple[float, float]:
        width = self.order + 1
        own = self.covariance[:width, :width]
        return float(gradient @ self.sizes[:width]), float(np.sqrt(gradient @ own @ gradient))


@dataclass(frozen=True)
class Tried:
    """A half width in degC with the likeliest lag in s, and -2 ln of how likely both are."""

    half_width: float
    lag_s: float
    deviance: float


def fit_bias(rate: Array, setting: Setting) -> BiasFit:
    """Return the solution of one axis; `rate` (n,) in deg/h without the earth's, no gap in it."""
    count = len(rate)
    parts = noise_variances(count, setting.interval_s)[1:]
    data = coefficients(rate - rate.mean())
    low, high = setting.domain

    def stretch(order: int, lag_s: float, width: float) -> Stretch:
        columns = coefficients(setting.columns(order, lag_s, width))
        return Stretch(data, parts, np.zeros(count - 1), columns)

    widths = np.array([NARROW * (high - low)])
    if setting.has_loop:
        widest = min(WIDEST * (high - low), max(WIDE * (high - low), USUAL_DEGC))
        widths = np.geomspace(widths[0], widest, WIDTHS)
    lag_s, width = 0.3 * setting.lag_prior_s, 0.08 * (high - low)
    order, best = FIRST_ORDER, fit([stretch(FIRST_ORDER, lag_s, width)])
    for _ in range(MAX_ROUNDS):
        # What a wrong loop or lag leaves is taken for noise: with less noise both are seen better.
        tried = _searched(stretch, setting, best, order, widths)
        likeliest = min(tried, key=lambda own: own.deviance)
        if setting.has_loop:
            near = np.geomspace(likeliest.half_width / FINER, likeliest.half_width * FINER, NEAR)
            tried += _searched(stretch, setting, best, order, near)
            likeliest = min(tried, key=lambda own: own.deviance)
        before = best.deviance
        order, best = _ordered(stretch, best.theta, likeliest.lag_s, likeliest.half_width)
        if before - best.deviance < SETTLED:
            break
    return _mixed(rate, setting, stretch, best, order, tried)


def _searched(
    stretch: StretchAt, setting: Setting, best: Components, order: int, widths: Array
) -> list[Tried]:
    """Return half widths in degC, each with the lag under which the data are likeliest."""
    variance = best.solved[0].variance
    prior_s = max(setting.lag_prior_s, MIN_LAG * setting.interval_s)

    def at(width: float) -> Tried:
        def deviance(share: float) -> float:
            return solve(stretch(order, share * prior_s, width), variance).deviance + share**2

        bounds = (0.0, MAX_LAG)
        best_lag = minimize_scalar(deviance, bounds=bounds, options={"xatol": 0.02})
        return Tried(width, float(best_lag.x) * prior_s, float(best_lag.fun))

    return [at(float(width)) for width in widths]


def _ordered(
    stretch: StretchAt, theta: Array, lag_s: float, width: float
) -> tuple[int, Components]:
    """Return the order of the curve by the Bayesian information criterion, with its solution."""
    tried = {
        order: fit([stretch(order, lag_s, width)], theta) for order in range(1, HIGHEST_ORDER + 1)
    }
    rows = len(tried[1].solved[0].residuals)
    order = min(tried, key=lambda order: tried[order].deviance + order * np.log(rows))
    return order, tried[order]


@dataclass(frozen=True)
class Candidate:
    """A solution with one order and half width: its quantities, named for the highest order."""

    sizes: Array
    covariance: Array
    weighted: Array
    residual: Array


def _mixed(
    rate: Array,
    setting: Setting,
    stretch: StretchAt,
    best: Components,
    order: int,
    widths: Sequence[Tried],
) -> BiasFit:
    """Return the solutions of neighbouring orders and all half widths, each as likely as it is."""
    widths = sorted(widths, key=lambda tried: tried.half_width)
    # Beforehand, each ratio of widths is as likely as the next.
    ratios = np.log([tried.half_width for tried in widths])
    share = np.gradient(ratios) if len(widths) > 1 else np.ones(1)
    orders = range(max(1, order - FEWER), min(HIGHEST_ORDER, order + MORE) + 1)
    pairs = [(own, tried) for own in orders for tried in widths]
    variance, penalty = best.solved[0].variance, np.log(len(rate) - 1)
    prior_s = max(setting.lag_prior_s, MIN_LAG * setting.interval_s)
    deviance = np.array(
        [
            solve(stretch(own, tried.lag_s, tried.half_width), variance).deviance
            + (tried.lag_s / prior_s) ** 2
            + own * penalty
            for own, tried in pairs
        ]
    )
    weight = np.tile(share, len(orders)) * np.exp(-0.5 * (deviance - deviance.min()))
    weight[weight < MIN_SHARE * weight.max()] = 0.0
    weight /= weight.sum()
    used = [n for n, own in enumerate(weight) if own > 0.0]
    top = max(pairs[n][0] for n in used)
    more = best.theta.copy()
    more[-1] += WALK_ALLOWED * best.u[-1]
    candidates = [_candidate(rate, setting, stretch, (variance, more), pairs[n], top) for n in used]
    shares = weight[used]
    sizes = shares @ np.array([c.sizes for c in candidates])
    apart = np.array([c.sizes for c in candidates]) - sizes
    covariance = np.einsum("w,wi,wj->ij", shares, apart, apart)
    covariance += np.einsum("w,wij->ij", shares, np.array([c.covariance for c in candidates]))
    likeliest = int(np.argmin(deviance[used]))
    chosen, (own, tried) = candidates[likeliest], pairs[used[likeliest]]
    names = [f"c{k}" for k in range(top + 1)] + ["s"] + ["H"] * setting.has_loop + ["lag"]
    seen = {"s": own} | ({"H": own + 1} if setting.has_loop else {})
    return BiasFit(
        top,
        tuple(names),
        sizes,
        covariance,
        best.theta,
        {name: _left(chosen.weighted, at) > ALONE for name, at in seen.items()},
        tried.half_width,
        chosen.residual,
        rate - chosen.residual,
    )


def _candidate(
    rate: Array,
    setting: Setting,
    stretch: StretchAt,
    variances: tuple[Array, Array],
    pair: tuple[int, Tried],
    top: int,
) -> Candidate:
    """Return one solution; `variances` are those of the data, and theta that u goes by."""
    (order, tried), (variance, theta) = pair, variances
    own = stretch(order, tried.lag_s, tried.half_width)
    sizes = solve(own, variance).sizes
    columns = setting.columns(order, tried.lag_s, tried.half_width)
    nudge_s = STEP * max(setting.lag_prior_s, tried.lag_s, setting.interval_s)
    later = setting.columns(order, tried.lag_s + nudge_s, tried.half_width) @ sizes
    whole = np.column_stack([columns, (later - columns @ sizes) / nudge_s])
    weighted = coefficients(whole) / np.sqrt(own.variance(theta))[:, None]
    normal = weighted.T @ weighted
    normal[-1, -1] += 1.0 / max(setting.lag_prior_s, MIN_LAG * setting.interval_s) ** 2
    centre = whole.mean(axis=0)
    # The constant is what the mean leaves: it moves with every column's mean.
    gain = np.vstack([-centre, np.eye(len(centre))])
    covariance = gain @ _inverse(normal) @ gain.T
    length_s = len(rate) * setting.interval_s
    covariance[0, 0] += float(theta @ [1.0 / length_s, FLICKER, WALK_MEAN * length_s])
    constant = float(rate.mean()) - float(centre[:-1] @ sizes)
    values = np.r_[constant, sizes, tried.lag_s]
    place = np.r_[: order + 1, top + 1 : top + 1 + len(values) - order - 1]
    padded, wide = np.zeros(len(values) + top - order), np.zeros((len(values) + top - order,) * 2)
    padded[place] = values
    wide[np.ix_(place, place)] = covariance
    return Candidate(padded, wide, weighted, rate - constant - columns @ sizes)


def _inverse(normal: Array) -> Array:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True)
    return np.asarray(scaled * np.outer(scale, scale))


def _left(weighted: Array, at: int) -> float:
    """Return which part of a column the others but the last, the lag, leave of it."""
    others = np.delete(weighted[:, :-1], at, axis=1)
    own = weighted[:, at]
    rest = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
    return float(np.linalg.norm(rest) / max(float(np.linalg.norm(own)), 1e-300))
