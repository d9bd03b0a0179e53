"""What a row of results says of a unit, a bench or a type: control chart, capability.

Individuals and moving ranges: Montgomery, Introduction to Statistical Quality Control, 6.4; the
rules are those of the Western Electric handbook (1956), zones of one, two and three sigma.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, stdev

D2 = 1.128
"""Mean range of two normal values, in standard deviations (Montgomery, table VI)."""
D4 = 3.267
"""Upper limit of a range of two, in mean ranges (Montgomery, table VI)."""
FEWEST = 8
"""Values before a chart has limits: fewer leave sigma uncertain by more than a third."""
BASELINE = 20
"""The limits are those of the first so many values, and stay: a drift must not widen them.

Before there are so many, a value is judged by those there were when it came: an alarm stays.
"""


@dataclass(frozen=True)
class Chart:
    """A chart of individuals and moving ranges, in the values' unit.

    `alarms` has a sentence for each value that breaks a rule, by its number from 0.
    """

    centre: float
    sigma: float
    largest_range: float
    baseline: int
    alarms: dict[int, str]
    newest: int

    @property
    def out_of_control(self) -> bool:
        """Whether the newest value breaks a rule."""
        return self.newest in self.alarms


def chart_of(values: Sequence[float]) -> Chart | None:
    """Return the chart of values in their order; None where there are too few of them."""
    if len(values) < FEWEST:
        return None
    alarms = dict[int, str]()
    for number in range(len(values)):
        centre, sigma, largest = _limits(values[: max(number + 1, FEWEST)])
        latest = values[max(number + 1 - FEWEST, 0) : number + 1]
        rule = broken_rule([value - centre for value in latest], sigma)
        if not rule and len(latest) > 1 and abs(latest[-1] - latest[-2]) > largest:
            rule = "away from the one before by more than the range's limit"
        if rule:
            alarms[number] = rule
    baseline = min(BASELINE, len(values))
    return Chart(*_limits(values), baseline=baseline, alarms=alarms, newest=len(values) - 1)


def _limits(values: Sequence[float]) -> tuple[float, float, float]:
    """Return centre, sigma and largest moving range by the baseline of some values."""
    first = values[:BASELINE]
    range_ = fmean(abs(b - a) for a, b in pairwise(first))
    return fmean(first), range_ / D2, D4 * range_


def broken_rule(deviations: Sequence[float], sigma: float) -> str:
    """Return which rule the newest of the deviations from the centre breaks; "" where none."""
    for side, where in ((1.0, "above"), (-1.0, "below")):
        out = [side * deviation for deviation in deviations]
        if out[-1] > 3.0 * sigma:
            return f"more than 3 sigma {where} the centre"
        for beyond, of, zone in ((2, 3, 2.0), (4, 5, 1.0)):
            latest = out[-of:]
            far = [deviation > zone * sigma for deviation in latest]
            if len(latest) == of and far[-1] and sum(far) >= beyond:
                return f"{beyond} of {of} in a row more than {zone:g} sigma {where} the centre"
        if len(out) >= FEWEST and all(deviation > 0 for deviation in out[-FEWEST:]):
            return f"{FEWEST} in a row {where} the centre"
    return ""


def capability(values: Sequence[float], low: float | None, high: float | None) -> float | None:
    """Return Cpk of values against limits in their unit; None without a limit or a spread."""
    if len(values) < FEWEST or (low is None and high is None):
        return None
    mean, spread = fmean(values), stdev(values)
    if spread == 0.0:
        return None
    room = min(math.inf if high is None else high - mean, math.inf if low is None else mean - low)
    return room / (3.0 * spread)
