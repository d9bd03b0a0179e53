"""The tumble test's analysis tried again: what its inputs do to readings, and its noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from trials import in_this_process, tried, wrong_sensitivities
from tumble_records import Stage, made

from procedures.accelerometer_tumble.analysis import analyse
from procedures.accelerometer_tumble.dataset import AnalysisSettings
from procedures.accelerometer_tumble.trials import trials_of
from station.findings import Findings, InputQuantity, findings_of
from station.uncertainty import combine


@pytest.fixture(scope="module")
def findings() -> Findings:
    dataset = made(np.random.default_rng(5), Stage(positions=12))
    analysis = analyse(dataset)
    stated = {"multimeter_gain": 2e-6, "multimeter_zero": 2e-6, "local_gravity": 1e-6}
    stated |= {"encoder": 1.0, "mounting": 1.0}
    inputs = [InputQuantity(name, name, u, "1", "the test") for name, u in stated.items()]
    found_by = findings_of(analysis, dataset, inputs)
    return replace(found_by, trials=trials_of(analysis, dataset, AnalysisSettings()))


def test_each_input_does_to_the_data_what_its_sensitivity_says(findings: Findings) -> None:
    assert wrong_sensitivities(findings, findings.inputs) == {}


def test_errors_of_encoder_and_mountings_make_the_scatter_that_the_budget_states(
    findings: Findings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They go through the solution with its priors, which knows of their size only."""
    in_this_process(monkeypatch)
    whole = combine(findings.estimates, findings.inputs)
    for estimate, linear in zip(tried(findings, 200).estimates, whole, strict=True):
        if linear is None:
            continue
        own = estimate.extra["monte_carlo"]
        assert own["linear_inputs"] == []
        assert own["agrees"], (estimate.name, own)
        assert own["standard_uncertainty"] == pytest.approx(linear.standard_uncertainty, rel=0.25)
