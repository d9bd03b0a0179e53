"""The best estimate for one axis: robust, bias and all, with an order that the data ask for."""

from __future__ import annotations

import numpy as np

from procedures.estimation.orthogonal import solve_by_qr

from .axis_problem import AxisProblem, Solved
from .axis_turns import AxisTurns
from .curve import Curve
from .findings import AnalysisSettings, AxisFit
from .gaps import gaps_of, unknown_in_gaps_ppm, unseen_orders_ppm
from .misfit import misfit_of
from .rejection import reject
from .sets import noise_of_sets
from .turning import SECONDS_PER_HOUR

LEAST_NOISE = 0.5
"""Of what is called noise at least: readings that all round alike have none, and are not exact."""


def fit_axis(
    turns: AxisTurns,
    settings: AnalysisSettings,
    floor_ppm: float = 0.0,
    gyro_bias_deg_per_h: float = 0.0,
) -> AxisFit:
    """Return the model of one axis; `floor_ppm` is the least deviation that is called noise.

    `gyro_bias_deg_per_h` is what the bias may change by where turns of one sense cannot tell it.
    """
    problem = AxisProblem(turns, settings, floor_ppm)
    kept, solved = reject(problem)
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
    noise = max(noise, LEAST_NOISE * floor_ppm)
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
    unseen = unseen_orders_ppm(problem, kept, solved, noise)
    if bool(unseen.any()):
        curve = curve.checked(unseen)
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
