"""The coils' analysis tried again: what its inputs do to the shots, and the detector's noise."""

from __future__ import annotations

import pytest
from places import DATA
from trials import in_this_process, trials_in, tried, with_inputs, wrong_sensitivities

from procedures.serf_nonorthogonality.evaluate import INPUTS, findings_of_dataset
from station.dataset_reading import read_dataset
from station.findings import Findings
from station.uncertainty import combine

U = {
    **{f"coil_{axis}": 2e-4 for axis in "xyz"},
    **{f"residual_{axis}_nT": 0.01 for axis in "xyz"},
    "sample_clock": 1e-4,
    "gyromagnetic_ratio": 1e-4,
}


@pytest.fixture(scope="module")
def findings() -> Findings:
    return with_inputs(findings_of_dataset(read_dataset(DATA / "serf-four-shots")), **U)


def test_each_input_does_to_the_data_what_its_sensitivity_says(findings: Findings) -> None:
    assert set(INPUTS) <= set(trials_in(findings).perturbed)
    # A known coil's factor is what its constant says, and no shot moves it.
    factors = {(f"coil_{axis}", "coil_factor", axis): (1.0, pytest.approx(0.0)) for axis in "xyz"}
    assert wrong_sensitivities(findings, findings.inputs) == factors


def test_trials_agree_with_the_budget(findings: Findings, monkeypatch: pytest.MonkeyPatch) -> None:
    in_this_process(monkeypatch)
    whole = combine(findings.estimates, findings.inputs)
    for estimate, linear in zip(tried(findings, 200).estimates, whole, strict=True):
        if linear is None:
            continue
        own, factor = estimate.extra["monte_carlo"], estimate.name == "coil_factor"
        assert own["agrees"], (estimate.name, own)
        assert own["linear_inputs"] == ([f"coil_{estimate.axis}"] if factor else [])
        assert own["standard_uncertainty"] == pytest.approx(linear.standard_uncertainty, rel=0.2)
