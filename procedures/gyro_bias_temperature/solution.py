"""Bias over temperature of one axis: curve, rate, hysteresis, lag and noise in one solution.

b = B(Te) + s dT/dt + (H/2) m, with Te behind T by a first-order lag and m the place in a play of
half width w on Te. Of a gyro without a thermometer T is the chamber's temperature behind a lag that
nothing is known of beforehand; of the lag from there to Te only that it is short. In the basis of
cosines the noise (N, B, K, by restricted likelihood) is nearly independent from one coefficient to
the next; the mean, which the basis lacks, is taken apart. The lag is searched for, and its
uncertainty goes through its derivative. Half widths are tried on a grid and the solutions mixed as
likely as each is: where the loop is lost in noise, its width is unknown, and a single best one
would make the loop larger than it is. So are the orders of the curve and the sizes of slow noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import minimize_scalar

from procedures.estimation.rate_spectrum import FLICKER, coefficients, noise_variances
from procedures.estimation.reml import RIDGE, SMALLEST, Components, Stretch, fit, solve

from .dataset import Array, Index
from .model import INNER_PRIOR_S, Lags, Setting

HIGHEST_ORDER = 9
FEWER, MORE = 2, 3
"""Orders below and above the likeliest whose solutions are mixed with its own."""
PER_ORDER = 5.0
"""What one more order must gain in -2 ln of the likelihood to be the middle one of those mixed."""
HIGHER = 0.3, 0.1
"""Of the curve's size: standard deviations beforehand of its coefficients beyond the slope, each as
likely. With a large one alone, small terms were taken for none and were not in u."""
NONE = 1e-6
"""Of the curve's size: a coefficient that is none."""
MIN_SHARE = 1e-3
FIRST_ORDER = 4
NARROW, WIDE, WIDEST, USUAL_DEGC = 0.02, 0.15, 0.4, 8.0
"""Part of the range of temperature that the half width of a loop may be: wider ones look like the
curve. In a small range a usual width of 8 degC, if it is not nearly all of it."""
WIDTHS, NEAR, FINER = 12, 7, 1.3
MAX_ROUNDS, SETTLED = 8, 0.5
MAX_LAG = 5.0
"""The lag, in standard uncertainties of what is known of it beforehand."""
NOISE_REACH, NOISES = 6.0, 6
"""How far beyond the likeliest squares, in standard uncertainties, B and K are tried; how many. A
square that few waves show has a long tail: up to 3, u was 10 % too small."""
NOISES_DENSER = 1.5
"""Power by which those near none are denser."""
PASSED = 0.2
"""Part of the range that must be passed both ways before there is a loop to be seen."""
ALONE = 0.02
"""Part of a column that the others must leave for it to count as determined."""
STEP = 0.02
CHAMBER_LAGS_S = 300.0, 4500.0
"""Of a gyro behind the air of its chamber, the lag within it included."""
STARTS = 9
"""Such lags with which the search begins."""
MAX_INNER = 0.5
"""Of the whole lag."""
MAX_U_OF_LAG = 0.25
"""Of a lag: beyond it, nothing of what it leaves is known either."""
WALK_MEAN = 1.0 / 3.0
"""Variance of the mean of a random walk from zero, over that of its end."""


StretchAt = Callable[[int, Lags, float], Stretch]
"""The record by order of the curve, lags in s and half width in degC."""


@dataclass(frozen=True)
class BiasFit:
    """The solution of one axis: `sizes` (p,) with `covariance`, in the order of `names`.

    `names`: c0..c<order> of the curve in deg/h, at rest in mid-loop, `s`, `H` where there is a
    loop, `lag` in s, and `inner` behind a chamber. `theta` are the squares of N (deg/h sqrt(s)), B,
    K. `alone` says of each of s and H whether the record tells it from the rest. `residual` and
    `fitted` (n,) in deg/h, `half_width_degC` and `lags_s` are those of the likeliest loop.
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
    lags_s: Lags

    @property
    def lag_seen(self) -> bool:
        """Whether the data show the lag, where nothing else does."""
        lag_s, u = self.value_of("lag")
        low, high = CHAMBER_LAGS_S
        inside = 1.05 * low < lag_s < high / 1.05
        return len(self.lags_s) == 1 or (inside and u < MAX_U_OF_LAG * lag_s)

    def place(self, name: str) -> int:
        """Return where a quantity stands."""
        return self.names.index(name)

    def value_of(self, name: str) -> tuple[float, float]:
        """Return a quantity and its standard uncertainty."""
        at = self.place(name)
        return float(self.sizes[at]), float(np.sqrt(max(self.covariance[at, at], 0.0)))

    def curve(self) -> Array:
        """Return the curve's Chebyshev coefficients (order + 1,), lowest first."""
        return self.sizes[: self.order + 1].copy()

    def bias_at(self, scaled: float) -> tuple[float, float]:
        """Return the bias at a place of the domain and its standard uncertainty, deg/h."""
        return self._of_curve(self.rows(np.array([scaled]))[0])

    def slope_rows(self, scaled: Array) -> Array:
        """Return what the slope at places (n,) is of each coefficient (n, order + 1).

        The slope is one a unit of the scaled temperature.
        """
        slopes = chebyshev.chebder(np.eye(self.order + 1))
        return np.asarray(chebyshev.chebval(scaled, slopes).T)

    def rows(self, scaled: Array) -> Array:
        """Return what the bias at places (n,) is of each coefficient (n, order + 1)."""
        return np.asarray(chebyshev.chebvander(scaled, self.order))

    def _of_curve(self, gradient: Array) -> tuple[float, float]:
        width = self.order + 1
        own = self.covariance[:width, :width]
        variance = max(float(gradient @ own @ gradient), 0.0)
        return float(gradient @ self.sizes[:width]), float(np.sqrt(variance))


@dataclass(frozen=True)
class Tried:
    """A half width in degC with the likeliest lags in s, and -2 ln of how likely all are."""

    half_width: float
    lags_s: Lags
    deviance: float


def fit_bias(rate: Array, setting: Setting) -> BiasFit:
    """Return the solution of one axis; `rate` (n,) in deg/h without the earth's, no gap in it."""
    count = len(rate)
    parts = noise_variances(count, setting.interval_s)[1:]
    data = coefficients(rate - rate.mean())
    low, high = setting.domain

    # The rounding of an output is white, and noise is never below it.
    rest = np.full(count - 1, setting.step**2 / 12.0)

    def stretch(order: int, lags_s: Lags, width: float) -> Stretch:
        return Stretch(data, parts, rest, coefficients(setting.columns(order, lags_s, width)))

    widths = np.array([NARROW * (high - low)])
    if setting.has_loop:
        widest = min(WIDEST * (high - low), max(WIDE * (high - low), USUAL_DEGC))
        widths = np.geomspace(widths[0], widest, WIDTHS)
    width = 0.08 * (high - low)
    if setting.lag_prior_s is None:
        whole_s = np.geomspace(*CHAMBER_LAGS_S, STARTS).tolist()
        starts: list[Lags] = [(lag_s, 0.3 * INNER_PRIOR_S) for lag_s in whole_s]
    else:
        starts = [(0.3 * setting.lag_prior_s,)]
    begun = [(fit([stretch(FIRST_ORDER, start, width)]), start) for start in starts]
    best, lags_s = min(begun, key=lambda pair: pair[0].deviance)
    order = FIRST_ORDER
    for _ in range(MAX_ROUNDS):
        # What a wrong loop or lag leaves is taken for noise: with less noise both are seen better.
        tried = _searched(stretch, setting, best, (order, lags_s), widths)
        likeliest = min(tried, key=lambda own: own.deviance)
        if setting.has_loop:
            near = np.geomspace(likeliest.half_width / FINER, likeliest.half_width * FINER, NEAR)
            tried += _searched(stretch, setting, best, (order, lags_s), near)
            likeliest = min(tried, key=lambda own: own.deviance)
        before = best.deviance
        lags_s = _within(stretch, best, order, likeliest)
        order, best = _ordered(stretch, best.theta, lags_s, likeliest.half_width)
        if before - best.deviance < SETTLED:
            break
    return _mixed(rate, setting, stretch, best, order, tried)


def _searched(
    stretch: StretchAt,
    setting: Setting,
    best: Components,
    from_here: tuple[int, Lags],
    widths: Array,
) -> list[Tried]:
    """Return half widths in degC, each with the whole lag under which the data are likeliest."""
    variance = best.solved[0].variance
    order, (lag_s, *inner) = from_here
    known = setting.lag_prior_s is not None
    unit_s = float(setting.priors_s[0]) if known else lag_s
    bounds = (0.0, MAX_LAG) if known else (CHAMBER_LAGS_S[0] / unit_s, CHAMBER_LAGS_S[1] / unit_s)

    def at(width: float) -> Tried:
        def deviance(share: float) -> float:
            lags_s = (share * unit_s, *(min(own, MAX_INNER * share * unit_s) for own in inner))
            own = solve(stretch(order, lags_s, width), variance).deviance
            return own + share**2 if known else own

        best_lag = minimize_scalar(
            deviance, bounds=bounds, options={"xatol": 0.02 if known else 0.002}
        )
        whole_s = float(best_lag.x) * unit_s
        lags_s = (whole_s, *(min(own, MAX_INNER * whole_s) for own in inner))
        return Tried(width, lags_s, float(best_lag.fun))

    return [at(float(width)) for width in widths]


def _within(stretch: StretchAt, best: Components, order: int, tried: Tried) -> Lags:
    """Return the lags with the likeliest part within the gyro, where that is not the whole."""
    whole_s, *inner = tried.lags_s
    if not inner:
        return tried.lags_s
    variance = best.solved[0].variance

    def deviance(inner_s: float) -> float:
        own = solve(stretch(order, (whole_s, inner_s), tried.half_width), variance)
        return own.deviance + (inner_s / INNER_PRIOR_S) ** 2

    bounds = (0.0, min(MAX_LAG * INNER_PRIOR_S, MAX_INNER * whole_s))
    likeliest = minimize_scalar(deviance, bounds=bounds, options={"xatol": 3.0})
    return whole_s, float(likeliest.x)


def _ordered(
    stretch: StretchAt, theta: Array, lags_s: Lags, width: float
) -> tuple[int, Components]:
    """Return the likeliest order of the curve, with its solution."""
    tried = {
        order: fit([stretch(order, lags_s, width)], theta) for order in range(1, HIGHEST_ORDER + 1)
    }
    order = min(tried, key=lambda order: tried[order].deviance + order * PER_ORDER)
    return order, tried[order]


@dataclass(frozen=True)
class Candidates:
    """Solutions with one half width and noise, a row for each size beforehand of the coefficients.

    `weighed` (r,) is -2 ln of how likely each is, `sizes` (r, p) those of the columns. `normal` is
    that of columns and lags, `centre` has the means of both.
    """

    tried: Tried
    theta: Array
    weighed: Array
    sizes: Array
    normal: Array
    centre: Array


def _mixed(
    rate: Array,
    setting: Setting,
    stretch: StretchAt,
    best: Components,
    order: int,
    widths: Sequence[Tried],
) -> BiasFit:
    """Return the solutions of likely curves, half widths and noises, each as likely as it is."""
    widths = sorted(widths, key=lambda tried: tried.half_width)
    # Beforehand, each ratio of widths is as likely as the next.
    ratios = np.log([tried.half_width for tried in widths])
    share = np.gradient(ratios) if len(widths) > 1 else np.ones(1)
    orders = range(max(1, order - FEWER), min(HIGHEST_ORDER, order + MORE) + 1)
    top = orders[-1]
    scale = float(np.linalg.norm(best.solved[0].sizes[:order]))
    later = setting.switched.shape[1]
    count = top + 1 + setting.has_loop + later
    precisions = _precisions(orders, count, scale)
    candidates = [
        candidate
        for own, tried in zip(share, widths, strict=True)
        for candidate in _candidates(setting, stretch, best, order, precisions, (tried, float(own)))
    ]
    weighed = np.array([candidate.weighed for candidate in candidates])
    weight = np.exp(-0.5 * (weighed - weighed.min()))
    weight[weight < MIN_SHARE] = 0.0
    weight /= weight.sum()
    values, covariances, shares = [], [], []
    for own_weight, candidate in zip(weight, candidates, strict=True):
        used = np.flatnonzero(own_weight)
        if len(used):
            own = _solutions(rate, setting, candidate, precisions[used], used)
            values.append(own[0])
            covariances.append(own[1])
            shares.append(own_weight[used])
    every, part = np.concatenate(values), np.concatenate(shares)
    sizes = part @ every
    apart = every - sizes
    covariance = np.einsum("w,wi,wj->ij", part, apart, apart)
    covariance += np.einsum("w,wij->ij", part, np.concatenate(covariances))
    names = [f"c{k}" for k in range(top + 1)] + ["s"] + ["H"] * setting.has_loop
    names += [f"switch-on {k + 2}" for k in range(later)]
    names = [*names, "lag", "inner"][: len(sizes)]
    number, row = np.unravel_index(int(np.argmin(weighed)), weighed.shape)
    chosen = candidates[int(number)]
    tried, chosen_sizes = chosen.tried, chosen.sizes[row]
    columns = setting.columns(top, tried.lags_s, tried.half_width)
    constant = float(rate.mean()) - float(chosen.centre[:count] @ chosen_sizes)
    fitted = constant + columns @ chosen_sizes
    record = stretch(order, tried.lags_s, tried.half_width)
    weighted = record.columns / np.sqrt(record.variance(best.theta))[:, None]
    seen = {"s": order} | ({"H": order + 1} if setting.has_loop else {})
    return BiasFit(
        top,
        tuple(names),
        sizes,
        covariance,
        best.theta,
        {name: _left(weighted, at) > ALONE for name, at in seen.items()},
        tried.half_width,
        rate - fitted,
        fitted,
        tried.lags_s,
    )


def _precisions(orders: Sequence[int], count: int, scale: float) -> Array:
    """Return what is known beforehand of the columns' sizes (r, p): one over their variances.

    Nothing of slope, rate and loop; coefficients up to an order have one size, others are none.
    """
    rows = []
    for order in orders:
        for part in HIGHER:
            sigma = np.full(orders[-1] - 1, NONE * scale)
            sigma[: order - 1] = part * scale
            rows.append(np.r_[0.0, 1.0 / np.maximum(sigma, SMALLEST) ** 2])
    known = np.zeros((len(rows), count))
    known[:, : orders[-1]] = rows
    return known


def _noises(best: Components) -> list[tuple[Array, float]]:
    """Return squares of the noise that data allow, and what share of them each stands for."""
    ends = (best.theta + NOISE_REACH * best.u)[1:]
    place = np.linspace(0.0, 1.0, NOISES) ** NOISES_DENSER
    stands_for = np.gradient(place)
    pairs = product(range(NOISES), repeat=2)
    return [
        (np.array([best.theta[0], *(place[[b, k]] * ends)]), float(stands_for[b] * stands_for[k]))
        for b, k in pairs
    ]


def _candidates(
    setting: Setting,
    stretch: StretchAt,
    best: Components,
    order: int,
    precisions: Array,
    width: tuple[Tried, float],
) -> list[Candidates]:
    """Return the solutions with one half width, whose share beforehand stands beside it."""
    tried, share = width
    count = precisions.shape[1]
    top = count - 1 - setting.has_loop - setting.switched.shape[1]
    own = stretch(top, tried.lags_s, tried.half_width)
    columns = setting.columns(top, tried.lags_s, tried.half_width)
    at = np.r_[:order, top:count]
    usual = solve(replace(own, columns=own.columns[:, at]), own.variance(best.theta))
    moves = _moves(setting, tried, top, at, usual.sizes)
    whole = np.column_stack([own.columns, coefficients(moves)])
    centre = np.concatenate([columns.mean(axis=0), moves.mean(axis=0)])
    beforehand = np.log(np.where(precisions > 0.0, precisions, 1.0)).sum(axis=1)
    beforehand -= float(np.sum((np.array(tried.lags_s) / setting.priors_s) ** 2))
    candidates = []
    for theta, stands_for in _noises(best):
        variance = own.variance(theta)
        weighted = whole.T / variance
        normal, right = weighted @ whole, weighted[:count] @ own.data
        inner = normal[:count, :count] + precisions[:, :, None] * np.eye(count)
        unit = 1.0 / np.sqrt(np.einsum("rii->ri", inner))
        scaled = inner * unit[:, :, None] * unit[:, None, :] + RIDGE * np.eye(count)
        sizes = unit * np.linalg.solve(scaled, (unit * right)[:, :, None])[:, :, 0]
        deviance = float(np.sum(np.log(variance) + own.data**2 / variance)) - sizes @ right
        # Restricted: what the columns take of the data says nothing of the noise.
        log_det = np.linalg.slogdet(scaled)[1] - 2.0 * np.log(unit).sum(axis=1)
        weighed = deviance + log_det - beforehand - 2.0 * np.log(share * stands_for)
        candidates.append(Candidates(tried, theta, weighed, sizes, normal, centre))
    return candidates


def _moves(setting: Setting, tried: Tried, top: int, at: Array, sizes: Array) -> Array:
    """Return by how much the model (n, lags) moves with each lag, a second."""
    columns = setting.columns(top, tried.lags_s, tried.half_width)[:, at]
    moves = []
    for number, prior_s in enumerate(setting.priors_s):
        lag_s = tried.lags_s[number]
        nudge_s = STEP * max(prior_s if np.isfinite(prior_s) else 0.0, lag_s, setting.interval_s)
        later_s = list(tried.lags_s)
        later_s[number] += nudge_s
        later = setting.columns(top, tuple(later_s), tried.half_width)[:, at]
        moves.append((later - columns) @ sizes / nudge_s)
    return np.column_stack(moves)


def _solutions(
    rate: Array, setting: Setting, candidates: Candidates, precisions: Array, rows: Index
) -> tuple[Array, Array]:
    """Return the quantities of some rows (r, q) and their covariances (r, q, q)."""
    sizes, centre, theta = candidates.sizes[rows], candidates.centre, candidates.theta
    lags = np.broadcast_to(1.0 / setting.priors_s**2, (len(rows), len(setting.priors_s)))
    known = np.hstack([precisions, lags])
    normal = candidates.normal + known[:, :, None] * np.eye(known.shape[1])
    # The constant is what the mean leaves: it moves with every column's mean.
    gain = np.vstack([-centre, np.eye(len(centre))])
    covariance = gain @ _inverse(normal) @ gain.T
    covariance[:, 0, 0] += variance_of_mean(theta, len(rate) * setting.interval_s)
    constant = float(rate.mean()) - sizes @ centre[: sizes.shape[1]]
    lags_s = np.broadcast_to(candidates.tried.lags_s, lags.shape)
    return np.column_stack([constant, sizes, lags_s]), covariance


def variance_of_mean(theta: Array, length_s: float) -> float:
    """Return the variance of the mean of a record by the squares (3,) of its noise."""
    return float(theta @ [1.0 / length_s, FLICKER, WALK_MEAN * length_s])


def _inverse(normal: Array) -> Array:
    """Return the inverses of normal matrices (r, p, p)."""
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("rii->ri", normal), SMALLEST))
    both = scale[:, :, None] * scale[:, None, :]
    return np.asarray(np.linalg.pinv(normal * both, hermitian=True) * both)


def _left(weighted: Array, at: int) -> float:
    """Return which part of a column the others leave of it."""
    others = np.delete(weighted, at, axis=1)
    own = weighted[:, at]
    rest = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
    return float(np.linalg.norm(rest) / max(float(np.linalg.norm(own)), 1e-300))
