"""When there are data enough: the gyro is warm; a record reaches its uncertainty, or decides.

Looks at a record are few and placed where the scatter so far foretells the end: each look at
noisy data is one more chance to stop by luck, which costs coverage.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from station.console import span
from station.errors import ConditionNotReached
from station.method.duration import NO_TIME, Duration
from station.method.verbs import POLL_S, Recording

from .parameters import RlgParameters, Stop, WarmUp
from .records import PlannedRecord, reading_back_s, sensitivity_records

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.method.run import Run

WARM_UP_LOOKS_EVERY_S = 30.0
WARM_UP_WINDOWS = 1.3
"""So many windows the warm-up is expected to take."""
GUARD = 1.03
"""The uncertainty must be this much better than asked for: at the end of a record that stopped by
it, it is rather too small than too large."""
CLEAR = 3.0
"""Standard uncertainties between a value and every limit that make a decision early."""
MAX_GROWTH, SHORTEST_GROWTH = 1.5, 1.2


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
        standing.reaches(stop.uncertainty_deg_per_h_per_mT)
        or (stop.early_decision and standing.is_clear())
        for standing in standings
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
        known = [standing.standard_uncertainty for standing in standings]
        worst = max((u for u in known if u is not None), default=target)
        growth = min((worst / target) ** 2, MAX_GROWTH) if None not in known else growth
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
        self._standing = "; ".join(self._told(standing) for standing in standings)
        if is_enough(standings, self._stop):
            self._run.say(f"    {self._planned.unit}: enough: {self._standing}")
            return None
        return samples_at_next_look(standings, self._stop, self._planned, samples)

    def said(self, counted: int, wanted: int) -> str:
        """Return how far a record is, and what is left at the most."""
        text = f"{self._planned.unit}: {counted} of {wanted} samples"
        if self._stop is None:
            return text
        interval_s = self._run.parameters.sample_interval_s
        left_s = max(self._planned.most - counted, 0) * interval_s
        text = f"{text}, looked at then, {span(left_s)} more at the most"
        return f"{text}, {self._standing}" if self._standing else text

    def _told(self, standing: Standing) -> str:
        if standing.value is None or standing.standard_uncertainty is None or self._stop is None:
            return f"{standing.axis} undetermined"
        target = self._stop.uncertainty_deg_per_h_per_mT
        asked = "" if target is None else f" (asked {target:g})"
        clear = ", clear" if self._stop.early_decision and standing.is_clear() else ""
        u = f"u {standing.standard_uncertainty:.4f}"
        return f"{standing.axis} {standing.value:+.4f}, {u}{asked}{clear}"


def standings_of(run: Run, planned: PlannedRecord, facts: Mapping[str, Any]) -> list[Standing]:
    """Return what the records so far, the unfinished one with them, say of its axes."""
    from station.uncertainty import combine

    from .evaluate import estimates_so_far

    parameters: RlgParameters = run.parameters
    units = [record.unit for record in sensitivity_records(parameters)]
    estimates, inputs = estimates_so_far(
        run.read_back(), units, parameters, run.bench, (planned.unit, facts)
    )
    limits = run.plan.limits_by_axis()
    standings = []
    for estimate, combined in zip(estimates, combine(estimates, inputs), strict=True):
        if estimate.axis in planned.drive:
            limit = limits.get((estimate.name, estimate.axis))
            standings.append(
                Standing(
                    str(estimate.axis),
                    estimate.value,
                    combined.standard_uncertainty if combined else None,
                    limit.interval() if limit else None,
                )
            )
    return standings


def warm_up_s(rule: WarmUp) -> Duration:
    """Return how long a gyro takes to become steady: a window at least."""
    expected_s = min(WARM_UP_WINDOWS * rule.window_s, rule.at_most_s)
    longest_s = rule.at_most_s + WARM_UP_LOOKS_EVERY_S + POLL_S
    return Duration(expected_s, rule.window_s, longest_s)


def until_steady(run: Run, gyro: Recording) -> None:
    """Record the gyro until its output is steady.

    Raises ConditionNotReached when |slope| + 2 u stays above the plan's limit for too long.
    """
    from procedures.estimation.linear import slope_with_uncertainty

    from .from_record import gyro_record

    parameters: RlgParameters = run.parameters
    rule, interval_s = parameters.warm_up, parameters.sample_interval_s
    began_s = run.now_s
    doing = "filling the window"
    while True:
        follow_gyro(run, gyro, run.now_s + WARM_UP_LOOKS_EVERY_S, doing)
        elapsed_s = run.now_s - began_s
        if elapsed_s < rule.window_s:
            continue
        with run.clock.allow(reading_back_s(round(elapsed_s / interval_s), interval_s)):
            record = gyro_record(run.read_back(), gyro.unit, parameters, run.bench)
        recent = record.time_s > record.time_s[-1] - rule.window_s
        rate_deg_per_h = record.rate_deg_per_h[recent]
        slope, u = slope_with_uncertainty(record.time_s[recent], rate_deg_per_h)
        slope_deg_per_h2, u_deg_per_h2 = 3600 * slope, 3600 * u
        doing = f"slope {slope_deg_per_h2:+.3f} ± {2 * u_deg_per_h2:.3f} deg/h^2"
        if abs(slope_deg_per_h2) + 2 * u_deg_per_h2 < rule.slope_limit_deg_per_h2:
            run.finish(gyro.unit, slope_deg_per_h2=slope_deg_per_h2, u=u_deg_per_h2)
            run.say(f"    warm: {doing}")
            warn_of_beats(run, rate_deg_per_h, record.interval_s)
            return
        if elapsed_s >= rule.at_most_s:
            raise ConditionNotReached(
                f"the gyro did not become steady within {rule.at_most_s / 60:g} min: {doing}, the "
                f"plan allows {rule.slope_limit_deg_per_h2:g}; wait longer (warm_up.at_most), or "
                "look for air currents, a warming table or a gyro that was just carried in"
            )


def follow_gyro(run: Run, gyro: Recording, until_s: float, doing: str) -> None:
    """Record the gyro of the warm-up until a run time."""
    gyro.until(lambda _: run.now_s >= until_s, NO_TIME, lambda: doing)


def warn_of_beats(run: Run, rate_deg_per_h: NDArray[Any], interval_s: float) -> None:
    """Say before anything is driven that pulses counted at this mean rate would harm a result."""
    from procedures.estimation.allan import allan_deviation, noise_coefficients

    from .checks import Counting, beat_advice

    parameters: RlgParameters = run.parameters
    noise = noise_coefficients(allan_deviation(rate_deg_per_h, interval_s))
    if noise is None:
        return
    planned = sensitivity_records(parameters)[0]
    counting = Counting(
        float(rate_deg_per_h.mean()),
        parameters.pulse_weight_arcsec,
        parameters.sample_interval_s,
        noise.angle_random_walk_deg_per_sqrt_h,
        planned.samples * parameters.sample_interval_s,
    )
    beat = beat_advice(counting, [sine.frequency_Hz for sine in planned.drive.values()])
    if beat is not None:
        run.say(f"    WARNING: {beat.does}; better: {beat.helps}")
