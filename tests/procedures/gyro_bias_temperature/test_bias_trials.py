"""The analysis of a bias over temperature tried again: what inputs do to records, and its noise."""

from __future__ import annotations

import numpy as np
import pytest
from known_findings import bias_over_temperature
from trials import in_this_process, trials_in, tried, wrong_sensitivities

from procedures.gyro_bias_temperature.model import loop
from station.findings import Findings
from station.uncertainty import combine


@pytest.fixture(scope="module")
def findings() -> Findings:
    return bias_over_temperature(3).findings


def test_each_input_does_to_the_data_what_its_sensitivity_says(findings: Findings) -> None:
    names = {quantity.name for quantity in findings.inputs} - {"thermometer_degC"}
    assert names == set(trials_in(findings).perturbed)
    assert wrong_sensitivities(findings, findings.inputs) == {}


def test_trials_agree_with_the_budget(findings: Findings, monkeypatch: pytest.MonkeyPatch) -> None:
    in_this_process(monkeypatch)
    whole = combine(findings.estimates, findings.inputs)
    for estimate, linear in zip(tried(findings, 40).estimates, whole, strict=True):
        assert linear is not None
        own = estimate.extra["monte_carlo"]
        assert own["linear_inputs"] == (["thermometer_degC"] if estimate.name == "bias" else [])
        assert own["agrees"], (estimate.name, own)
        assert own["standard_uncertainty"] == pytest.approx(linear.standard_uncertainty, rel=0.4)


def test_a_place_in_a_loop_is_that_of_a_play_that_each_row_pushes_on() -> None:
    values = np.cumsum(np.random.default_rng(2).standard_normal(100))
    held, places = values[0], []
    for value in values:
        held = min(max(held, value - 2.0), value + 2.0)
        places.append((value - held) / 2.0)
    assert loop(values, 2.0).tolist() == places
