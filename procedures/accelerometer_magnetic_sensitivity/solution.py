"""The full-data weighted solution: coefficients and nuisance terms together, wild rows rejected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from procedures.estimation.alternatives import Alternative
from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import (
    OrthogonalFit,
    choose_by_information,
    keep_inliers,
    solve_by_qr,
)

from .causes import causes_to_try, known_causes, with_doubt
from .dataset import Rows
from .jump import Suspects, find_jumps, may_be_off
from .model import model_columns
from .nuisances import ARCSEC_PER_RAD, OFFSET, ROUNDS, TurnedModel, chosen, separable, slow_terms
from .parameters import AnalysisSettings
from .solved import JUMP, Jump, Solution, Solved, uneven, with_misfit

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SETTLED_RAD = 1e-10
FEWEST_OF_A_GROUP = 20
ENOUGH_LEFT = 12
ANGLES = (OFFSET, JUMP)


def solve_rows(rows: Rows, kept_names: tuple[str, ...], settings: AnalysisSettings) -> Solution:
    """Solve for the kept coefficients and the nuisance terms that the rows tell from them.

    Needs more rows than kept coefficients. Encoder offset and misalignment are in the model
    wherever they are independent of the kept columns; temperature and drift where the information
    criterion asks for them; a jump of the encoder where the model follows the rows badly without
    it and well with it.
    """
    solved = _best_of(rows, kept_names, settings)
    noise = uneven(rows, solved.solution) if rows.noise_group is None else None
    if noise is not None:
        weight = float(np.median(noise.noise_V)) / noise.noise_V[noise.group]
        rows = replace(rows, noise_group=noise.group, root_weight=weight)
        solved = _best_of(rows, kept_names, settings)
    kept = solved.solution.kept
    columns = model_columns(solved.acceleration_g, rows.field_T)[kept]
    scale = np.linalg.norm(solved.design[kept], axis=0)
    shares = np.linalg.lstsq(solved.design[kept] / scale, columns, rcond=None)[0] / scale[:, None]
    return replace(with_misfit(solved, rows.groups), uneven=noise, shares=shares)


def _best_of(rows: Rows, kept_names: tuple[str, ...], settings: AnalysisSettings) -> Solved:
    """Return the best of the solutions with no, or one, cause beside the model."""
    first = _solve(rows, kept_names, settings)
    plain = first.solution
    suspects = Suspects.of(rows.plane, rows.theta_rad)
    model = TurnedModel(rows, kept_names)
    whole = np.ones(len(rows.time_s), dtype=bool)
    solutions = [first]
    known = known_causes(rows, first.acceleration_g, first.model_coefficients)
    causes = causes_to_try(first, rows, suspects, known)
    solutions += [_solve(rows, kept_names, settings, cause=cause) for cause in causes]
    if OFFSET not in plain.names or not may_be_off(first, rows.output_V, suspects, settings):
        return with_doubt(_best(solutions, len(whole)), rows, suspects, known)
    tried = set()
    for slow in (first.slow[:, :0], first.slow) if first.slow.shape[1] else (first.slow,):

        def columns_at(added_rad: Array, slow: Array = slow) -> Array:
            return np.column_stack((model.with_misalignment(added_rad), slow))

        for inside in (whole, plain.kept):
            for jump in find_jumps(suspects, columns_at, first.slope, rows.output_V, inside):
                if jump.rows.tobytes() not in tried:
                    tried.add(jump.rows.tobytes())
                    solutions.append(_solve(rows, kept_names, settings, jump))
    return with_doubt(_best(solutions, len(whole)), rows, suspects, known)


def _best(solutions: list[Solved], rows: int) -> Solved:
    """Return the solution that the information criterion prefers."""
    squares = [candidate.solution.sum_of_squares for candidate in solutions]
    prices = [candidate.solution.price for candidate in solutions]
    return solutions[choose_by_information(squares, prices, rows)]


def _solve(
    rows: Rows,
    kept_names: tuple[str, ...],
    settings: AnalysisSettings,
    jump: Jump | None = None,
    cause: Alternative | None = None,
) -> Solved:
    """Solve with the encoder off in the rows of a jump, which begins at the jump's angle.

    Or with the columns of another cause.
    """
    model = TurnedModel(rows, kept_names, None if jump is None else jump.rows, cause)
    angles = {} if jump is None else {JUMP: jump.angle_rad}
    begin, data = model.correction_rad(angles), rows.output_V
    start = model.with_misalignment(begin)
    inside = keep_inliers(start, data, far(start, settings.outlier), rows.root_weight)
    model.guess(solve_by_qr(start[inside], data[inside]).coefficients)
    begin = model.without_large_offset(begin, inside)
    fixed_names, fixed = model.fixed(begin)
    room = max(0, (len(data) - fixed.shape[1]) // 6)
    slow = slow_terms(
        rows.time_s,
        rows.temperature_degC,
        rows.accelerations()[:, 0],
        min(settings.max_drift_order, room),
    )
    usable = separable(fixed, slow, np.ones(len(data), dtype=bool))
    whole = np.column_stack((fixed, usable.columns))
    inside = keep_inliers(whole, data, far(whole, settings.outlier), rows.root_weight)
    usable = separable(fixed, usable, inside)
    weight = group_weights(rows, np.column_stack((fixed, usable.columns)), inside)
    terms = usable.only(chosen(fixed, data, usable, inside, weight))
    # A jump that is misalignment to the first order cannot be solved for: its angle stays.
    turned = [name for name in ANGLES if name in fixed_names]
    if OFFSET in turned:
        angles[OFFSET] = float((begin - model.correction_rad(angles))[0])
    kept = inside
    for n in range(ROUNDS):
        _, fixed = model.fixed(model.correction_rad(angles))
        design = np.column_stack((fixed, terms.columns))
        threshold = far(design, settings.outlier)
        kept = keep_inliers(design, data, threshold, weight) if n < 3 else kept
        fit = solve_by_qr(design[kept], data[kept], weight[kept])
        model.guess(fit.coefficients)
        steps = {name: float(fit.coefficients[fixed_names.index(name)]) for name in turned}
        angles |= {name: angles[name] + steps[name] for name in turned}
        if all(abs(step) < SETTLED_RAD for step in steps.values()) and (n or not turned):
            break
    lost = tuple(name for name in slow.names if name not in usable.names)
    names = (*fixed_names, *terms.names)
    warmth = model.unfitted_warmth(usable, terms.names, kept) * weight[kept, None] ** 2
    solved_rad = {name: angles[name] for name in turned}
    if jump is not None:
        jump = replace(jump, angle_rad=angles[JUMP])
    solution = _solution(model, design, data, fit, kept, names, solved_rad, lost, warmth, jump)
    solution = replace(solution, cause=cause)
    turned_g = rows.accelerations(model.correction_rad(angles))
    return Solved(solution, design, model.slope, terms.columns, turned_g, model.coefficients)


def far(design: Array, sigmas: float) -> float:
    """Return beyond how many robust standard deviations a row is wild, `sigmas` for many rows.

    Few rows tell their own noise badly: as seldom as a normal deviate lies beyond `sigmas`, one of
    Student's t with the rows left over lies beyond this.
    """
    left = max(design.shape[0] - design.shape[1], 1)
    return sigmas if left >= ENOUGH_LEFT else float(-stdtrit(left, ndtr(-sigmas)))


def group_weights(rows: Rows, design: Array, kept: Mask) -> Array:
    """Return one over the noise of each row's group, relative to all; ones without groups.

    The noise of a group is that of its own residuals where there are enough of them.
    """
    weight = np.ones(len(kept)) if rows.root_weight is None else rows.root_weight.copy()
    if rows.noise_group is None or len(np.unique(rows.noise_group)) < 2:
        return weight
    for _ in range(3):
        fit = solve_by_qr(design[kept], rows.output_V[kept], weight[kept])
        left = (rows.output_V - combine(design, fit.coefficients))[kept]
        share = np.maximum(1.0 - fit.leverage, 1e-6)
        group = rows.noise_group[kept]
        for label in np.unique(group):
            inside = group == label
            if int(inside.sum()) >= FEWEST_OF_A_GROUP:
                variance = float(np.sum(left[inside] ** 2) / np.sum(share[inside]))
                weight[rows.noise_group == label] = 1.0 / np.sqrt(max(variance, 1e-300))
        unknown = ~np.isin(rows.noise_group, group) | (weight == 1.0)
        known = weight[~unknown]
        weight[unknown] = float(np.median(known)) if len(known) else 1.0
    return np.asarray(weight / float(np.median(weight)))


def _solution(
    model: TurnedModel,
    design: Array,
    data: Array,
    fit: OrthogonalFit,
    kept: Mask,
    names: tuple[str, ...],
    angles: Mapping[str, float],
    lost: tuple[str, ...],
    warmth: Array,
    jump: Jump | None,
) -> Solution:
    freedom = int(kept.sum()) - design.shape[1]
    variance = fit.sum_of_squares / freedom if freedom > 0 else float("nan")
    moved = fit.inverse_normal @ design[kept].T @ warmth
    coefficients, factor = fit.coefficients.copy(), np.ones(len(names))
    for name, angle_rad in angles.items():
        place = names.index(name)
        coefficients[place] = angle_rad * ARCSEC_PER_RAD
        factor[place] = ARCSEC_PER_RAD
    return Solution(
        names=names,
        coefficients=coefficients,
        covariance=(variance * fit.inverse_normal + moved @ moved.T) * np.outer(factor, factor),
        kept=kept,
        residual_V=data - combine(design, fit.coefficients),
        degrees_of_freedom=freedom,
        noise_V=float(np.sqrt(variance)),
        condition=fit.condition,
        not_separable=(*model.not_separable, *lost),
        jump=jump,
        folded=model.folded,
    )
