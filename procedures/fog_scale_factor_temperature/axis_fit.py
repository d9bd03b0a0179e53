"""The best estimate for one axis: robust, bias and all, with an order that the data ask for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import solve_by_qr

from .axis_problem import AxisProblem, Solved, Walk
from .curve import CHECKED, Curve, chebyshev_columns
from .dataset import Array, AxisTurns, Index, Mask, noise_of_sets
from .misfit import Misfit, misfit_of
from .parameters import PUBLISHED_ORDER, AnalysisSettings
from .rejection import other_ends_ppm, reject

Gaps = tuple[tuple[float, float], ...]
UNSEEN = 2.5
"""Standard deviations of a coefficient that the information criterion leaves out."""
FURTHER_ORDERS, OTHER_ORDERS = 2, 3
"""Above the chosen one: what may be there in a gap, and what counts beside it everywhere."""
WIDE = 2.0
"""Times the threshold of the flag: from such a width on no value is given within."""
MIN_NOISE = 0.5
"""Of what is called noise at least: readings that all round alike have none, and are not exact."""


def gaps_of(problem: AxisProblem, kept: Mask) -> Gaps:
    """Return the stretches without a turn that are wider than the threshold, from and until."""
    heat = np.sort(problem.turns.temperature_degC[kept & problem.turns.sensing])
    wide = np.flatnonzero(np.diff(heat) > problem.settings.temperature_gap_degC)
    return tuple((float(heat[n]), float(heat[n + 1])) for n in wide)


def within(gaps: Gaps, temperature_degC: float, wider_than: float) -> bool:
    """Whether a temperature lies in a stretch wider than that."""
    return any(a < temperature_degC < b and b - a > wider_than for a, b in gaps)


def other_orders_ppm(problem: AxisProblem, kept: Mask, solved: Solved) -> Array:
    """Return how far curves of other orders are from the chosen one, at `CHECKED` places, rms.

    The criterion chooses one order where the turns leave several open, and rather a low one: much
    noise hides much of a curve. Each order counts by its Akaike weight (Burnham and Anderson,
    Sociological Methods and Research 33, 2004): how much the turns speak for it.
    """
    last = max(solved.order + OTHER_ORDERS, PUBLISHED_ORDER)
    last = max(min(last, problem.highest_order(kept)), solved.order)
    columns = chebyshev_columns(np.linspace(*solved.domain_degC, CHECKED), solved.domain_degC, last)
    rows = int(kept.sum())
    curves, costs = [], []
    for order in range(last + 1):
        fit = problem.fit_of_order(kept, solved.domain_degC, order, solved.ratio).fit
        width = len(fit.coefficients)
        square = max(fit.noise**2 * (rows - width), 1e-300)
        curves.append(combine(columns[:, : order + 1], fit.coefficients[-order - 1 :]))
        costs.append(rows * np.log(square / rows) + 2.0 * width)
    weight = np.exp(-0.5 * (np.array(costs) - min(costs)))
    apart = np.array(curves) - curves[solved.order]
    return np.asarray(np.sqrt(np.einsum("m,mn->n", weight / weight.sum(), apart**2)))


def unknown_in_gaps_ppm(
    problem: AxisProblem, kept: Mask, solved: Solved, noise: float, gaps: Gaps
) -> Array:
    """Return what higher orders may add at the `CHECKED` temperatures; zero outside the gaps.

    Between two ends a polynomial of the order that the turns ask for says one thing and one of a
    higher order another; nothing in the data speaks for either. The next two orders, each as large
    as could have been there unseen, are in the uncertainty. In a wide gap no value is given.
    """
    order = solved.order + FURTHER_ORDERS
    walk = Walk(problem.turn_times.of(kept), solved.ratio)
    design, biases = problem.design(solved.domain_degC, order)
    white = walk.whiten(design[kept])
    grid = np.linspace(*solved.domain_degC, CHECKED)
    polynomials = chebyshev_columns(grid, solved.domain_degC, order)
    square = np.zeros(CHECKED)
    for place in range(biases + solved.order + 1, biases + order + 1):
        taken = solve_by_qr(white[:, :place], white[:, place])
        left = float(np.sqrt(taken.sum_of_squares))
        shape = polynomials[:, place - biases]
        shape = shape - combine(polynomials[:, : place - biases], taken.coefficients[biases:])
        square += (UNSEEN * noise / max(left, 1e-9) * shape) ** 2
    inside = np.zeros(CHECKED, dtype=bool)
    for low, high in gaps:
        inside |= (grid > low) & (grid < high)
    return np.where(inside, np.sqrt(square), 0.0)


@dataclass(frozen=True)
class AxisFit:
    """One axis: its rows of the turn table, those that the model uses, and the model.

    `rows` are row numbers of the table, the other arrays belong to them: `error_ppm` (n,) is the
    turn error over the commanded turn, NaN for a wait; `residual_ppm` (n,) what the model and the
    wandering bias leave of it. `curve` is None where the turns do not determine one. `noise_ppm` is
    the standard deviation of a turn, by the scatter of the sets that resolve their bias.
    `walk_deg_per_h_per_sqrt_h` and `bias_deg_per_h` are None where turns of one sense do not
    determine them. `misfit` is what the curve does not follow, `gaps_degC` are the stretches of
    temperature without a turn, each from and until, that are wider than `temperature_gap_degC`.
    """

    axis: str
    rows: Index
    kept: Mask
    temperature_degC: Array
    error_ppm: Array
    residual_ppm: Array
    curve: Curve | None
    paired: bool
    noise_ppm: float | None = None
    lag_one_correlation: float | None = None
    sets: int = 0
    walk_deg_per_h_per_sqrt_h: float | None = None
    bias_deg_per_h: float | None = None
    misfit: Misfit | None = None
    gaps_degC: tuple[tuple[float, float], ...] = ()

    @property
    def rejected(self) -> Index:
        """Places in `rows` that the model leaves out as wrong, (k,); none without a curve.

        Waits among turns of one sense are no wrong rows: they say nothing about that model.
        """
        meant = (np.isfinite(self.error_ppm) | self.paired) & (self.curve is not None)
        return np.flatnonzero(meant & ~self.kept)

    @property
    def rejected_rows(self) -> list[int]:
        """The rows of the turn table that the model leaves out as wrong, 0-based."""
        return [int(row) for row in self.rows[self.rejected]]


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
    ends = reject(problem)
    kept, solved = ends[0].kept, ends[0].solved
    sensing = turns.sensing
    safe = np.where(sensing, turns.turns, 1.0)
    error = np.where(sensing, turns.data_ppm / safe, np.nan)
    blank = np.full(len(error), np.nan)
    if solved is None:
        nothing = np.zeros(len(kept), dtype=bool)
        return AxisFit(
            turns.axis,
            turns.rows,
            nothing,
            turns.temperature_degC,
            error,
            blank,
            None,
            problem.paired,
        )
    design, biases = problem.design(solved.domain_degC, solved.order)
    fit = solved.fit
    residual = blank.copy()
    residual[kept] = fit.white
    out = turns.usable & ~kept
    residual[out] = problem.data[out] - design[out] @ fit.coefficients
    by_bias = np.zeros(solved.order + 1)
    if not problem.paired:
        by_bias = solve_by_qr(design[kept], turns.by_bias_ppm[kept]).coefficients
    noise, free = fit.noise, float(fit.degrees_of_freedom)
    if problem.paired:
        left = problem.data - design[:, biases:] @ fit.coefficients[biases:]
        noise, free = noise_of_sets(turns, kept, left, solved.order + 1) or (noise, free)
    noise = max(noise, MIN_NOISE * floor_ppm)
    bias_ppm = 0.0
    if not problem.paired:
        bias_ppm = gyro_bias_deg_per_h * float(np.mean(turns.by_bias_ppm))
    curve = Curve(
        solved.domain_degC,
        fit.coefficients[biases:],
        noise**2 * fit.inverse_normal[biases:, biases:],
        free,
        by_bias,
    )
    misfit = misfit_of(problem, kept, solved, noise, free, bias_ppm)
    if misfit is not None:
        curve = curve.checked(misfit.left_ppm)
    gaps = gaps_of(problem, kept)
    curve = curve.checked(other_orders_ppm(problem, kept, solved))
    curve = curve.checked(other_ends_ppm(ends))
    if gaps:
        curve = curve.checked(unknown_in_gaps_ppm(problem, kept, solved, noise, gaps))
    return AxisFit(
        turns.axis,
        turns.rows,
        kept,
        turns.temperature_degC,
        error,
        np.where(sensing, residual / safe, np.nan),
        curve,
        problem.paired,
        noise,
        solved.lag_one,
        len(np.unique(turns.set_number[kept])),
        _walk(turns, solved) if problem.paired else None,
        float(fit.coefficients[0]) if problem.paired else None,
        misfit,
        gaps,
    )


def _walk(turns: AxisTurns, solved: Solved) -> float:
    """Return the size of the bias's walk in deg/h per root hour."""
    usual_ppm = float(np.mean(turns.by_bias_ppm))
    per_step = solved.fit.noise * np.sqrt(solved.ratio) / usual_ppm
    return float(per_step / np.sqrt(turns.set_interval_s / SECONDS_PER_HOUR))
