"""The analysis of a bias over temperature tried again: what inputs do to records, and its noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bias_records import CASES, Gyro, record
from trials import in_this_process, trials_in, tried, wrong_sensitivities

from procedures.gyro_bias_temperature.evaluate import _by_board, _findings
from procedures.gyro_bias_temperature.model import loop
from procedures.gyro_bias_temperature.parameters import BiasTemperatureParameters
from station.findings import Findings, InputQuantity
from station.uncertainty import combine

U = {"clock": 1e-5, "pulse_weight": 1e-5}


def made(gyro: Gyro, seed: int) -> Findings:
    """Return findings of a record of a board's pulses."""
    dataset = record(gyro, seed)
    given = BiasTemperatureParameters.model_construct(
        attitude_uncertainty_arcmin=3.4,
        thermometer_uncertainty_degC=0.5,
        latitude_uncertainty_arcmin=3.4,
    )
    inputs = [InputQuantity(name, name, u, "1", "the test") for name, u in U.items()]
    findings = _findings(dataset, given, "the test", more=inputs)
    return replace(findings, estimates=[_by_board(dataset, e) for e in findings.estimates])


@pytest.fixture(scope="module")
def findings() -> Findings:
    return made(CASES["fibre-optic"], 3)


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
