"""U holds the truth as often as it says, where every input of type B deviates as it is stated.

`benchmarks/type_b_coverage.py` has the figures of many runs.
"""

from __future__ import annotations

import numpy as np
import pytest
from known_findings import KNOWN, errors_of

RUNS = {"gyro-static-noise": 40, "gyro-rate-table": 24, "accelerometer-tumble": 24}
FAST = {"accelerometer-magnetic-sensitivity": 60, "fog-scale-factor-temperature": 60} | RUNS


@pytest.mark.campaign
@pytest.mark.parametrize("procedure", FAST)
def test_the_interval_holds_the_truth_with_every_input_drawn(procedure: str) -> None:
    rows = [own for seed in range(FAST[procedure]) for own in errors_of(procedure, seed).values()]
    errors, inside = np.array([error for error, _ in rows]), np.array([held for _, held in rows])
    there = np.isfinite(errors)
    assert there.any()
    assert np.mean(inside[there]) > 0.88
    assert 0.5 < np.mean(errors[there] ** 2) < 1.8


@pytest.mark.campaign
@pytest.mark.parametrize("procedure", sorted(set(KNOWN) - set(FAST)))
def test_every_input_is_drawn_where_an_analysis_takes_long(procedure: str) -> None:
    errors = [error for error, _ in errors_of(procedure, 0).values() if np.isfinite(error)]
    assert errors
    assert max(map(abs, errors)) < 5.0
