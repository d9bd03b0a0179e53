"""How far an instrument's clock is off the station's: a pure function of counters and arrivals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.alignment import align
from station.findings import Estimate, Flag

Array = NDArray[np.float64]
PPM = 1e6
CLOCK_PPM = 100.0
"""A quartz is within 50 ppm, a good computer's clock, too. In 10 min 100 ppm are 60 ms, a hundredth
of the period of a drive of 0.17 Hz."""
COVERAGE = 2.0
OF_SLOPE = 3.5
"""The line's two ends are each as sure as its offset, and stand about a half of the record apart;
measured, with lateness that spreads evenly (a test)."""
METHOD = "line below the arrivals of its time stamps"


def clock_estimate(name: str, counter_s: Array, arrival_s: Array) -> Estimate:
    """Return by how much an instrument's seconds are longer than the station's, in ppm.

    `counter_s` (n,) by the instrument, `arrival_s` (n,) in run time. ValueError for fewer than ten.
    """
    # Of what arrived together only the last was not waiting.
    last = np.flatnonzero(np.append(np.diff(arrival_s) > 0.0, True))
    if len(last) < 10:
        raise ValueError("a clock needs ten time stamps that arrived one by one")
    line = align(counter_s[last], arrival_s[last], 1.0)
    span_s = float(counter_s[-1] - counter_s[0])
    u_ppm = PPM * OF_SLOPE * line.offset_u_s / span_s
    return Estimate(name, None, PPM * (line.rate - 1.0), "ppm", u_ppm, None, METHOD)


def clock_flags(estimate: Estimate, instrument: str) -> Iterator[Flag]:
    """Yield that a clock is off, or that the record does not decide it."""
    assert estimate.value is not None and estimate.standard_uncertainty is not None
    u = COVERAGE * estimate.standard_uncertainty
    if abs(estimate.value) - u > CLOCK_PPM:
        way = "slow" if estimate.value > 0.0 else "fast"
        message = (
            f"The clock of {instrument} is {abs(estimate.value):.0f} ppm {way} against the "
            f"computer's (U = {u:.0f} ppm). One of both is wrong: compare each with a time "
            "standard."
        )
        yield Flag("clock-off", message, instrument)
    elif u > CLOCK_PPM:
        message = f"The clock of {instrument} is known to {u:.0f} ppm only: record for longer."
        yield Flag("clock-undecided", message, instrument)
