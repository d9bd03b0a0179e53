"""The columns of one axis, and their solution for any choice of rows.

Turn error in millionths of a turn = commanded turns x delta(T) + time x bias. The bias is a
polynomial of temperature and a random walk (see `wandering_bias`); where all turns have one sense
it has the columns of the scale factor, and is left to the uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import choose_by_information, project, thin_qr

from .axis_turns import SAME_TEMPERATURE_DEGC, AxisTurns, distinct_temperatures, is_paired
from .curve import chebyshev_columns
from .dataset import Array, Mask
from .findings import AnalysisSettings
from .wandering_bias import CorrelatedFit, Walk, course_of, walk_ratio

BIAS_ORDER = 4
PUBLISHED_ORDER = 4
SPARE = 3
"""Temperatures beyond the order, and rows beyond the columns, that a fit must have."""
CHANCE = 2.3
"""Times one over the root of the sets: what a correlation of white residuals seldom exceeds."""


@dataclass(frozen=True)
class Solved:
    """What one choice of rows gives: range, order, size of the walk, fit, correlation."""

    domain_degC: tuple[float, float]
    order: int
    ratio: float
    fit: CorrelatedFit
    lag_one: float


class AxisProblem:
    """The columns of one axis; `kept` is the question that the rounds of rejection answer."""

    def __init__(self, turns: AxisTurns, settings: AnalysisSettings, floor_ppm: float) -> None:
        self.turns = turns
        self.settings = settings
        self.floor_ppm = floor_ppm
        self.paired = is_paired(turns)
        self.candidates = turns.usable & (self.paired | turns.sensing)
        self.course = course_of(turns.middle_s, turns.duration_s, turns.set_interval_s)
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
            asked = self._order(kept, domain, highest, ratio)
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
        return walk_ratio(design, self.data[kept], self.course.of(kept))

    def _order(self, kept: Mask, domain: tuple[float, float], highest: int, ratio: float) -> int:
        design, biases = self.design(domain, highest)
        walk = Walk(self.course.of(kept), ratio)
        q, _ = thin_qr(walk.whiten(design[kept]))
        data = combine(walk.factor, self.data[kept])
        gains = project(q, data) ** 2
        left = float(data @ data) - np.cumsum(gains)
        sums = np.maximum(left[biases:], 0.0)
        columns = [biases + order + 1 for order in range(highest + 1)]
        return choose_by_information(list(sums), columns, int(kept.sum()))

    def fit_of_order(
        self, kept: Mask, domain: tuple[float, float], order: int, ratio: float
    ) -> Solved:
        """Fit the kept rows with a curve of this order and a walk of this size."""
        design, _ = self.design(domain, order)
        walk = Walk(self.course.of(kept), ratio)
        fit = walk.fit(design[kept], self.data[kept])
        return Solved(domain, order, ratio, fit, self._lag_one(kept, fit.white))

    def _lag_one(self, kept: Mask, white: Array) -> float:
        """Return the correlation of neighbouring sets' residuals in the order of temperature."""
        turns = self.turns
        sensing = turns.sensing[kept]
        own = white[sensing] / turns.turns[kept][sensing]
        _, place = np.unique(turns.set_number[kept][sensing], return_inverse=True)
        count = np.bincount(place)
        mean = np.bincount(place, own) / count
        heat = np.bincount(place, turns.temperature_degC[kept][sensing]) / count
        ordered = mean[np.argsort(heat, kind="stable")]
        power = float(ordered @ ordered)
        return float(ordered[1:] @ ordered[:-1]) / power if power > 0.0 else 0.0

    def _stiff(self, solved: Solved) -> bool:
        return solved.lag_one > stiffness(self.settings, len(self.turns.sets()))


def stiffness(settings: AnalysisSettings, sets: int) -> float:
    """Return the correlation from which on the model does not follow the curve."""
    return max(settings.model_too_stiff, CHANCE / float(np.sqrt(max(sets, 1))))
