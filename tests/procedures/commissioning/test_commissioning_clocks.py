"""Clocks: healthy ones raise no alarm, u holds what it states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from campaigns.planted.commissioning import named
from commissioning_parts import plan_of
from plan_runs import run_of, shipped_bench

from procedures.commissioning.clocks import CLOCK, clock_estimate, clock_flags


def test_the_shipped_clock_raises_no_alarm(tmp_path: Path) -> None:
    outcome = run_of(tmp_path, plan_of("clocks"), shipped_bench())
    assert (named(outcome), outcome.exit_code) == (set(), 0)
    assert outcome.document is not None
    results = outcome.document.to_data()["results"]
    (one,) = (one for one in results if one["name"] == "gaussmeter_clock_error")
    # 12 ppm fast: its seconds are shorter.
    assert abs(abs(one["value"]) - 12.0) < 2.0 * one["standard_uncertainty"] + 1.0


def test_the_uncertainty_holds_what_late_arrivals_do() -> None:
    rng, off = np.random.default_rng(5), []
    for _ in range(200):
        counter = np.arange(0.0, 120.0, 0.5)
        arrival = 3.0 + counter * (1.0 + 80e-6) + rng.uniform(0.0, 0.02, counter.size)
        one = clock_estimate(CLOCK, counter, arrival)
        assert one.value is not None and one.standard_uncertainty is not None
        off.append((one.value - 80.0) / one.standard_uncertainty)
    assert np.mean(np.abs(off) < 2.0) > 0.93


def test_a_short_record_decides_nothing() -> None:
    rng = np.random.default_rng(6)
    counter = np.arange(0.0, 10.0, 1.0)
    arrival = counter + rng.uniform(0.0, 0.5, counter.size)
    one = clock_estimate(CLOCK, counter, arrival)
    assert [flag.code for flag in clock_flags(one, "gaussmeter")] == ["clock-undecided"]
