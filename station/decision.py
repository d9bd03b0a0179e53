"""What a result is held against, and the decision on it (JCGM 106).

The decision rule is the plan's: `simple` compares the value alone (simple acceptance); `guarded`
keeps the expanded uncertainty as guard band, so that a pass and a fail are each right with the
stated coverage.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["pass", "fail", "inconclusive", "none"]
Rule = Literal["simple", "guarded"]


@dataclass(frozen=True)
class Limit:
    """What a result is held against, in the result's own unit; None does not limit."""

    min: float | None = None
    max: float | None = None
    max_abs: float | None = None

    def to_data(self) -> dict[str, float]:
        """Return the limit as in `results.json`."""
        named = {"min": self.min, "max": self.max, "max_abs": self.max_abs}
        return {name: value for name, value in named.items() if value is not None}

    def interval(self) -> tuple[float, float]:
        """Return the lowest and the highest value that are within the limit."""
        lows = [value for value in (self.min, self.max_abs and -self.max_abs) if value is not None]
        highs = [value for value in (self.max, self.max_abs) if value is not None]
        return max(lows, default=float("-inf")), min(highs, default=float("inf"))


@dataclass(frozen=True)
class Decision:
    """A verdict and, where it is inconclusive, why."""

    verdict: Verdict
    detail: str | None = None


def decide(
    value: float | None, expanded_uncertainty: float | None, limit: Limit | None, rule: Rule
) -> Decision:
    """Return the decision on a value with its expanded uncertainty, both in the limit's unit."""
    if limit is None:
        return Decision("none")
    if value is None or expanded_uncertainty is None:
        return Decision("inconclusive", "undetermined")
    low, high = limit.interval()
    inside = low <= value <= high
    if rule == "simple":
        return Decision("pass" if inside else "fail")
    clearly_inside = low + expanded_uncertainty <= value <= high - expanded_uncertainty
    clearly_outside = value < low - expanded_uncertainty or value > high + expanded_uncertainty
    if clearly_inside:
        return Decision("pass")
    if clearly_outside:
        return Decision("fail")
    return Decision("inconclusive", "conditional-pass" if inside else "conditional-fail")


def overall(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the verdict of a whole: the worst of those that were asked for."""
    asked = set(verdicts)
    for verdict in ("fail", "inconclusive", "pass"):
        if verdict in asked:
            return verdict
    return "none"


def conformity(
    value: float | None, u: float | None, degrees_of_freedom: float, limit: Limit | None
) -> float | None:
    """Return the probability that the quantity is within its limit; None without one.

    JCGM 106, 7.3, with a flat prior: the quantity is distributed about the value as Student's t
    with `degrees_of_freedom`, `u` wide. All in the limit's unit.
    """
    if limit is None or value is None or not u:
        return None
    from scipy.special import ndtr, stdtr

    def below(bound: float) -> float:
        if math.isinf(bound):
            return 1.0 if bound > 0 else 0.0
        distance = (bound - value) / u
        if math.isinf(degrees_of_freedom):
            return float(ndtr(distance))
        return float(stdtr(degrees_of_freedom, distance))

    low, high = limit.interval()
    return below(high) - below(low)
