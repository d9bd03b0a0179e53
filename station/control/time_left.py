"""How much bench time a run still takes: by its forecast at first, by its own pace later."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

FEWEST_UNITS = 3
LATEST_PART = 4
"""The pace is that of the latest quarter of the units: later ones may take longer than early."""


class FinishedUnit(NamedTuple):
    """A unit of work that is done: when, in s of work, and how long it was expected to take.

    Only the ratios of the expected times count; where none is foreseen, 1 for every unit.
    """

    at_s: float
    expected_s: float


def time_left_s(
    forecast_s: float, finished: Sequence[FinishedUnit], units_left_s: float, now_s: float
) -> float:
    """Return the expected bench time left in s.

    `forecast_s` is what the steps that are not done yet should take; `finished` are the units of
    work of this process in order, `units_left_s` what the others were expected to take in sum, and
    `now_s` the time now, in s of work from any instant. A bench that is slower than the forecast
    (instruments that answer late, time that goes faster than real time) shows in the pace; the
    further the run is, the more the pace counts.
    """
    done = len(finished)
    if done < FEWEST_UNITS or not units_left_s:
        return forecast_s
    first, *latest = finished[-max(FEWEST_UNITS, done // LATEST_PART) :]
    last = latest[-1]
    pace = (last.at_s - first.at_s) / sum(one.expected_s for one in latest)
    paced_s = max(units_left_s * pace - (now_s - last.at_s), 0.0)
    done_s = sum(one.expected_s for one in finished)
    share = done_s / (done_s + units_left_s)
    return share * paced_s + (1.0 - share) * forecast_s
