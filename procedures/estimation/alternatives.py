"""What else may have moved an output: alternatives to a model, all held to one score test.

An alternative is columns beside a design, with the code and the words of its flag. Each is held
against what a solution left: by how much the squares fall, and how seldom noise alone makes them
fall so far (F test). `places` is the account of how many were tried to find one: a step is looked
for at every row. One that is rarer than `RARE` is worth solving for, and an information criterion
then decides; one that is `DOUBTFUL` stays out of the model, and what it would change widens u.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, ndtr

from station.findings import Flag

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
RIVAL = 10.0
"""Of the information criterion: less than 150 times as likely is no proof."""
FEWEST_LEFT = 6
MAX_TRIED = 2
BESIDE_STEP = 3
"""Rows before a step, and after it."""
MAX_ROWS = 2000
"""No line is looked for in a longer record: memory grows with the square."""
SLOWEST_CYCLES = 4.5
"""What is slower in the record is drift."""


@dataclass(frozen=True)
class Alternative:
    """The code of its flag, what it is, and the columns (n, m) it adds, of coefficients in `unit`.

    `row` is where it begins, None where it lasts. `places` is how many columns it counts for
    beside its own: as many as were tried to find it explain something by themselves. `sentence` is
    that of its flag, with `{what}`, `{unit}`, `{first}`, its first coefficient, and `{size}`, the
    largest change of the output that it makes over the rows.
    """

    code: str
    what: str
    unit: str
    columns: Array
    row: int | None = None
    places: int = 1
    sentence: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its terms beside the coefficients."""
        count = self.columns.shape[1]
        return tuple(f"{self.code} {n}" if n else self.code for n in range(count))

    def flag(self, terms: Array, details: Mapping[str, object]) -> Flag:
        """Return its flag where it was solved for, with the coefficients `terms` (m,)."""
        size, first = float(np.ptp(combine(self.columns, terms))), float(terms[0])
        text = self.sentence.format(what=self.what, unit=self.unit, first=first, size=size)
        return Flag(self.code, text, None, {"what": self.what, "size": size, **details})


@dataclass(frozen=True)
class Score:
    """How seldom noise explains as much as an alternative, and by how much the squares fall."""

    chance: float
    gain: float
    alternative: Alternative


Search = Callable[[Array, Array, Mask], Iterable[tuple[float, Alternative]]]
"""Of a design (n, k), what it left (n,), both zero outside of the rows that count, and these (n,):
the best of a family of alternatives, each with its gain. Rows after the last of the data are what
is known of the coefficients beforehand; no alternative has anything there."""


def scores(
    design: Array,
    data: Array,
    inside: Mask,
    alternatives: Sequence[Alternative],
    searches: Sequence[Search] = (),
) -> list[Score]:
    """Return the score of each alternative and of the best of each search.

    `design` (n, k) and `data` (n,) are over their noise, or of equal noise; only rows `inside` (n,)
    count. Columns of alternatives may be shorter: the last rows are then what is known beforehand.
    None where these leave too few degrees of freedom.
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
    columns = as_long_as(design, alternative.columns) * inside[:, None]
    own = list(independent_of(design, columns, MIN_PART))
    q = thin_qr(np.column_stack((design, columns[:, own])))[0][:, design.shape[1] :]
    gain = float(np.sum(project(q, residual) ** 2))
    return gain, replace(alternative, columns=alternative.columns[:, own])


def as_long_as(design: Array, columns: Array) -> Array:
    """Return columns (n, m) with zeros in the rows of a design (n + k, p) that they do not have."""
    more = len(design) - len(columns)
    return np.vstack((columns, np.zeros((more, columns.shape[1])))) if more else columns


def worth_trying(rated: Sequence[Score], at_most: int = MAX_TRIED) -> list[Alternative]:
    """Return the likeliest alternatives that noise hardly explains."""
    rare = sorted((s for s in rated if s.chance < RARE), key=lambda s: (s.chance, -s.gain))
    return [score.alternative for score in rare[:at_most]]


def farthest(values: Sequence[float], solutions: Sequence[Array], u: Array) -> Array:
    """Return how far coefficients (k,) lie apart that the data tell hardly from the best ones.

    `values` are the information criteria of the `solutions`, each (k,). Of those within `RIVAL` of
    the lowest it is the one farthest from the best in standard uncertainties `u` (k,): two causes
    of one shape move a coefficient by their own amounts, and nothing says which it was.
    """
    best = int(np.argmin(values))
    rivals = [s for v, s in zip(values, solutions, strict=True) if v - values[best] < RIVAL]
    moves = [rival - solutions[best] for rival in rivals]
    return max(moves, key=lambda move: float(np.max(np.abs(move / u))))


def doubt(design: Array, data: Array, inside: Mask, rated: Sequence[Score], u: Array) -> Array:
    """Return what the first coefficients (k,) would change by one that noise may imitate.

    Of those that are likely it is the one that would change a coefficient most, in standard
    uncertainties `u` (k,); zeros where none is. It counts as one standard uncertainty more.
    """
    width, rows = len(u), len(data)
    plain: Array | None = None
    moves = []
    for score in rated:
        places = rows if score.alternative.places > 1 else 1
        if score.chance * places < DOUBTFUL:
            if plain is None:
                plain = solve_by_qr(design[inside], data[inside]).coefficients[:width]
            columns = as_long_as(design, score.alternative.columns)
            both = np.column_stack((design, columns))[inside]
            moves.append(solve_by_qr(both, data[inside]).coefficients[:width] - plain)
    return max(moves, key=lambda move: float(np.max(np.abs(move / u))), default=np.zeros(width))


def from_each_row(values: Array) -> Array:
    """Return the sums of values (n, ...) from each row on."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])


def gains_of_parts(
    shape: Array,
    design: Array,
    residual: Array,
    sums: Callable[[Array], Array],
    part: float = MIN_PART,
) -> Array:
    """Return by how much the squares fall with a `shape` (n,) in each of many parts of the rows.

    `sums` gives the sums of values (n, ...) over the rows of each part. Of a shape that has less
    than `part` of its own there nothing falls. Shape and residual are zero in rows that do not
    count.
    """
    q = thin_qr(design)[0][: len(shape)]
    shared, whole = sums(q * shape[:, None]), sums(shape**2)
    own = whole - np.einsum("ij,ij->i", shared, shared)
    determined = own > part**2 * whole
    return np.where(determined, sums(shape * residual) ** 2, 0.0) / np.where(determined, own, 1.0)


def strongest_step(
    shape: Array, design: Array, residual: Array, inside: Mask, step: Alternative, may: Mask
) -> list[tuple[float, Alternative]]:
    """Return the best step of a `shape` (n,), of zero mean over the rows, none where none is.

    `step` says what it is; its columns and its row are filled in. It `may` (n,) begin in some rows.
    """
    inside, residual = inside[: len(shape)], residual[: len(shape)]
    rows = np.flatnonzero(inside)
    begins = rows[BESIDE_STEP : len(rows) - BESIDE_STEP + 1]
    begins = begins[may[begins]]
    gains = gains_of_parts(shape * inside, design, residual, from_each_row)[begins]
    if not np.any(gains):
        return []
    begin = int(begins[np.argmax(gains)])
    from_row = (np.arange(len(shape)) >= begin).astype(np.float64)
    columns = (shape * (from_row - from_row.mean()))[:, None]
    return [(float(gains.max()), replace(step, columns=columns, row=begin))]


def strongest_line(
    time_s: Array, design: Array, residual: Array, inside: Mask, unit: str, finer: int = 1
) -> list[tuple[float, Alternative]]:
    """Return the strongest line in what a solution left, none where rows are too few.

    Of `finer` periods about the best one: an odd number.
    """
    count = len(time_s)
    inside, residual = inside[:count], residual[:count]
    spacing_s = float(np.median(np.diff(time_s)))
    span = float(time_s[-1] - time_s[0]) / spacing_s
    cycles = np.arange(SLOWEST_CYCLES, 0.5 * span, 0.5) / span
    if not len(cycles) or spacing_s <= 0.0 or max(count, len(cycles)) > MAX_ROWS:
        return []
    q = thin_qr(design)[0][:count]
    turns = (time_s - time_s[0]) / spacing_s

    def gains_at(cycles: Array) -> tuple[Array, Array]:
        phase = 2.0 * np.pi * np.outer(turns, cycles)
        waves = np.stack((np.cos(phase), np.sin(phase)))
        own = waves * inside[:, None]
        own = own - np.einsum("nk,akc->anc", q, np.einsum("nk,anc->akc", q, own))
        (cc, ss), cs = np.einsum("anc,anc->ac", own, own), np.einsum("nc,nc->c", *own)
        cr, sr = np.einsum("anc,n->ac", own, residual)
        both = cc * ss - cs**2
        determined = both > (MIN_PART * count) ** 2
        falls = (ss * cr**2 - 2.0 * cs * cr * sr + cc * sr**2) / np.where(determined, both, 1.0)
        return np.where(determined, falls, 0.0), waves

    best = int(np.argmax(gains_at(cycles)[0]))
    near = cycles[best] + (np.linspace(-0.5, 0.5, finer) if finer > 1 else np.zeros(1)) / span
    gains, waves = gains_at(near)
    top = int(np.argmax(gains))
    if gains[top] <= 0.0:
        return []
    what = f"{spacing_s / near[top]:.4g} s"
    line = Alternative("periodic", what, unit, waves[:, :, top].T, None, SEARCHED)
    return [(float(gains[top]), line)]
