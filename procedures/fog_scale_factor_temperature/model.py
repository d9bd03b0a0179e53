"""The columns of one axis, and their solution for any choice of rows, a wandering bias included.

Turn error in millionths of a turn = commanded turns x delta(T) + time x bias. The bias is a
polynomial of temperature and a random walk in time; where all turns have one sense it has the
columns of the scale factor, and is left to the uncertainty.

The walk's size against the turns' own noise is found by restricted maximum likelihood (Patterson
and Thompson, Biometrika 58, 1971): the likelihood of what is orthogonal to all fitted columns.
Turns of both senses side by side then cancel the bias between them however fast it walks, and a
turn whose partner is missing still counts as far as the neighbouring sets show the bias.

Whitening is the innovations of a Kalman filter for the walk, one turn after the other. Products go
by one core: matrices of a hundred rows only make a threaded library wait.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import choose_by_information, project, solve_by_qr, thin_qr

from .curve import chebyshev_columns
from .dataset import (
    SAME_TEMPERATURE_DEGC,
    Array,
    AxisTurns,
    Mask,
    distinct_temperatures,
    is_paired,
    set_means,
)
from .parameters import AnalysisSettings

COARSE = np.concatenate(([0.0], 10.0 ** np.linspace(-4.0, 7.0, 45)))
"""Sizes of a walk over one set, as a variance in units of a turn's own."""
FINE = 10.0 ** np.linspace(-0.25, 0.25, 11)
BIAS_ORDER = 4
SPARE = 3
"""Temperatures beyond the order, and rows beyond the columns, that a fit must have."""
CHANCE = 2.3
"""Times one over the root of the sets: what a correlation of white residuals seldom exceeds."""


@dataclass(frozen=True)
class TurnTimes:
    """When the bias acts, rows in the order of time: steps since the first turn, and how long.

    `since` (n,) is in steps of the walk, `weight` (n,) the duration in units of the mean.
    """

    since: Array
    weight: Array

    def of(self, rows: Mask) -> TurnTimes:
        """Return the times at some of the rows."""
        return TurnTimes(self.since[rows], self.weight[rows])

    def covariance(self, rows: Mask, others: Mask) -> Array:
        """Return the covariance of rows and others under a walk of variance one per step."""
        shared = np.minimum.outer(self.since[rows], self.since[others])
        return np.asarray(shared * np.outer(self.weight[rows], self.weight[others]))


def turn_times_of(middle_s: Array, duration_s: Array, step_s: float) -> TurnTimes:
    """Return the times of turns; what the bias was at the first is left to the columns."""
    return TurnTimes((middle_s - middle_s.min()) / step_s, duration_s / float(np.mean(duration_s)))


def innovations(times: TurnTimes, ratios: Array, columns: Array) -> tuple[Array, Array]:
    """Return columns (n, k) whitened for each of m ratios, (m, n, k), and their variances (m, n).

    A column that is the turns' errors comes out as independent values of variance one.
    """
    rows, width = columns.shape
    state = np.zeros((len(ratios), width))
    spread = np.zeros(len(ratios))
    white = np.empty((len(ratios), rows, width))
    variance = np.empty((len(ratios), rows))
    steps = np.maximum(np.diff(times.since, prepend=0.0), 0.0)
    for n in range(rows):
        weight = times.weight[n]
        spread = spread + ratios * steps[n]
        variance[:, n] = 1.0 + weight**2 * spread
        new = columns[n] - weight * state
        gain = weight * spread / variance[:, n]
        state = state + gain[:, None] * new
        spread = spread / variance[:, n]
        white[:, n] = new / np.sqrt(variance[:, n])[:, None]
    return white, variance


def walk_ratio(design: Array, data: Array, times: TurnTimes) -> float:
    """Return the variance of the walk over a step, in units of the variance of the white noise.

    By restricted maximum likelihood; the columns of `design` (n, k) are taken out.
    """
    rows, width = design.shape
    if rows - width < 3:
        return 0.0
    # What the columns take of the data does not matter, and would cost digits.
    left = solve_by_qr(design, data).residuals
    size = float(np.sqrt(left @ left))
    if size <= 1e-12 * float(np.sqrt(data @ data)):
        return 0.0
    scale = np.sqrt(np.einsum("ij,ij->j", design, design))
    columns = np.column_stack((design / np.where(scale > 0.0, scale, 1.0), left / size))
    best = _likeliest(columns, times, COARSE)
    return best if best == 0.0 else _likeliest(columns, times, best * FINE)


def _likeliest(columns: Array, times: TurnTimes, ratios: Array) -> float:
    rows, width = columns.shape
    white, variance = innovations(times, ratios, columns)
    normal = np.swapaxes(white, 1, 2) @ white
    normal += 1e-13 * np.eye(width) * np.trace(normal, axis1=1, axis2=2)[:, None, None]
    diagonal = np.diagonal(np.linalg.cholesky(normal), axis1=1, axis2=2)
    criterion = 2.0 * (rows - width + 1) * np.log(diagonal[:, -1])
    criterion += 2.0 * np.log(diagonal[:, :-1]).sum(axis=1) + np.log(variance).sum(axis=1)
    return float(ratios[int(np.argmin(criterion))])


class Walk:
    """Turns whose errors share a walk of the bias: V = 1 + ratio x covariance of the walk."""

    def __init__(self, times: TurnTimes, ratio: float) -> None:
        identity = np.eye(len(times.since))
        white, variance = innovations(times, np.array([ratio]), identity)
        self.factor = white[0]
        """Lower triangle that makes independent errors of equal size: its square is V^-1."""
        self.log_determinant = float(np.log(variance).sum())

    def whiten(self, columns: Array) -> Array:
        """Return columns (n, k) whose errors would be independent and of equal size."""
        return np.asarray(np.einsum("ij,jk->ik", self.factor, columns))


@dataclass(frozen=True)
class Solved:
    """What one choice of rows gives: range, order, size of the walk, and a least-squares solution.

    `coefficients` (p,) are those of the bias, then those of the curve in ppm; `inverse_normal`
    times `noise` squared is their covariance. `white` (n,) is what the solution leaves of the kept
    turns once the walk, too, is taken off; what the walk takes of the data is no degree of freedom
    of the noise. `lag_one` is the correlation of neighbouring sets.
    """

    kept: Mask
    domain_degC: tuple[float, float]
    order: int
    ratio: float
    coefficients: Array
    inverse_normal: Array
    noise: float
    degrees_of_freedom: float
    white: Array
    lag_one: float

    @property
    def curve_ppm(self) -> Array:
        """The coefficients of the curve alone, lowest order first."""
        return self.coefficients[-self.order - 1 :]

    def error_ppm(self, temperature_degC: Array) -> Array:
        """Return the scale-factor error at temperatures (n,), not held at the ends of the range."""
        columns = chebyshev_columns(temperature_degC, self.domain_degC, self.order)
        return combine(columns, self.curve_ppm)


def squares_left(columns: Array, data: Array) -> Array:
    """Return the squares that the first 1 .. k of the columns (n, k) leave of data (n,)."""
    gains = project(thin_qr(columns)[0], data) ** 2
    return np.maximum(float(data @ data) - np.cumsum(gains), 0.0)


class AxisProblem:
    """The columns of one axis; `kept` is the question that the rounds of rejection answer."""

    def __init__(self, turns: AxisTurns, settings: AnalysisSettings, floor_ppm: float) -> None:
        self.turns = turns
        self.settings = settings
        self.floor_ppm = floor_ppm
        self.paired = is_paired(turns)
        self.candidates = turns.usable & (self.paired | turns.sensing)
        self.turn_times = turn_times_of(turns.middle_s, turns.duration_s, turns.set_interval_s)
        self.data = turns.data_ppm

    def highest_order(self, kept: Mask) -> int:
        """Return the highest order that the kept turns can carry, -1 where they carry none."""
        sensing = kept & self.turns.sensing
        distinct = min(
            distinct_temperatures(self.turns.temperature_degC[sensing]),
            len(np.unique(self.turns.set_number[sensing])),
        )
        spare = int(sensing.sum()) - SPARE - (2 if self.paired else 0)
        third = max(distinct // 3, min(distinct - SPARE, 4))
        return min(self.settings.highest_order, distinct - SPARE, spare, third)

    def domain(self, kept: Mask) -> tuple[float, float]:
        """Return the range of the kept turns' temperatures."""
        inside = self.turns.temperature_degC[kept & self.turns.sensing]
        return float(inside.min()), float(inside.max())

    def design(
        self, domain: tuple[float, float], order: int, bias_order: int | None = None
    ) -> tuple[Array, int]:
        """Return the columns for all rows, those of the bias first, and how many these are."""
        bias_order = BIAS_ORDER if bias_order is None else bias_order
        high = max(order, bias_order)
        polynomials = chebyshev_columns(self.turns.temperature_degC, domain, high)
        scale = polynomials[:, : order + 1] * self.turns.turns[:, None]
        if not self.paired:
            return scale, 0
        few = max(0, min(bias_order, len(self.turns.sets()) // 4 - 1))
        bias = polynomials[:, : few + 1] * self.turns.by_bias_ppm[:, None]
        return np.column_stack((bias, scale)), few + 1

    def solve(self, kept: Mask) -> Solved | None:
        """Fit the kept rows: the walk of the bias, then the order, then both again."""
        highest = self.highest_order(kept)
        if highest < 0:
            return None
        domain = self.domain(kept)
        if domain[1] - domain[0] <= 0.0:
            domain = (domain[0] - SAME_TEMPERATURE_DEGC, domain[1] + SAME_TEMPERATURE_DEGC)
            highest = 0
        order, ratio = highest, self._ratio(kept, domain, highest)
        for _ in range(2):
            asked = self.order_of(kept, domain, highest, ratio)
            if asked == order:
                break
            order, ratio = asked, self._ratio(kept, domain, asked)
        best = self.fit_of_order(kept, domain, order, ratio)
        if self._stiff(best):
            for higher in range(order + 1, highest + 1):
                raised = self.fit_of_order(kept, domain, higher, ratio)
                if not self._stiff(raised):
                    return raised
        return best

    def _ratio(self, kept: Mask, domain: tuple[float, float], order: int) -> float:
        if not self.paired:
            return 0.0
        design = self.design(domain, order)[0][kept]
        return walk_ratio(design, self.data[kept], self.turn_times.of(kept))

    def order_of(self, kept: Mask, domain: tuple[float, float], highest: int, ratio: float) -> int:
        """Return the order that some rows ask for, in a range and with a walk of a size."""
        design, biases = self.design(domain, highest)
        walk = Walk(self.turn_times.of(kept), ratio)
        left = squares_left(walk.whiten(design[kept]), combine(walk.factor, self.data[kept]))
        columns = [biases + order + 1 for order in range(highest + 1)]
        return choose_by_information(list(left[biases:]), columns, int(kept.sum()))

    def fit_of_order(
        self, kept: Mask, domain: tuple[float, float], order: int, ratio: float
    ) -> Solved:
        """Fit the kept rows with a curve of this order and a walk of this size."""
        design = self.design(domain, order)[0][kept]
        walk = Walk(self.turn_times.of(kept), ratio)
        solved = solve_by_qr(walk.whiten(design), combine(walk.factor, self.data[kept]))
        rows, width = design.shape
        noise = float(np.sqrt(solved.sum_of_squares / (rows - width))) if rows > width else 0.0
        white = project(walk.factor, solved.residuals)
        return Solved(
            kept,
            domain,
            order,
            ratio,
            solved.coefficients,
            solved.inverse_normal,
            noise,
            max(float((walk.factor**2).sum()) - width, 1.0),
            white,
            self._lag_one(kept, white),
        )

    def deleted_residuals(self, solved: Solved) -> Array:
        """Return how far each candidate lies from what the other kept rows foretell, (rows,).

        In units of its standard deviation, the white noise taken for one; zero of other rows.
        """
        kept, ratio, times = solved.kept, solved.ratio, self.turn_times
        design = self.design(solved.domain_degC, solved.order)[0]
        walk = Walk(times.of(kept), ratio)
        columns = walk.whiten(design[kept])
        fit = solve_by_qr(columns, combine(walk.factor, self.data[kept]))
        result = np.zeros(len(kept))
        # Of a kept row: (P y)_i / sqrt(P_ii), with P the projector that takes the columns out.
        hat = np.einsum("ji,jk->ik", walk.factor, columns)
        own = np.einsum("ji,ji->i", walk.factor, walk.factor)
        own = own - np.einsum("ij,jk,ik->i", hat, fit.inverse_normal, hat)
        alone = own < 1e-9
        left = project(walk.factor, fit.residuals)
        result[kept] = np.where(alone, 0.0, left / np.sqrt(np.where(alone, 1.0, own)))
        out = self.candidates & ~kept
        if bool(out.any()):
            shared = walk.whiten(ratio * times.covariance(kept, out))
            predicted = combine(design[out], fit.coefficients) + project(shared, fit.residuals)
            gap = design[out] - np.einsum("ji,jk->ik", shared, columns)
            variance = 1.0 + ratio * times.since[out] * times.weight[out] ** 2
            variance = variance - np.einsum("ji,ji->i", shared, shared)
            variance = variance + np.einsum("ij,jk,ik->i", gap, fit.inverse_normal, gap)
            result[out] = (self.data[out] - predicted) / np.sqrt(variance)
        return result

    def _lag_one(self, kept: Mask, white: Array) -> float:
        """Return the correlation of neighbouring sets' residuals in the order of temperature."""
        turns = self.turns
        own = kept & turns.sensing
        left = white[turns.sensing[kept]] / turns.turns[own]
        mean, heat = set_means(turns.set_number[own], left, turns.temperature_degC[own])
        ordered = mean[np.argsort(heat, kind="stable")]
        power = float(ordered @ ordered)
        return float(ordered[1:] @ ordered[:-1]) / power if power > 0.0 else 0.0

    def _stiff(self, solved: Solved) -> bool:
        return solved.lag_one > stiffness(self.settings, len(self.turns.sets()))


def stiffness(settings: AnalysisSettings, sets: int) -> float:
    """Return the correlation from which on the model does not follow the curve."""
    return max(settings.model_too_stiff, CHANCE / float(np.sqrt(max(sets, 1))))
