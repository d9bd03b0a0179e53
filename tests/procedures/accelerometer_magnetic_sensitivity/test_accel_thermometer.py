"""A thermometer that stands still, or is not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from accelerometer_records import codes, off_in_u, record

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.dataset import AccelerometerDataset


def warming(seed: int, rise_K: float = 1.0) -> AccelerometerDataset:
    """Return a record in the course of which the device warms up; the thermometer has noise."""
    rng = np.random.default_rng([seed, 3])
    true = 25.0 + rise_K * np.linspace(0.0, 1.0, 54)
    one = record(seed, temperature_degC=true, K0_per_K=30e-6, Ki_per_K=100e-6)
    return replace(one, temperature_degC=true + 0.004 * rng.standard_normal(54))


@pytest.mark.parametrize("since", [0, 20])
def test_a_frozen_thermometer_is_flagged_and_its_readings_do_not_count(since: int) -> None:
    for seed in range(6):
        one = warming(seed)
        assert one.temperature_degC is not None
        heat = one.temperature_degC.copy()
        heat[since:] = heat[since]
        analysis = analyse(replace(one, temperature_degC=heat))
        (flag,) = [flag for flag in analysis.flags if flag.code == "frozen"]
        assert flag.details == {"count": 54 - since, "row": since, "what": "thermometer"}
        assert max(off_in_u(analysis).values()) < 4.5


def test_without_a_thermometer_the_scale_factor_may_drift_and_that_is_flagged() -> None:
    for seed in range(6):
        analysis = analyse(replace(warming(seed), temperature_degC=None))
        terms = [one.details.get("term") for one in analysis.flags if one.code == "drift-removed"]
        assert "Ki" in terms
        assert max(off_in_u(analysis).values()) < 4.5


def test_a_thermometer_that_measures_or_is_coarse_is_not_called_frozen() -> None:
    for seed in range(20):
        one = warming(seed)
        assert one.temperature_degC is not None
        places = (3, 2, 1)[seed % 3]
        coarse = replace(one, temperature_degC=np.round(one.temperature_degC, places))
        assert "frozen" not in codes(analyse(coarse)), seed
