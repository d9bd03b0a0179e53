"""The tumble test's analysis tried again: what its inputs do to readings, and its noise."""

from __future__ import annotations

import pytest
from known_findings import accelerometer_in_gravity
from trials import in_this_process, tried, wrong_sensitivities

from station.findings import Findings
from station.uncertainty import combine


@pytest.fixture(scope="module")
def findings() -> Findings:
    return accelerometer_in_gravity(5).findings


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
