"""The laser gyro's analysis tried again: what its inputs do to raw data, and its noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rlg_records import record
from shipped import shipped_bench
from trials import in_this_process, tried, with_inputs, wrong_sensitivities

from procedures.common.homogeneity import at_device
from procedures.common.inputs import with_unstated
from procedures.rlg_magnetic_sensitivity.analysis import analyse
from procedures.rlg_magnetic_sensitivity.dataset import RlgDataset
from procedures.rlg_magnetic_sensitivity.evaluate import INPUTS, to_findings, undriven_inputs
from procedures.rlg_magnetic_sensitivity.frequencies import Drive
from procedures.rlg_magnetic_sensitivity.parameters import COIL_OF_AXIS, AnalysisSettings
from procedures.rlg_magnetic_sensitivity.trials import trials_of
from station.findings import Findings
from station.uncertainty import combine

U = {
    "field_gain": 0.03,
    "field_time_offset_s": 0.05,
    "probe_cosine": 0.03,
    "gyro_scale": 0.03,
}
LEAN = np.array([[1.0, 0.05, -0.03], [0.02, 1.0, 0.01], [0.0, 0.0, 1.0]])


def findings_of(dataset: RlgDataset) -> Findings:

    settings = AnalysisSettings()
    analysis = analyse(dataset, settings)
    inputs = with_unstated(undriven_inputs(analysis.estimates, settings), INPUTS)
    findings = to_findings(analysis, dataset, inputs, [])
    return replace(findings, trials=trials_of(analysis, dataset, settings))


@pytest.fixture(scope="module")
def one_axis() -> Findings:
    drive = {"IA": Drive(0.1, 1.0)}
    averaged = record(7, drive=drive, coils=LEAN, averaging_s=0.1, cycles=40.0)
    return findings_of(RlgDataset((averaged,)))


@pytest.fixture(scope="module")
def two_axes() -> Findings:
    drive = {"IA": Drive(0.1, 1.0), "NA": Drive(0.13, 0.8)}
    sensitivity = {"IA": 0.05, "NA": -0.02}
    both = record(4, sensitivity, drive=drive, coils=LEAN)
    return findings_of(RlgDataset((both, record(5, sensitivity, coils=LEAN))))


@pytest.mark.parametrize("records", ["one_axis", "two_axes"])
def test_each_input_does_to_the_data_what_its_sensitivity_says(
    request: pytest.FixtureRequest, records: str
) -> None:
    findings = request.getfixturevalue(records)
    names = {name for e in findings.estimates for name in e.sensitivities}
    u = U | {name: 0.2 for name in names if name.startswith("undriven_")}
    assert {name for name in u if name.startswith("undriven_")}
    stated = with_inputs(findings, **u)
    assert wrong_sensitivities(stated, stated.inputs) == {}


def test_a_wrong_sensitivity_is_named(one_axis: Findings) -> None:

    (estimate,) = one_axis.estimates
    wrong = {**estimate.sensitivities, "field_gain": 1.1 * estimate.sensitivities["field_gain"]}
    off = replace(one_axis, estimates=[replace(estimate, sensitivities=wrong)])
    stated = with_inputs(off, **U)
    assert [key[0] for key in wrong_sensitivities(stated, stated.inputs)] == ["field_gain"]


def test_places_of_coils_probe_and_gyro_do_what_their_sensitivities_say() -> None:
    at = at_device(shipped_bench(), "three_axis")
    assert at is not None
    off_centre = {name: value for name, (value, _) in at.lengths_mm.items()}
    off_centre |= {"device_x_mm": 30.0, "device_y_mm": 25.0, "device_z_mm": -20.0}
    at = replace(at, lengths_mm={name: (value, 1.0) for name, value in off_centre.items()})
    sensitivity = {"IA": 0.05, "NA": -0.02, "LA": 0.03}
    segments = [
        record(6, sensitivity, drive={axis: Drive(0.1, 1.0)}, sigma=1e-9) for axis in sensitivity
    ]
    findings = findings_of(RlgDataset(tuple(segments), at))
    findings = replace(findings, inputs=[*at.inputs])
    for estimate in findings.estimates:
        assert (
            estimate.extra["field_at_device"]["ratio"] == at.ratio(COIL_OF_AXIS[estimate.axis])[0]
        )
        rows = {name for name in estimate.sensitivities if name.endswith("_mm")}
        assert len(rows) == 8
    assert wrong_sensitivities(findings, findings.inputs) == {}
    assert findings.trials is not None
    noisy = findings.trials.noisy(findings.trials.dataset, np.random.default_rng(1))
    assert noisy.at_device is at


@pytest.mark.parametrize("records", ["one_axis", "two_axes"])
def test_trials_have_the_noise_that_the_budget_states(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, records: str
) -> None:
    in_this_process(monkeypatch)
    findings = with_inputs(request.getfixturevalue(records), **U)
    combined = combine(findings.estimates, findings.inputs)
    for estimate, whole in zip(tried(findings).estimates, combined, strict=True):
        own = estimate.extra["monte_carlo"]
        assert whole is not None
        assert own["agrees"], own
        assert own["linear_inputs"] == []
        assert own["standard_uncertainty"] == pytest.approx(whole.standard_uncertainty, rel=0.12)
        off = own["value"] - own["linear_value"]
        assert abs(off) < 5.0 * own["standard_uncertainty"] / math.sqrt(own["n"])
