"""Local structure that the curve does not follow: a kink, or a feature narrower than its waves.

A polynomial that follows a curve leaves noise. What it leaves of a feature or a kink is local and
hardly correlates neighbours over the whole range, so each shape is held against the residuals by
itself: kinks and bumps of several widths at the temperature of every set, each less what the
polynomial takes of it. Rows that were left out count where their set agrees within itself: a
knocked turn disagrees with its partner, a feature of the gyro does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import stdtrit

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import MAD_TO_SIGMA, orthogonal_part, solve_by_qr, thin_qr

from .curve import CHECKED, chebyshev_columns
from .dataset import Array, Index, Mask, set_means, sets_with_bias
from .model import AxisProblem, Solved, Walk, squares_left
from .parameters import PUBLISHED_ORDER

CHANCE = 1e-3
"""How often noise alone makes a misfit of any shape, at most."""
WIDTHS = (0.6, 1.2, 2.4)
"""Of a bump, its standard deviation over the usual step of temperature from set to set."""
OWN_PART = 1e-3
"""Of a shape; what the polynomial follows to here shows nothing."""
AGREE = 5.0
"""Of the usual deviation of a set's bias from that of the sets around it."""
PERHAPS, BETTER = 0.0, 16.0
"""Of the information criterion: so much more a kink explains than the polynomial's waves do, that
it may be one and is in the uncertainty, and that it is one."""
KINKS = 0.25
"""Of curves that have a kink, before the data speak: a share of what it leaves goes into u."""
KINK_COLUMNS = 2
"""A kink counts for its size and its place."""
BY_BIAS = 2.0
LONE_SETS = 3
"""As many neighbouring sets of one turn each, all off in one sense, are no knocks."""
BESIDE, SHARE_BESIDE = 2.5, 0.06
"""Beside a turn that is off in a feature its neighbours are, too: by so many deviations of their
sum, and by so much of what it is off."""


@dataclass(frozen=True)
class Misfit:
    """What the curve does not follow: `size_ppm` is the largest that it leaves.

    Where it is not `sure` chance makes it now and then.
    `kink` says whether the slope changes at `at_degC`, by `slope_ppm_per_degC`; else it is a bump
    whose standard deviation is `width_degC`. `left_ppm` (n,) is what the curve leaves at the
    `CHECKED` even temperatures of its range.
    """

    sure: bool
    kink: bool
    at_degC: float
    width_degC: float
    slope_ppm_per_degC: float
    size_ppm: float
    left_ppm: Array


def misfit_of(
    problem: AxisProblem, solved: Solved, noise: float, freedom: float, bias_ppm: float = 0.0
) -> Misfit | None:
    """Return the shape that explains the residuals best, where noise alone seldom would; else None.

    `noise` is that of a turn in ppm, with its degrees of freedom; `bias_ppm` is what a bias that
    turns of one sense do not show may change by within its specification.
    """
    turns, order = problem.turns, solved.order
    rows = solved.kept | agreeing(problem, solved)
    own = rows & turns.sensing
    centres = np.unique(set_means(turns.set_number[own], turns.temperature_degC[own])[0])
    if noise <= 0.0 or freedom < 3.0 or len(centres) < 4:
        return None
    steps = np.diff(centres)
    widths = np.array(WIDTHS) * float(np.median(steps))
    walk = Walk(problem.turn_times.of(rows), solved.ratio)
    data = combine(walk.factor, problem.data[rows])
    highest = max(order, min(PUBLISHED_ORDER, problem.highest_order(rows)))
    design, biases = problem.design(solved.domain_degC, highest)
    design = walk.whiten(design[rows])
    shapes = _shapes(turns.temperature_degC[rows], centres, widths) * turns.turns[rows][:, None]
    shapes = walk.whiten(shapes)
    basis = thin_qr(design[:, : biases + order + 1])[0]
    left = orthogonal_part(basis, data)
    white = shapes - np.einsum("ij,jk->ik", basis, np.einsum("ij,ik->jk", basis, shapes))
    size, whole = np.einsum("ij,ij->j", white, white), np.einsum("ij,ij->j", shapes, shapes)
    resolved = size > OWN_PART**2 * whole
    along = np.where(resolved, np.einsum("ij,i->j", white, left), 0.0)
    score = np.abs(along) / np.sqrt(np.where(resolved, size, 1.0)) / noise
    best, sure, share = int(np.argmax(score)), True, 1.0
    if score[best] < -float(stdtrit(freedom, 0.5 * CHANCE / len(score))):
        kinks = shapes[:, : len(centres)]
        kink = _kink(design, biases, solved.order, kinks, data)
        if kink is None:
            return None
        best, order, gain = kink
        sure = gain >= BETTER
        share = 1.0 / (1.0 + (1.0 / KINKS - 1.0) * np.exp(-0.5 * gain))
    both = np.column_stack((design[:, : biases + order + 1], shapes[:, best]))
    better = solve_by_qr(both, data).coefficients
    amount = float(better[-1])
    grid = np.linspace(*solved.domain_degC, CHECKED)
    off = combine(chebyshev_columns(grid, solved.domain_degC, order), better[biases:-1])
    off = off + amount * _shapes(grid, centres, widths)[:, best] - solved.error_ppm(grid)
    largest = float(np.max(np.abs(off)))
    if largest <= BY_BIAS * bias_ppm:
        return None
    kind, place = divmod(best, len(centres))
    return Misfit(
        sure=sure,
        kink=kind == 0,
        at_degC=float(centres[place]),
        width_degC=0.0 if kind == 0 else float(widths[kind - 1]),
        slope_ppm_per_degC=amount if kind == 0 else 0.0,
        size_ppm=largest,
        left_ppm=np.abs(off) * np.sqrt(share),
    )


def _kink(
    whole: Array, biases: int, highest: int, kinks: Array, data: Array
) -> tuple[int, int, float] | None:
    """Return the kink, and the order beside it, that explain the data better than polynomials do.

    Also by how much. The polynomials are in `whole`, those up to `highest` stand beside kinks.
    A polynomial follows a kink by many waves, none of which stands out of the noise; by the
    information criterion one kink and a lower order say more. None where they do not.
    """
    rows = len(data)

    def criteria(columns: Array, first: int, more: int = 0) -> Array:
        """Return the criterion of the first columns from so many on; `more` count beside them."""
        square = np.maximum(squares_left(columns, data)[first - 1 :], 1e-300)
        count = np.arange(first, columns.shape[1] + 1) + more
        return np.asarray(rows * np.log(square / rows) + count * np.log(rows))

    smooth = float(criteria(whole, biases + 1).min())
    design, limit = whole[:, : biases + highest + 1], smooth - PERHAPS
    kink = None
    for place in range(kinks.shape[1]):
        if float(np.linalg.norm(kinks[:, place])) <= 0.0:
            continue
        ordered = np.column_stack((design[:, :biases], kinks[:, place], design[:, biases:]))
        # With its size a kink counts for its place.
        values = criteria(ordered, biases + 3, KINK_COLUMNS - 1)
        order = int(np.argmin(values)) if len(values) else 0
        if len(values) and values[order] < limit:
            limit = float(values[order])
            kink = (place, order + 1, smooth - limit)
    return kink


def _shapes(heat: Array, centres: Array, widths: Array) -> Array:
    """Return kinks, then bumps of each width, at all centres: (n, centres x (1 + widths))."""
    apart = heat[:, None] - centres[None, :]
    bumps = [np.exp(-0.5 * (apart / width) ** 2) for width in widths]
    return np.column_stack((np.maximum(apart, 0.0), *bumps))


def agreeing(problem: AxisProblem, solved: Solved) -> Mask:
    """Return the rows of sets with rejected turns that are off as a feature is, (rows,).

    Turns of both senses then say the same: they leave the bias of their set where the sets around
    have it. Turns of one sense are off together with their neighbours; a wait beside them says
    nothing of them.
    """
    turns, inside = problem.turns, problem.candidates
    agree = np.zeros(len(inside), dtype=bool)
    rejected = inside & turns.sensing & ~solved.kept
    if not bool(rejected.any()) or solved.noise <= 0.0:
        return agree
    if len(np.unique(np.sign(turns.turns[inside & turns.sensing]))) > 1:
        design, biases = problem.design(solved.domain_degC, solved.order)
        left = problem.data - design[:, biases:] @ solved.curve_ppm
        biased = list(sets_with_bias(turns, inside, left))
        bias = np.array([turn_set.bias_deg_per_h for turn_set in biased])
        off = np.abs(bias - _median_around(bias))
        calm = off <= AGREE * MAD_TO_SIGMA * float(np.median(off)) if len(off) else off
        for turn_set, same in zip(biased, calm, strict=True):
            agree[turn_set.rows] = bool(same) and bool(rejected[turn_set.rows].any())
        return agree
    noise = max(solved.noise, problem.floor_ppm)
    off = problem.deleted_residuals(solved) / noise * np.sign(turns.turns)
    sets = [
        np.flatnonzero(inside & turns.sensing & (turns.set_number == n))
        for n in np.unique(turns.set_number[inside & turns.sensing])
    ]
    sets.sort(key=lambda own: float(turns.temperature_degC[own].mean()))
    for first, last in _runs(sets, rejected, off):
        run = np.concatenate(sets[first:last])
        beside = [*sets[max(first - 1, 0) : first], *sets[last : last + 1]]
        agree[run] = last - first >= LONE_SETS or _supported(off[run], off, beside)
    return agree


def _supported(run: Array, off: Array, beside: list[Index]) -> bool:
    """Whether turns that are off have neighbours that are, too."""
    if not beside:
        return False
    near = float(np.mean(off[np.concatenate(beside)])) * float(np.sign(run.mean()))
    return near * np.sqrt(len(beside)) > BESIDE and near > SHARE_BESIDE * float(np.abs(run).max())


def _median_around(values: Array) -> Array:
    """Return the median of the three values on either side of each, itself left out, (n,)."""
    around = [np.r_[values[max(n - 3, 0) : n], values[n + 1 : n + 4]] for n in range(len(values))]
    return np.array([np.median(values) if len(values) else 0.0 for values in around])


def _runs(sets: list[Index], rejected: Mask, off: Array) -> list[tuple[int, int]]:
    """Return neighbouring sets that were all rejected and are off in one sense: from, until."""
    signs = [int(np.sign(off[own].sum())) if bool(rejected[own].all()) else 0 for own in sets]
    edges = [n for n in range(1, len(signs)) if signs[n] != signs[n - 1]]
    ends = [0, *edges, len(signs)]
    return [(a, b) for a, b in pairwise(ends) if signs[a] != 0]
