"""The solution of an axis: which turns are wild, the curve, and what the turns leave open of it.

A stiff first look takes a feature of the curve for wild turns, a soft one a wild turn at the end of
the range for the curve. So several compete, and the likeliest of their ends counts; where another
is nearly as likely, what it makes of the curve is in the uncertainty. So is what other orders make
of it, a kink or a feature that no order follows, and what may be in a gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import CHARGE, keep_inliers, solve_by_qr

from .curve import CHECKED, Curve, chebyshev_columns
from .dataset import Array, AxisTurns, Index, Mask, noise_of_sets
from .misfit import Misfit, misfit_of
from .model import AxisProblem, Solved, Walk
from .parameters import PUBLISHED_ORDER, AnalysisSettings

START_BIAS_ORDER = 6
START_THRESHOLD = 1.6
"""Of the rejection's: the first look has no model of the bias's walk."""
START_ORDERS = (4, 9, 20)
WILD_SHARE = 0.05
ROUNDS = 25
UNSEEN = 2.5
"""Standard deviations of a coefficient that the information criterion leaves out."""
FURTHER_ORDERS, OTHER_ORDERS = 2, 3
"""Above the chosen one: what may be there in a gap, and what counts beside it everywhere."""
MIN_NOISE = 0.5
"""Of what is called noise at least: readings that all round alike have none, and are not exact."""

Gaps = tuple[tuple[float, float], ...]
Weighed = tuple[float, Solved]
"""A solution after minus twice the logarithm of its likelihood."""


@dataclass(frozen=True)
class AxisFit:
    """One axis: its turns, those that the model uses, and the model.

    `error_ppm` (n,) is the error of each row over its commanded turn, NaN for a wait; what the
    model and the wandering bias leave of it is `residual_ppm`
    (n,). `curve` is None where the turns do not
    determine one. `noise_ppm` is the standard deviation of a turn, by the scatter of the sets that
    resolve their bias. `walk_deg_per_h_per_sqrt_h` and `bias_deg_per_h` are None where turns of one
    sense do not determine them. `misfit` is what the curve does not follow, `gaps_degC` are the
    stretches of temperature without a turn, each from and until, that are wider than
    `temperature_gap_degC`.
    """

    turns: AxisTurns
    kept: Mask
    error_ppm: Array
    residual_ppm: Array
    paired: bool
    curve: Curve | None = None
    noise_ppm: float | None = None
    lag_one_correlation: float | None = None
    walk_deg_per_h_per_sqrt_h: float | None = None
    bias_deg_per_h: float | None = None
    misfit: Misfit | None = None
    gaps_degC: Gaps = ()

    @property
    def axis(self) -> str:
        """The gyro."""
        return self.turns.axis

    @property
    def sets(self) -> int:
        """How many sets have a turn that the model uses."""
        return len(np.unique(self.turns.set_number[self.kept]))

    @property
    def rejected(self) -> Index:
        """Rows of the axis that the model leaves out as wrong, (k,); none without a curve.

        Waits among turns of one sense are no wrong rows: they say nothing about that model.
        """
        meant = (np.isfinite(self.error_ppm) | self.paired) & (self.curve is not None)
        return np.flatnonzero(meant & ~self.kept)

    @property
    def rejected_rows(self) -> list[int]:
        """The same as rows of the turn table, 0-based."""
        return [int(row) for row in self.turns.rows[self.rejected]]

    def in_gap(self, temperature_degC: float, wider_than_degC: float) -> bool:
        """Whether a temperature lies in a stretch without a turn that is wider than that."""
        return any(
            low < temperature_degC < high and high - low > wider_than_degC
            for low, high in self.gaps_degC
        )


def fit_axis(
    turns: AxisTurns,
    settings: AnalysisSettings,
    floor_ppm: float = 0.0,
    gyro_bias_deg_per_h: float = 0.0,
) -> AxisFit:
    """Return the model of one axis; `floor_ppm` is the least deviation that is called noise.

    `gyro_bias_deg_per_h` is what the bias may change by where turns of one sense do not show it.
    """
    problem = AxisProblem(turns, settings, floor_ppm)
    paired, usual_ppm = problem.paired, float(np.mean(turns.by_bias_ppm))
    error = np.divide(
        turns.data_ppm, turns.turns, out=np.full(len(turns.rows), np.nan), where=turns.sensing
    )
    residual = np.full(len(error), np.nan)
    ends = reject(problem)
    if not ends:
        return AxisFit(turns, np.zeros(len(error), dtype=bool), error, residual, paired)
    solved = ends[0][1]
    kept, out = solved.kept, turns.usable & ~solved.kept
    design, biases = problem.design(solved.domain_degC, solved.order)
    residual[kept] = solved.white
    residual[out] = problem.data[out] - design[out] @ solved.coefficients
    residual = np.divide(
        residual, turns.turns, out=np.full_like(error, np.nan), where=turns.sensing
    )
    noise, free, by_bias = solved.noise, solved.degrees_of_freedom, np.zeros(solved.order + 1)
    if paired:
        left = problem.data - design[:, biases:] @ solved.curve_ppm
        noise, free = noise_of_sets(turns, kept, left, solved.order + 1) or (noise, free)
    else:
        by_bias = solve_by_qr(design[kept], turns.by_bias_ppm[kept]).coefficients
    noise = max(noise, MIN_NOISE * floor_ppm)
    covariance = noise**2 * solved.inverse_normal[biases:, biases:]
    curve = Curve(solved.domain_degC, solved.curve_ppm, covariance, free, by_bias)
    bias_ppm = 0.0 if paired else gyro_bias_deg_per_h * usual_ppm
    misfit = misfit_of(problem, solved, noise, free, bias_ppm)
    if misfit is not None:
        curve = curve.checked(misfit.left_ppm)
    gaps = gaps_of(problem, kept)
    curve = curve.checked(apart_ppm(solved, other_orders(problem, solved)))
    curve = curve.checked(apart_ppm(solved, ends))
    if gaps:
        curve = curve.checked(unknown_in_gaps_ppm(problem, solved, noise, gaps))
    walk_ppm = solved.noise * np.sqrt(solved.ratio / turns.set_interval_s * SECONDS_PER_HOUR)
    return AxisFit(
        turns,
        kept,
        error,
        residual,
        paired,
        curve,
        noise,
        solved.lag_one,
        float(walk_ppm / usual_ppm) if paired else None,
        float(solved.coefficients[0]) if paired else None,
        misfit,
        gaps,
    )


def first_look(problem: AxisProblem, order: int) -> Mask:
    """Return the rows that a look by least magnitudes, of this order, does not throw out."""
    kept: Mask = problem.candidates.copy()
    highest = problem.highest_order(kept)
    if highest < 0:
        return kept
    order = min(order, highest, max(int(kept.sum()) // 5, 1))
    design, _ = problem.design(problem.domain(kept), order, START_BIAS_ORDER)
    threshold = START_THRESHOLD * problem.settings.outlier
    near = kept & False
    near[kept] = keep_inliers(design[kept], problem.data[kept], threshold)
    # Quantised data may have a robust deviation of nothing: never reject within the floor.
    if problem.floor_ppm > 0.0:
        solved = solve_by_qr(design[near], problem.data[near]).coefficients
        near |= kept & (np.abs(problem.data - design @ solved) <= threshold * problem.floor_ppm)
    return near


def reject(problem: AxisProblem) -> list[Weighed]:
    """Return the solutions that agree with what their own turns foretell, the likeliest first.

    From first looks of several orders, and the likeliest of their ends without a turn of the
    coldest or the warmest set, where another order is chosen without it: there a curve of high
    order follows one wild turn, and no neighbour denies it. None where the turns carry no curve.
    """
    looks = {look.tobytes(): look for look in (first_look(problem, n) for n in START_ORDERS)}
    ends: dict[bytes, Weighed] = {}

    def end(solved: Solved | None) -> None:
        if solved is not None and solved.kept.tobytes() not in ends:
            ends[solved.kept.tobytes()] = _surprise(problem, solved), solved

    for look in looks.values():
        end(_settle(problem, look))
    if ends:
        best = min(ends.values(), key=_first)[1]
        for row in _outermost(problem, best.kept):
            without = best.kept.copy()
            without[row] = False
            highest = problem.highest_order(without)
            asked = -1
            if highest >= 0:
                asked = problem.order_of(without, best.domain_degC, highest, best.ratio)
            if asked != best.order:
                end(problem.solve(without))
    return sorted(ends.values(), key=_first)


def _first(weighed: Weighed) -> float:
    return weighed[0]


def _outermost(problem: AxisProblem, kept: Mask) -> Index:
    """Return the rows of the coldest and of the warmest set."""
    turns = problem.turns
    own = np.flatnonzero(kept & turns.sensing)
    heat = turns.temperature_degC[own]
    ends = turns.set_number[own[[int(np.argmin(heat)), int(np.argmax(heat))]]]
    return np.flatnonzero(kept & np.isin(turns.set_number, ends))


def _surprise(problem: AxisProblem, solved: Solved) -> float:
    """Return minus twice the logarithm of the likelihood, wild turns and columns charged.

    A wild turn may lie anywhere within the span of the data, and is as seldom as `WILD_SHARE`.
    """
    count = int(solved.kept.sum())
    wild = int(problem.candidates.sum()) - count
    span = float(np.ptp(problem.data[problem.candidates])) or 1.0
    noise = max(solved.noise, problem.floor_ppm, 1e-9 * span)
    surprise = count * (np.log(2.0 * np.pi * noise**2) + 1.0)
    surprise += Walk(problem.turn_times.of(solved.kept), solved.ratio).log_determinant
    surprise += CHARGE * (solved.order + 1) * np.log(count)
    return float(surprise + 2.0 * wild * np.log(span * (1.0 - WILD_SHARE) / WILD_SHARE))


def _settle(problem: AxisProblem, kept: Mask) -> Solved | None:
    """Return the solution of the rows that stay: wild ones left out, good ones taken back.

    One row of a set is taken or given back at a time: of a pair the good turn looks as wrong as
    the bad one until one of them is gone.
    """
    solved, seen = problem.solve(kept), {kept.tobytes()}
    for _ in range(ROUNDS):
        if solved is None:
            break
        sigma = max(solved.noise, problem.floor_ppm)
        size = np.abs(problem.deleted_residuals(solved))
        changed = _changed(problem, solved.kept, size, problem.settings.outlier * sigma)
        if changed.tobytes() in seen:
            break
        seen.add(changed.tobytes())
        again = problem.solve(changed)
        if again is None:
            break
        solved = again
    return solved


def _changed(problem: AxisProblem, kept: Mask, size: Array, threshold: float) -> Mask:
    changed = kept.copy()
    far = kept & (size > threshold)
    back = problem.candidates & ~kept & (size <= threshold)
    for number in np.unique(problem.turns.set_number[far | back]):
        own = problem.turns.set_number == number
        if bool((own & far).any()):
            changed[np.flatnonzero(own & far)[np.argmax(size[own & far])]] = False
        else:
            changed[np.flatnonzero(own & back)[np.argmin(size[own & back])]] = True
    return changed


def apart_ppm(solved: Solved, others: Sequence[Weighed]) -> Array:
    """Return how far the curves of others are from a solution's, at `CHECKED` places, rms.

    Each counts by its likelihood.
    """
    grid = np.linspace(*solved.domain_degC, CHECKED)
    surprise = np.array([value for value, _ in others])
    weight = np.exp(-0.5 * (surprise - surprise.min()))
    apart = np.array([other.error_ppm(grid) for _, other in others]) - solved.error_ppm(grid)
    return np.asarray(np.sqrt(np.einsum("m,mn->n", weight / weight.sum(), apart**2)))


def other_orders(problem: AxisProblem, solved: Solved) -> list[Weighed]:
    """Return the solutions of all orders up to some above the chosen one.

    The criterion chooses one order where the turns leave several open, and rather a low one: much
    noise hides much of a curve. Each order counts by its Akaike weight (Burnham and Anderson,
    Sociological Methods and Research 33, 2004): how much the turns speak for it.
    """
    kept, rows = solved.kept, int(solved.kept.sum())
    last = max(solved.order + OTHER_ORDERS, PUBLISHED_ORDER)
    last = max(min(last, problem.highest_order(kept)), solved.order)
    fits = [
        problem.fit_of_order(kept, solved.domain_degC, order, solved.ratio)
        for order in range(last + 1)
    ]
    weighed = []
    for fit in fits:
        width = len(fit.coefficients)
        square = max(fit.noise**2 * (rows - width), 1e-300)
        weighed.append((float(rows * np.log(square / rows) + 2.0 * width), fit))
    return weighed


def gaps_of(problem: AxisProblem, kept: Mask) -> Gaps:
    """Return the stretches without a turn that are wider than the threshold, from and until."""
    heat = np.sort(problem.turns.temperature_degC[kept & problem.turns.sensing])
    wide = np.flatnonzero(np.diff(heat) > problem.settings.temperature_gap_degC)
    return tuple((float(heat[n]), float(heat[n + 1])) for n in wide)


def unknown_in_gaps_ppm(problem: AxisProblem, solved: Solved, noise: float, gaps: Gaps) -> Array:
    """Return what higher orders may add at the `CHECKED` temperatures; zero outside the gaps.

    Between two ends a polynomial of the order that the turns ask for says one thing and one of a
    higher order another; nothing in the data speaks for either. The next two orders, each as large
    as could have been there unseen, are in the uncertainty. In a wide gap no value is given.
    """
    order = solved.order + FURTHER_ORDERS
    walk = Walk(problem.turn_times.of(solved.kept), solved.ratio)
    design, biases = problem.design(solved.domain_degC, order)
    white = walk.whiten(design[solved.kept])
    grid = np.linspace(*solved.domain_degC, CHECKED)
    polynomials = chebyshev_columns(grid, solved.domain_degC, order)
    square = np.zeros(CHECKED)
    for place in range(biases + solved.order + 1, biases + order + 1):
        taken = solve_by_qr(white[:, :place], white[:, place])
        left = float(np.sqrt(taken.sum_of_squares))
        shape = polynomials[:, place - biases]
        shape = shape - combine(polynomials[:, : place - biases], taken.coefficients[biases:])
        square += (UNSEEN * noise / max(left, 1e-9) * shape) ** 2
    inside = np.any([(grid > low) & (grid < high) for low, high in gaps], axis=0)
    return np.where(inside, np.sqrt(square), 0.0)
