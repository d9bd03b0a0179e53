"""The rate table's analysis tried again: inputs that act on records, and their noise."""

from __future__ import annotations

import pytest
from known_findings import rate_table
from trials import in_this_process, trials_in, tried, wrong_sensitivities

from station.findings import Findings


@pytest.fixture(scope="module")
def findings() -> Findings:
    return rate_table(3).findings


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
