"""The analysis of gyros at rest tried again: inputs that act on records, and noise made anew."""

from __future__ import annotations

import numpy as np
import pytest
from static_records import DEVICES, LATITUDE_RAD, records
from trials import in_this_process, trials_in, tried, wrong_sensitivities

from procedures.estimation.direction import with_latitude
from procedures.gyro_static_noise.dataset import AnalysisSettings
from procedures.gyro_static_noise.evaluate import OF_COUNTS, _findings
from station.findings import Findings, InputQuantity

U = {"clock": 0.01, "pulse_weight": 0.01, "azimuth_IA": 1e-3, "elevation_IA": 1e-3}


@pytest.fixture(scope="module")
def findings() -> Findings:
    dataset = records(np.random.default_rng(4), DEVICES["RLG"], (3000, 600, 600, 600))
    inputs = [InputQuantity(name, name, u, "1", "the test") for name, u in U.items()]
    made = _findings(dataset, AnalysisSettings(), inputs)
    return with_latitude(made, dataset.directions, LATITUDE_RAD, 3.4, "the test")


def test_each_input_does_to_the_data_what_its_sensitivity_says(findings: Findings) -> None:
    names = {quantity.name for quantity in findings.inputs}
    assert names | set(OF_COUNTS) == set(trials_in(findings).perturbed)
    assert wrong_sensitivities(findings, findings.inputs) == {}


def test_records_made_anew_have_the_noise_that_was_fitted(
    findings: Findings, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_this_process(monkeypatch)
    for estimate in tried(findings, 100).estimates:
        own = estimate.extra["monte_carlo"]
        assert own["linear_inputs"] == []
        # The root of a square near zero is no normal number: its own interval says more.
        assert estimate.method != "monte-carlo", (estimate.name, own)
        off = own["value"] - own["linear_value"]
        assert abs(off) < own["linear_expanded_uncertainty"], (estimate.name, own)
        if estimate.name in {"bias", "allan_minimum"}:
            assert own["agrees"], (estimate.name, own)
