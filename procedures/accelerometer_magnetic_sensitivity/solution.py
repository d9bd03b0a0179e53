"""The full-data weighted solution: coefficients and nuisance terms together, wild rows rejected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import ndtr, stdtrit

from procedures.estimation.alternatives import Alternative
from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import (
    choose_by_information,
    keep_inliers,
    solve_by_qr,
    solve_square,
    thin_qr,
)
from procedures.estimation.slow_terms import DRIFT, apart, candidates, likelihoods, stacked

from .causes import causes_to_try, known_causes, placed_step, rests_on_one, with_doubt
from .dataset import Rows
from .model import model_columns
from .nuisances import (
    ANGLES,
    ARCSEC_PER_RAD,
    ENCODER_JUMP,
    JUMP,
    ROUNDS,
    TurnedModel,
    chosen,
    separable,
    slow_terms,
)
from .parameters import AnalysisSettings
from .solved import FEWEST_OF_A_GROUP, Solution, Solved, misfit, uneven, with_misfit

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SETTLED_RAD = 1e-10
ENOUGH_LEFT = 12
MAX_MOVES = 3
"""Of a step, each time to where it fits all rows best."""
MAX_JUMP_RAD = np.pi
"""An angle is known but for whole turns; what is further off than half of one is no jump."""
FAR_RAD, FINE_RAD = 0.2, 1e-6
"""How far a jump that is misalignment to the first order is looked for, and how finely."""


def solve_rows(rows: Rows, kept_names: tuple[str, ...], settings: AnalysisSettings) -> Solution:
    """Solve for the kept coefficients and the nuisance terms that the rows tell from them.

    Needs more rows than kept coefficients. Encoder offset and misalignment are in the model
    wherever they are independent of the kept columns; temperature and drift where the information
    criterion asks for them; a cause beside the model, such as a jump of the encoder, where the
    model follows the rows badly without it and well with it.
    """
    solved = _best_of(rows, kept_names, settings)
    noise = uneven(rows, solved.solution) if rows.noise_group is None else None
    if noise is not None:
        weight = float(np.median(noise.noise_V)) / noise.noise_V[noise.group]
        rows = replace(rows, noise_group=noise.group, root_weight=weight)
        solved = _best_of(rows, kept_names, settings)
    return replace(with_misfit(solved.solution), uneven=noise)


def _best_of(rows: Rows, kept_names: tuple[str, ...], settings: AnalysisSettings) -> Solved:
    """Return the best of the solutions with no, or one, cause beside the model."""
    first = _solve(rows, kept_names, settings)
    known = known_causes(rows, first.acceleration_g, first.model.coefficients)
    causes = causes_to_try(first, rows, known)
    # A step is put in its place before it is compared: in a wrong one a drift looks likelier.
    others = (_placed(rows, kept_names, settings, cause) for cause in causes)
    taken = (
        other
        for other in others
        if abs(other.solution.jump_rad) < MAX_JUMP_RAD and not rests_on_one(other)
    )
    best = _likeliest([first, *taken], rows)
    mean = averaged(best, rows)
    # An average may leave so much that what groups share is hidden, or leave more of it.
    shared = (misfit(best, rows.groups), misfit(mean, rows.groups))
    worst = max(filter(None, shared), key=lambda misfit: misfit.ratio, default=None)
    mean = replace(mean, solution=replace(mean.solution, misfit=worst))
    return with_doubt(mean, rows, known)


def _placed(
    rows: Rows, kept_names: tuple[str, ...], settings: AnalysisSettings, cause: Alternative
) -> Solved:
    """Solve with a cause, a step moved for as long as that is likelier."""
    solved = _solve(rows, kept_names, settings, cause)
    for _ in range(MAX_MOVES):
        step = placed_step(solved, rows, settings.outlier)
        if step is None:
            break
        moved = _solve(rows, kept_names, settings, step)
        if not rests_on_one(solved) and _likeliest((solved, moved), rows) is solved:
            break
        solved = moved
    return solved


def _likeliest(tried: Sequence[Solved], rows: Rows) -> Solved:
    """Return the solution with the best information criterion."""
    squares = [solved.solution.sum_of_squares for solved in tried]
    prices = [solved.solution.price for solved in tried]
    return tried[choose_by_information(squares, prices, len(rows.time_s))]


def _solve(
    rows: Rows,
    kept_names: tuple[str, ...],
    settings: AnalysisSettings,
    cause: Alternative | None = None,
) -> Solved:
    """Solve with the columns of a cause, or with the encoder off in its rows."""
    model, data = TurnedModel(rows, kept_names, cause), rows.output_V
    whole = np.ones(len(data), dtype=bool)
    angles: dict[str, float] = {}
    names, start = model.fixed(model.correction_rad(angles), whole)
    if cause is not None and cause.code == ENCODER_JUMP:
        angles = {JUMP: 0.0 if JUMP in names else _jump_rad(model)}
        angles = model.without_large_angles(angles, whole)
        _, start = model.fixed(model.correction_rad(angles))
    inside = keep_inliers(start, data, far(start, settings.outlier), rows.root_weight)
    model.guess(solve_by_qr(start[inside], data[inside]).coefficients)
    model.fixed(model.correction_rad(angles), inside)
    angles = model.without_large_angles(angles, inside)
    fixed_names, fixed = model.fixed(model.correction_rad(angles))
    room = max(0, (len(data) - fixed.shape[1]) // 6)
    order = min(settings.max_drift_order, room)
    # A drift that too few rows could fit is in the uncertainty.
    slow = slow_terms(rows, max(order, min(settings.max_drift_order, 1)))
    fitted = {name: slow[name] for name in slow if order or not name.startswith(DRIFT)}
    usable = separable(fixed, fitted, whole)
    design = np.column_stack((fixed, stacked(usable, len(data))))
    inside = keep_inliers(design, data, far(design, settings.outlier), rows.root_weight)
    usable = separable(fixed, usable, inside)
    weight = group_weights(rows, np.column_stack((fixed, stacked(usable, len(data)))), inside)
    terms = chosen(fixed, data, usable, inside, weight)
    columns = stacked(terms, len(data))
    # A jump that is misalignment to the first order cannot be solved for: its angle stays.
    turned = [name for name in ANGLES if name in fixed_names]
    kept = inside
    for n in range(ROUNDS):
        _, fixed = model.fixed(model.correction_rad(angles))
        design = np.column_stack((fixed, columns))
        threshold = far(design, settings.outlier)
        kept = keep_inliers(design, data, threshold, weight) if n < 3 else kept
        fit = solve_by_qr(design[kept], data[kept], weight[kept])
        model.guess(fit.coefficients)
        steps = {name: float(fit.coefficients[fixed_names.index(name)]) for name in turned}
        angles |= {name: angles.get(name, 0.0) + step for name, step in steps.items()}
        if all(abs(step) < SETTLED_RAD for step in steps.values()) and (n or not turned):
            break
    names = (*fixed_names, *terms)
    freedom = int(kept.sum()) - design.shape[1]
    variance = fit.sum_of_squares / freedom if freedom > 0 else float("nan")
    values = [angles.get(name, b) for name, b in zip(names, fit.coefficients, strict=True)]
    factor = np.where(np.isin(names, ANGLES), ARCSEC_PER_RAD, 1.0)
    turned_g = rows.accelerations(model.correction_rad(angles))
    solution = Solution(
        names=names,
        coefficients=np.array(values) * factor,
        covariance=variance * fit.inverse_normal * np.outer(factor, factor),
        kept=kept,
        residual_V=data - combine(design, fit.coefficients),
        degrees_of_freedom=freedom,
        noise_V=float(np.sqrt(variance)),
        condition=fit.condition,
        not_separable=(*model.not_separable, *(name for name in slow if name not in usable)),
        folded=model.folded,
        cause=cause,
        jump_rad=angles.get(JUMP, 0.0),
        shares=np.zeros((0, 0)),
        drift_order=sum(name.startswith(DRIFT) for name in terms),
        sum_of_squares=fit.sum_of_squares,
    )
    return Solved(solution, design, model.slope, columns, turned_g, model, slow, usable, weight)


def averaged(solved: Solved, rows: Rows) -> Solved:
    """Return the average of the solutions with each of the candidates of temperature and drift.

    Each weighs by exp(-IC/2), and the covariance holds how far they lie apart. Of the terms those
    are named that more likely are there than not.
    """
    first, usable, kept = solved.solution, solved.usable, solved.solution.kept
    count, still = int(kept.sum()), solved.design.shape[1] - solved.slow.shape[1]
    design = np.column_stack((solved.design[:, :still], stacked(usable, len(kept))))
    names, models = (*first.names[:still], *usable), candidates(design[:, :still], usable, kept)
    places = [[n for n, name in enumerate(names) if n < still or name in m] for m in models]
    # What any of them is, and leaves, is in the triangle of all columns.
    root, scale = solved.root_weight[kept, None], np.linalg.norm(design[kept], axis=0)
    q, triangle = thin_qr(design[kept] / scale * root)
    model = model_columns(solved.acceleration_g, rows.field_T)
    known = np.column_stack((rows.output_V, model))[kept] * root
    right = cross(q, known)
    beyond = float(np.sum((known[:, 0] - combine(q, right[:, 0])) ** 2))
    each, covariances, squares = [], [], []
    for terms, taken in zip(models, places, strict=True):
        rotated, own = thin_qr(triangle[:, taken])
        back = np.zeros((len(names), len(names)))
        back[taken] = solve_square(own, rotated.T)
        left = right[:, 0] - combine(triangle, combine(back, right[:, 0]))
        squares.append(max(float(left @ left) + beyond, np.finfo(np.float64).tiny))
        unfitted = solved.model.unfitted(solved.terms, usable, terms, kept) * root
        moved = back @ cross(q, unfitted)
        variance = squares[-1] / max(count - len(taken), 1)
        each.append(back @ right)
        covariances.append(variance * back @ back.T + moved @ moved.T)
    share = likelihoods(squares, models, count, count - max(map(len, places)))
    mean = np.einsum("n,nij->ij", share, each)
    covariance = np.einsum("n,nij->ij", share, covariances)
    covariance += apart(share, np.array(each)[:, :, 0])
    factor = np.where(np.isin(names, ANGLES), ARCSEC_PER_RAD, 1.0) / scale
    # An angle is what the design was turned by, and what is left of it.
    turned = np.where(np.isin(names[:still], ANGLES), first.coefficients[:still], 0.0)
    likely = [n for n in range(len(names)) if share @ [n in taken for taken in places] > 0.5]
    solution = replace(
        first,
        names=tuple(names[n] for n in likely),
        coefficients=(mean[:, 0] * factor + np.append(turned, np.zeros(len(usable))))[likely],
        covariance=(covariance * np.outer(factor, factor))[np.ix_(likely, likely)],
        residual_V=rows.output_V - combine(design, mean[:, 0] / scale),
        shares=(mean[:, 1:] / scale[:, None])[likely],
    )
    design = design[:, likely]
    return replace(solved, solution=solution, design=design, slow=design[:, still:])


def cross(columns: Array, data: Array) -> Array:
    """Return X'Y for columns X (n, k) and data Y (n, m), by one core."""
    return np.asarray(np.einsum("ij,im->jm", columns, data))


def _jump_rad(model: TurnedModel) -> float:
    """Return the angle of a jump that leaves the smallest squares of all rows."""

    def squares(jump_rad: float) -> float:
        _, design = model.fixed(model.correction_rad({JUMP: jump_rad}))
        return solve_by_qr(design, model.rows.output_V).sum_of_squares

    options = {"xatol": FINE_RAD}
    lowest = minimize_scalar(squares, bounds=(-FAR_RAD, FAR_RAD), method="bounded", options=options)
    return float(lowest.x)


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
