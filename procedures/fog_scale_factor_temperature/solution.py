"""The best estimate for one axis: robust, bias and all, with an order that the data ask for.

Turn error in units of a millionth turn = commanded turns x delta(T) + time x bias. The bias is a
polynomial of temperature and a random walk (see `wandering_bias`); where all turns have one sense
it has the columns of the scale factor and is left to the uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procedures.estimation.orthogonal import (
    choose_by_information,
    keep_inliers,
    project,
    solve_by_qr,
    thin_qr,
)

from .curve import Curve, chebyshev_columns
from .dataset import Array, Index, Mask
from .findings import AnalysisSettings, AxisFit
from .turning import FULL_TURN_DEG, PPM, SECONDS_PER_HOUR
from .wandering_bias import CorrelatedFit, Walk, deleted_residuals, walk_kernel, walk_ratio

BIAS_ORDER = 4
START_BIAS_ORDER = 6
START_THRESHOLD = 1.6
"""Of the rejection's: the first look has no model of the bias's walk."""
COVERED = 0.8
NEXT_SET = 1.6
SAME_TEMPERATURE_DEGC = 0.5
START_ORDERS = (4, 9, 20)
WILD_SHARE = 0.05
SPARE = 3
ROUNDS = 25
CHANCE = 2.3
"""Times one over the root of the sets: what a correlation of white residuals seldom exceeds."""


@dataclass(frozen=True)
class AxisTurns:
    """The turns of one axis that can be used at all, every array (n,); `error_deg` as measured."""

    axis: str
    rows: Index
    set_number: Index
    middle_s: Array
    duration_s: Array
    commanded_deg: Array
    error_deg: Array
    temperature_degC: Array
    usable: Mask

    @property
    def data_ppm(self) -> Array:
        """Turn errors in millionths of a turn."""
        return self.error_deg / FULL_TURN_DEG * PPM

    @property
    def turns(self) -> Array:
        """Commanded turns, signed."""
        return self.commanded_deg / FULL_TURN_DEG

    @property
    def by_bias_ppm(self) -> Array:
        """What a bias of 1 deg/h adds to `data_ppm`."""
        return self.duration_s / SECONDS_PER_HOUR / FULL_TURN_DEG * PPM

    @property
    def set_interval_s(self) -> float:
        """The usual time from a set to the next; the record's length where there is but one."""
        starts = np.array([self.middle_s[self.set_number == n].min() for n in self.sets()])
        steps = np.diff(np.sort(starts))
        steps = steps[steps > 0.0]
        return float(np.median(steps)) if len(steps) else float(max(np.ptp(self.middle_s), 1.0))

    def sets(self) -> Index:
        """Return the numbers of the sets, each once."""
        return np.unique(self.set_number)


def is_paired(turns: AxisTurns) -> bool:
    """Whether turns of another command, or waits, stand beside nearly every turn.

    Beside is within the same set or the next: only there can the bias be told from the scale
    factor however it changes with temperature.
    """
    sensing = turns.usable & (turns.commanded_deg != 0.0)
    if not bool(sensing.any()):
        return False
    within_s = NEXT_SET * turns.set_interval_s
    near = np.abs(np.subtract.outer(turns.middle_s, turns.middle_s)) <= within_s
    other = np.not_equal.outer(turns.commanded_deg, turns.commanded_deg)
    covered = np.any(near & other & turns.usable[None, :], axis=1)
    return bool(covered[sensing].mean() >= COVERED)


def distinct_temperatures(temperature_degC: Array) -> int:
    """Return at how many temperatures there are turns, those within half a degree taken as one."""
    return len(np.unique(np.floor(temperature_degC / SAME_TEMPERATURE_DEGC)))


@dataclass(frozen=True)
class _Solved:
    domain_degC: tuple[float, float]
    order: int
    ratio: float
    fit: CorrelatedFit
    lag_one: float


class _AxisProblem:
    """The columns of one axis; `kept` is the question that the rounds of rejection answer."""

    def __init__(self, turns: AxisTurns, settings: AnalysisSettings, floor_ppm: float) -> None:
        self.turns = turns
        self.settings = settings
        self.floor_ppm = floor_ppm
        self.paired = is_paired(turns)
        self.candidates = turns.usable & (self.paired | (turns.commanded_deg != 0.0))
        self.kernel = walk_kernel(turns.middle_s, turns.duration_s, turns.set_interval_s)
        self.data = turns.data_ppm

    def highest_order(self, kept: Mask) -> int:
        """Return the highest order that the kept turns can carry, -1 where they carry none."""
        sensing = kept & (self.turns.commanded_deg != 0.0)
        distinct = distinct_temperatures(self.turns.temperature_degC[sensing])
        spare = int(sensing.sum()) - SPARE - (2 if self.paired else 0)
        third = max(distinct // 3, min(distinct - SPARE, 4))
        return min(self.settings.highest_order, distinct - SPARE, spare, third)

    def domain(self, kept: Mask) -> tuple[float, float]:
        """Return the range of the kept turns' temperatures."""
        inside = self.turns.temperature_degC[kept & (self.turns.commanded_deg != 0.0)]
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

    def start(self, order: int) -> Mask:
        """Return the rows that a look by least magnitudes, of this order, does not throw out."""
        kept = self.candidates.copy()
        highest = self.highest_order(kept)
        if highest < 0:
            return kept
        order = min(order, highest, max(int(kept.sum()) // 5, 1))
        design, _ = self.design(self.domain(kept), order, START_BIAS_ORDER)
        inside = keep_inliers(
            design[kept], self.data[kept], START_THRESHOLD * self.settings.outlier
        )
        near = np.zeros(len(kept), dtype=bool)
        near[np.flatnonzero(kept)] = inside
        # Quantised data may have a robust deviation of nothing: never reject within the floor.
        if self.floor_ppm > 0.0:
            found = solve_by_qr(design[near], self.data[near]).coefficients
            reach = START_THRESHOLD * self.settings.outlier * self.floor_ppm
            near |= kept & (np.abs(self.data - design @ found) <= reach)
        return near

    def solve(self, kept: Mask) -> _Solved | None:
        """Fit the kept rows: the walk of the bias, then the order, then both again."""
        highest = self.highest_order(kept)
        if highest < 0:
            return None
        domain = self.domain(kept)
        if domain[1] - domain[0] <= 0.0:
            domain = (domain[0] - SAME_TEMPERATURE_DEGC, domain[1] + SAME_TEMPERATURE_DEGC)
            highest = 0
        order = highest
        for _ in range(2):
            ratio = self._ratio(kept, domain, order)
            order = self._order(kept, domain, highest, ratio)
        ratio = self._ratio(kept, domain, order)
        best = self._fit(kept, domain, order, ratio)
        if self._stiff(best):
            for higher in range(order + 1, highest + 1):
                raised = self._fit(kept, domain, higher, self._ratio(kept, domain, higher))
                if not self._stiff(raised):
                    return raised
        return best

    def _ratio(self, kept: Mask, domain: tuple[float, float], order: int) -> float:
        if not self.paired:
            return 0.0
        design = self.design(domain, order)[0][kept]
        return walk_ratio(design, self.data[kept], self.kernel[np.ix_(kept, kept)])

    def _order(self, kept: Mask, domain: tuple[float, float], highest: int, ratio: float) -> int:
        design, biases = self.design(domain, highest)
        walk = Walk(self.kernel[np.ix_(kept, kept)], ratio)
        q, _ = thin_qr(walk.whiten(design[kept]))
        data = walk.whiten(self.data[kept])
        gains = project(q, data) ** 2
        left = float(data @ data) - np.cumsum(gains)
        sums = np.maximum(left[biases:], 0.0)
        columns = [biases + order + 1 for order in range(highest + 1)]
        return choose_by_information(list(sums), columns, int(kept.sum()))

    def _fit(self, kept: Mask, domain: tuple[float, float], order: int, ratio: float) -> _Solved:
        design, _ = self.design(domain, order)
        walk = Walk(self.kernel[np.ix_(kept, kept)], ratio)
        fit = walk.fit(design[kept], self.data[kept])
        return _Solved(domain, order, ratio, fit, self._lag_one(kept, fit.white))

    def _lag_one(self, kept: Mask, white: Array) -> float:
        """Return the correlation of neighbouring sets' residuals in the order of temperature."""
        turns = self.turns
        sensing = turns.commanded_deg[kept] != 0.0
        own = white[sensing] / turns.turns[kept][sensing]
        _, place = np.unique(turns.set_number[kept][sensing], return_inverse=True)
        count = np.bincount(place)
        mean = np.bincount(place, own) / count
        heat = np.bincount(place, turns.temperature_degC[kept][sensing]) / count
        ordered = mean[np.argsort(heat, kind="stable")]
        power = float(ordered @ ordered)
        return float(ordered[1:] @ ordered[:-1]) / power if power > 0.0 else 0.0

    def _stiff(self, solved: _Solved) -> bool:
        return solved.lag_one > stiffness(self.settings, len(self.turns.sets()))

    def reject(self) -> tuple[Mask, _Solved | None]:
        """Return the rows that agree with what the others foretell, and their solution.

        From several first looks: a stiff one takes a feature of the curve for wild turns, a soft
        one a wild turn at the end of the range for the curve. The likeliest of their ends counts.
        """
        ends: dict[bytes, tuple[Mask, _Solved | None]] = {}
        begun: set[bytes] = set()
        for order in START_ORDERS:
            kept = self.start(order)
            if kept.tobytes() not in begun:
                begun.add(kept.tobytes())
                found = self._settle(kept)
                ends.setdefault(found[0].tobytes(), found)
        return min(ends.values(), key=self._surprise)

    def _surprise(self, end: tuple[Mask, _Solved | None]) -> float:
        """Return minus twice the logarithm of the likelihood, wild turns and columns charged.

        A wild turn may lie anywhere within the span of the data, and is as seldom as `WILD_SHARE`.
        """
        kept, solved = end
        if solved is None:
            return float("inf")
        count = int(kept.sum())
        wild = int(self.candidates.sum()) - count
        span = float(np.ptp(self.data[self.candidates])) or 1.0
        noise = max(solved.fit.noise, self.floor_ppm, 1e-9 * span)
        walk = Walk(self.kernel[np.ix_(kept, kept)], solved.ratio)
        told = count * (np.log(2.0 * np.pi * noise**2) + 1.0)
        told += 2.0 * float(np.log(np.diag(walk.factor)).sum())
        told += (solved.order + 1) * np.log(count)
        return float(told + 2.0 * wild * np.log(span * (1.0 - WILD_SHARE) / WILD_SHARE))

    def _settle(self, kept: Mask) -> tuple[Mask, _Solved | None]:
        """Return the rows that stay when wild ones are left out and good ones taken back.

        One row of a set is taken or given back at a time: of a pair the good turn looks as wrong as
        the bad one until one of them is gone.
        """
        solved = self.solve(kept)
        seen = {kept.tobytes()}
        for _ in range(ROUNDS):
            if solved is None:
                break
            design, _ = self.design(solved.domain_degC, solved.order)
            far = np.abs(
                deleted_residuals(
                    design[self.candidates],
                    self.data[self.candidates],
                    self.kernel[np.ix_(self.candidates, self.candidates)],
                    solved.ratio,
                    kept[self.candidates],
                )
            )
            size = np.zeros(len(kept))
            size[self.candidates] = far
            sigma = max(solved.fit.noise, self.floor_ppm)
            changed = self._changed(kept, size, self.settings.outlier * sigma)
            if changed.tobytes() in seen or self.highest_order(changed) < 0:
                break
            again = self.solve(changed)
            if again is None:
                break
            seen.add(changed.tobytes())
            kept, solved = changed, again
        return kept, solved

    def _changed(self, kept: Mask, size: Array, threshold: float) -> Mask:
        changed = kept.copy()
        far = kept & (size > threshold)
        back = self.candidates & ~kept & (size <= threshold)
        for number in np.unique(self.turns.set_number[far | back]):
            own = self.turns.set_number == number
            if bool((own & far).any()):
                changed[np.flatnonzero(own & far)[np.argmax(size[own & far])]] = False
            else:
                changed[np.flatnonzero(own & back)[np.argmin(size[own & back])]] = True
        return changed


def stiffness(settings: AnalysisSettings, sets: int) -> float:
    """Return the correlation from which on the model does not follow the curve."""
    return max(settings.model_too_stiff, CHANCE / np.sqrt(max(sets, 1)))


def fit_axis(turns: AxisTurns, settings: AnalysisSettings, floor_ppm: float = 0.0) -> AxisFit:
    """Return the model of one axis; `floor_ppm` is the least deviation that is called noise."""
    problem = _AxisProblem(turns, settings, floor_ppm)
    kept, solved = problem.reject()
    sensing = turns.commanded_deg != 0.0
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
    curve = Curve(
        solved.domain_degC,
        fit.coefficients[biases:],
        fit.noise**2 * fit.inverse_normal[biases:, biases:],
        float(fit.degrees_of_freedom),
        by_bias,
    )
    return AxisFit(
        turns.axis,
        turns.rows,
        kept,
        turns.temperature_degC,
        error,
        np.where(sensing, residual / safe, np.nan),
        curve,
        problem.paired,
        fit.noise,
        solved.lag_one,
        len(np.unique(turns.set_number[kept])),
        _walk(turns, solved) if problem.paired else None,
        float(fit.coefficients[0]) if problem.paired else None,
    )


def _walk(turns: AxisTurns, solved: _Solved) -> float:
    """Return the size of the bias's walk in deg/h per root hour."""
    usual_ppm = float(np.mean(turns.by_bias_ppm))
    per_step = solved.fit.noise * np.sqrt(solved.ratio) / usual_ppm
    return float(per_step / np.sqrt(turns.set_interval_s / SECONDS_PER_HOUR))
