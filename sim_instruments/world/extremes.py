"""The largest current that a coil has carried and the fastest change it has seen."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim_instruments.world.currents import LONG_AGO_S, CurrentHistory


def coil_report(coil: CurrentHistory, now_s: float) -> dict[str, Any]:
    """Return the state of a coil now and the extremes of its past, as plain data.

    Between two changes of the level the current runs monotonically towards it, fastest at the
    start: the extremes lie at the changes, exactly. `driven_A` is where the current goes if
    nobody intervenes; `largest_slew_A_per_s` times the coil's `time_constant_s` is the largest
    step that the supply ever made against the current.
    """
    changes = coil.breakpoints(LONG_AGO_S, now_s)
    times = np.unique(np.concatenate([changes, [0.0, now_s]]))
    times = times[times <= now_s]
    currents = np.abs(coil.current(times))
    largest = int(currents.argmax())
    report: dict[str, Any] = {
        "current_A": float(coil.current(times[-1:])[0]),
        "driven_A": float(coil.level(times[-1:])[0]),
        "largest_current_A": float(currents[largest]),
        "largest_current_at_s": float(times[largest]),
        "largest_slew_A_per_s": 0.0,
        "largest_slew_at_s": float(times[0]),
        "time_constant_s": coil.tau_s,
        "at_zero_since_s": None,
    }
    if times.size > 1:
        # The level is asked for in the middle, where rounding cannot pick the neighbouring step.
        levels = coil.level(times[:-1] + np.diff(times) / 2)
        slews = np.abs(levels - coil.current(times[:-1])) / coil.tau_s
        fastest = int(slews.argmax())
        report["largest_slew_A_per_s"] = float(slews[fastest])
        report["largest_slew_at_s"] = float(times[fastest])
    # The last change may be this very moment's.
    now_level = abs(report["driven_A"] - report["current_A"]) / coil.tau_s
    if now_level > report["largest_slew_A_per_s"]:
        report["largest_slew_A_per_s"], report["largest_slew_at_s"] = now_level, now_s
    if report["driven_A"] == 0.0:
        report["at_zero_since_s"] = zero_since(coil, times)
    return report


def zero_since(coil: CurrentHistory, times: np.ndarray) -> float:
    """Return since when the supply has driven nothing through the coil, at the last of `times`."""
    if times.size < 2:
        return float(times[-1])
    driven = np.flatnonzero(coil.level(times[:-1] + np.diff(times) / 2) != 0.0)
    return float(times[driven[-1] + 1] if driven.size else times[0])
