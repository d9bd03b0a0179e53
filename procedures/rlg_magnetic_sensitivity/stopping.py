"""When a record is long enough: the uncertainty asked for is reached, or the decision is clear.

Looks are few and placed where the scatter so far foretells the end: each look at noisy data is one
more chance to stop by luck, which costs coverage.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from procedures.rlg_magnetic_sensitivity.records import (
    PlannedRecord,
    reading_back_s,
    sensitivity_records,
)
from station.console import span

if TYPE_CHECKING:
    from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters, Stop
    from station.runner.run import Run

GUARD = 1.03
"""The uncertainty must be this much better than asked for: at the end of a record that stopped by
it, it is rather too small than too large."""
CLEAR = 3.0
"""Standard uncertainties between a value and every limit that make a decision early."""
LONGEST_GROWTH, SHORTEST_GROWTH = 1.5, 1.2


@dataclass(frozen=True)
class Standing:
    """What the samples so far say of one axis; `limit` is the interval that is within it."""

    axis: str
    value: float | None
    standard_uncertainty: float | None
    limit: tuple[float, float] | None = None

    def reaches(self, uncertainty: float | None) -> bool:
        """Whether the uncertainty is as small as asked for."""
        u = self.standard_uncertainty
        return uncertainty is not None and u is not None and u * GUARD <= uncertainty

    def is_clear(self) -> bool:
        """Whether the value lies clearly within its limit, or clearly outside."""
        if self.value is None or self.standard_uncertainty is None or self.limit is None:
            return False
        (low, high), reach = self.limit, CLEAR * self.standard_uncertainty
        inside = low + reach <= self.value <= high - reach
        return inside or self.value < low - reach or self.value > high + reach


def is_enough(standings: Iterable[Standing], stop: Stop) -> bool:
    """Return whether every axis is as well known, or as clearly decided, as the plan asks for."""
    return all(
        one.reaches(stop.uncertainty_deg_per_h_per_mT) or (stop.early_decision and one.is_clear())
        for one in standings
    )


def samples_at_next_look(
    standings: Iterable[Standing], stop: Stop, planned: PlannedRecord, samples: int
) -> int:
    """Return how many samples a record has when it is looked at again.

    An uncertainty falls with the root of time, which foretells when the target is reached; a clear
    decision may come at any time.
    """
    growth = SHORTEST_GROWTH
    if not stop.early_decision and stop.uncertainty_deg_per_h_per_mT is not None:
        target = stop.uncertainty_deg_per_h_per_mT / GUARD
        known = [one.standard_uncertainty for one in standings]
        worst = max((u for u in known if u is not None), default=target)
        growth = min((worst / target) ** 2, LONGEST_GROWTH) if None not in known else growth
    return planned.whole_blocks(max(growth * samples, samples + planned.block))


class Patience:
    """Decide at each end of a record whether it goes on, and say what is left."""

    def __init__(self, run: Run, planned: PlannedRecord) -> None:
        self._run = run
        self._planned = planned
        self._stop: Stop | None = run.parameters.stop if planned.most > planned.samples else None
        self._standing = ""

    def more(self, facts: Mapping[str, Any]) -> int | None:
        """Return the samples to go on to, None when the record may end."""
        samples = int(facts["samples"])
        if self._stop is None or samples >= self._planned.most:
            return None
        with self._run.clock.allow(reading_back_s(samples, self._run.parameters.sample_interval_s)):
            standings = standings_of(self._run, self._planned, facts)
        self._standing = ", ".join(self._told(one) for one in standings)
        if is_enough(standings, self._stop):
            self._run.progress.say(f"    {self._planned.unit}: enough: {self._standing}")
            return None
        return samples_at_next_look(standings, self._stop, self._planned, samples)

    def said(self, counted: int, wanted: int) -> str:
        """Return how far a record is, and what is left at the most."""
        text = f"{self._planned.unit}: {counted} of {wanted} samples"
        if self._stop is None:
            return text
        interval_s = self._run.parameters.sample_interval_s
        left_s = max(self._planned.most - counted, 0) * interval_s
        now = f", {self._standing}" if self._standing else ""
        return f"{text}, looked at then, {span(left_s)} more at the most{now}"

    def _told(self, one: Standing) -> str:
        if one.value is None or one.standard_uncertainty is None or self._stop is None:
            return f"{one.axis} undetermined"
        target = self._stop.uncertainty_deg_per_h_per_mT
        asked = "" if target is None else f" (asked {target:g})"
        clear = ", clear" if self._stop.early_decision and one.is_clear() else ""
        return f"{one.axis} {one.value:+.4f}, u {one.standard_uncertainty:.4f}{asked}{clear}"


def standings_of(run: Run, planned: PlannedRecord, facts: Mapping[str, Any]) -> list[Standing]:
    """Return what the records so far, the unfinished one with them, say of its axes."""
    from procedures.rlg_magnetic_sensitivity.evaluate import estimates_so_far
    from station.results import combine

    parameters: RlgParameters = run.parameters
    units = [record.unit for record in sensitivity_records(parameters)]
    found, inputs = estimates_so_far(
        run.read_back(), units, parameters, run.bench, (planned.unit, facts)
    )
    limits = run.plan.limits_by_axis()
    standings = []
    for one, combined in zip(found, combine(found, inputs), strict=True):
        if one.axis in planned.drive:
            limit = limits.get((one.name, one.axis))
            standings.append(
                Standing(
                    str(one.axis),
                    one.value,
                    combined.standard_uncertainty if combined else None,
                    limit.interval() if limit else None,
                )
            )
    return standings
