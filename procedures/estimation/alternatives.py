"""What else may have moved an output: alternatives to a model, all held to one score test.

An alternative is columns beside a design, with the code and the words of its flag. Each is held
against what a solution left: by how much the squares fall, and how seldom noise alone makes them
fall so far (F test). `places` is the account of how many were tried to find one: a step is looked
for at every row. One that is rarer than `RARE` is worth solving for, and an information criterion
then decides; one that is `DOUBTFUL` stays out of the model, and what it would change widens u.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, ndtr

from .linear import combine
from .orthogonal import independent_of, project, solve_by_qr, thin_qr

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RARE = 2.0 * float(ndtr(-4.5))
"""As seldom as this noise may look so much like an alternative that it is tried."""
DOUBTFUL = 2.0 * float(ndtr(-3.0))
MIN_PART = 1e-2
"""A column with less of its own takes the place of the coefficients it resembles."""
SEARCHED = 3
"""As many columns as a place that was searched for counts for: among many one always explains."""
FEWEST_LEFT = 6
MAX_TRIED = 2
MAX_ROWS = 2000
"""No line is looked for in a longer record: memory grows with the square."""
SLOWEST_CYCLES = 4.5
"""What is slower in the record is drift."""


@dataclass(frozen=True)
class Alternative:
    """The code of its flag, what it is, and the columns (n, m) it adds, of coefficients in `unit`.

    `row` is where it begins, None where it lasts. `places` is how many columns it counts for
    beside its own: as many as were tried to find it explain something by themselves.
    """

    code: str
    what: str
    unit: str
    columns: Array
    row: int | None = None
    places: int = 1

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its terms beside the coefficients."""
        count = self.columns.shape[1]
        return tuple(f"{self.code} {n}" if n else self.code for n in range(count))


@dataclass(frozen=True)
class Score:
    """How seldom noise explains as much as an alternative, and by how much the squares fall."""

    chance: float
    gain: float
    alternative: Alternative


Search = Callable[[Array, Array, Mask], Iterable[tuple[float, Alternative]]]
"""Of a design (n, k), what it left (n,), both zero outside of the rows that count, and these (n,):
the best of a family of alternatives, each with its gain."""


def scores(
    design: Array,
    data: Array,
    inside: Mask,
    alternatives: Sequence[Alternative],
    searches: Sequence[Search] = (),
) -> list[Score]:
    """Return the score of each alternative and of the best of each search.

    `design` (n, k) and `data` (n,) are over their noise, or of equal noise; only rows `inside` (n,)
    count. None where these leave too few degrees of freedom.
    """
    free = int(inside.sum()) - design.shape[1]
    if free < FEWEST_LEFT:
        return []
    fit = solve_by_qr(design[inside], data[inside])
    residual = (data - combine(design, fit.coefficients)) * inside
    counted = design * inside[:, None]
    tried = [explained(alternative, counted, residual, inside) for alternative in alternatives]
    for search in searches:
        tried += search(counted, residual, inside)
    rated = []
    for gain, alternative in tried:
        width = alternative.columns.shape[1]
        if width:
            rest = max(float(residual @ residual) - gain, 1e-300) / (free - width)
            chance = float(fdtrc(width, free - width, gain / width / rest))
            rated.append(Score(chance, gain, alternative))
    return rated


def explained(
    alternative: Alternative, design: Array, residual: Array, inside: Mask
) -> tuple[float, Alternative]:
    """Return by how much the squares fall with an alternative, and it with what is its own."""
    own = independent_of(design, alternative.columns * inside[:, None], MIN_PART)
    columns = alternative.columns[:, list(own)]
    q = thin_qr(np.column_stack((design, columns * inside[:, None])))[0][:, design.shape[1] :]
    return float(np.sum(project(q, residual) ** 2)), replace(alternative, columns=columns)


def worth_trying(rated: Sequence[Score]) -> list[Alternative]:
    """Return the likeliest alternatives that noise hardly explains, at most `MAX_TRIED`."""
    rare = sorted((s for s in rated if s.chance < RARE), key=lambda s: (s.chance, -s.gain))
    return [score.alternative for score in rare[:MAX_TRIED]]


def doubt(design: Array, data: Array, inside: Mask, rated: Sequence[Score], u: Array) -> Array:
    """Return what the coefficients (k,) would change by an alternative that noise may imitate.

    Of those that are likely it is the one that would change a coefficient most, in standard
    uncertainties `u` (k,); zeros where none is. It counts as one standard uncertainty more.
    """
    width, rows = design.shape[1], len(data)
    plain: Array | None = None
    moves = []
    for score in rated:
        places = rows if score.alternative.places > 1 else 1
        if score.chance * places < DOUBTFUL:
            if plain is None:
                plain = solve_by_qr(design[inside], data[inside]).coefficients
            both = np.column_stack((design, score.alternative.columns))[inside]
            moves.append(solve_by_qr(both, data[inside]).coefficients[:width] - plain)
    return max(moves, key=lambda move: float(np.max(np.abs(move / u))), default=np.zeros(width))


def strongest_line(
    time_s: Array, design: Array, residual: Array, inside: Mask, unit: str
) -> list[tuple[float, Alternative]]:
    """Return the strongest line in what a solution left, none where rows are too few."""
    count = len(residual)
    spacing_s = float(np.median(np.diff(time_s)))
    span = float(time_s[-1] - time_s[0]) / spacing_s
    cycles = np.arange(SLOWEST_CYCLES, 0.5 * span, 0.5) / span
    if not len(cycles) or spacing_s <= 0.0 or max(count, len(cycles)) > MAX_ROWS:
        return []
    phase = 2.0 * np.pi * np.outer((time_s - time_s[0]) / spacing_s, cycles)
    waves = np.stack((np.cos(phase), np.sin(phase)))
    q = thin_qr(design)[0]
    own = waves * inside[:, None]
    own = own - np.einsum("nk,akc->anc", q, np.einsum("nk,anc->akc", q, own))
    (cc, ss), cs = np.einsum("anc,anc->ac", own, own), np.einsum("nc,nc->c", *own)
    cr, sr = np.einsum("anc,n->ac", own, residual)
    determinant = cc * ss - cs**2
    determined = determinant > (MIN_PART * count) ** 2
    gains = (ss * cr**2 - 2.0 * cs * cr * sr + cc * sr**2) / np.where(determined, determinant, 1.0)
    best = int(np.argmax(np.where(determined, gains, 0.0)))
    if not determined[best]:
        return []
    what = f"{spacing_s / cycles[best]:.4g} s"
    line = Alternative("periodic", what, unit, waves[:, :, best].T, None, SEARCHED)
    return [(float(gains[best]), line)]
