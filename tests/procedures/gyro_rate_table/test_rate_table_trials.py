"""The rate table's analysis tried again: inputs that act on records, and their noise."""

from __future__ import annotations

import numpy as np
import pytest
from rate_records import LATITUDE_RAD, Gyro, made
from trials import in_this_process, trials_in, tried, wrong_sensitivities

from procedures.estimation.direction import with_latitude
from procedures.gyro_rate_table.dataset import AnalysisSettings
from procedures.gyro_rate_table.evaluate import UPWARDS, _findings
from station.findings import Findings, InputQuantity

U = {"clock": 2e-6, "pulse_weight": 2e-6, "alignment": 2e-6, "level": 1e-3}


@pytest.fixture(scope="module")
def findings() -> Findings:
    dataset = made(np.random.default_rng(3), Gyro(scatter_ppm=3.0, repeats=4, K=0.05)).dataset
    inputs = [InputQuantity(name, name, u, "1", "the test") for name, u in U.items()]
    own = _findings({"IA": dataset}, AnalysisSettings(), inputs)
    return with_latitude(own, {"IA": UPWARDS}, LATITUDE_RAD, 3.4, "the test")


def test_each_input_does_to_the_data_what_its_sensitivity_says(findings: Findings) -> None:
    assert {q.name for q in findings.inputs} == set(trials_in(findings).perturbed)
    assert wrong_sensitivities(findings, findings.inputs) == {}


def test_trials_agree_with_the_budget(findings: Findings, monkeypatch: pytest.MonkeyPatch) -> None:
    in_this_process(monkeypatch)
    for estimate in tried(findings, 150).estimates:
        own = estimate.extra["monte_carlo"]
        assert own["linear_inputs"] == []
        if estimate.name in {"scale_factor", "asymmetry", "bias"}:
            assert own["agrees"], (estimate.name, own)
