"""How much bench time a run still takes: by its forecast at first, by its own pace later."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

FEWEST_UNITS = 3
LATEST_PART = 4
"""The pace is that of the latest quarter of the units: later ones may take longer than early."""
ALIKE = 3.0
"""Units that differ by more than this factor, in the latest half of them, have no pace."""


def time_left_s(
    forecast_s: float, finished_s: Sequence[float], units_left: int, now_s: float
) -> float:
    """Return the expected bench time left in s.

    `forecast_s` is what the steps that are not done yet should take; `finished_s` when the units of
    work of this process were finished, in order, and `now_s` the time now, both in s of work from
    any instant. A bench that is slower than the forecast (instruments that answer late, time that
    goes faster than real time) shows in the pace; the further the run is, the more the pace counts.
    """
    done = len(finished_s)
    if done < FEWEST_UNITS or not units_left:
        return forecast_s
    latest = finished_s[-max(FEWEST_UNITS, done // LATEST_PART) :]
    took_s = [
        later - before for before, later in pairwise(finished_s[-max(len(latest), done // 2) :])
    ]
    if max(took_s) > ALIKE * min(took_s):
        return forecast_s
    each_s = (latest[-1] - latest[0]) / (len(latest) - 1)
    paced_s = max(units_left * each_s - (now_s - latest[-1]), 0.0)
    share = done / (done + units_left)
    return share * paced_s + (1.0 - share) * forecast_s
