"""The accelerometer's analysis tried again: what its inputs do to raw data, and its noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from accelerometer_records import record
from known_findings import ACCELEROMETER_U
from shipped import shipped_bench
from trials import in_this_process, trials_in, tried, with_inputs, wrong_sensitivities

from procedures.accelerometer_magnetic_sensitivity.evaluate import INPUTS, WARMTH, _findings
from procedures.accelerometer_magnetic_sensitivity.parameters import AnalysisSettings
from procedures.common.homogeneity import at_device
from station.findings import Findings, InputQuantity

LEAN_RAD = 1e-3


def findings_of(planes: tuple[str, ...], angles: int) -> Findings:
    """Return findings with every input stated."""
    findings = _findings(record(3, planes, angles), AnalysisSettings(), [])
    leans = [q.name for q in findings.inputs if q.name.startswith("mounting_")]
    return with_inputs(findings, **ACCELEROMETER_U, **dict.fromkeys(leans, LEAN_RAD))


@pytest.mark.parametrize(
    "planes, angles",
    [
        (("io", "ip"), 9),
        (("io",), 4),
        (("op",), 9),
        (("level",), 4),
        (("io", "op"), 9),
        (("ip", "op"), 12),
    ],
)
def test_each_input_does_to_the_data_what_its_sensitivity_says(
    planes: tuple[str, ...], angles: int
) -> None:
    findings = findings_of(planes, angles)
    leans = {q.name for q in findings.inputs if q.name.startswith("mounting_")}
    assert bool(leans) == (planes == ("level",))
    assert wrong_sensitivities(findings, findings.inputs) == {}


def test_places_of_coil_probe_and_device_do_what_their_sensitivities_say() -> None:
    at = at_device(shipped_bench(), "dc")
    assert at is not None
    dataset = replace(record(3, ("io", "ip"), 9), at_device=at)
    findings = _findings(dataset, AnalysisSettings(), [])
    findings = replace(findings, inputs=[*at.inputs])
    km = next(estimate for estimate in findings.estimates if estimate.name == "Km")
    assert km.extra["field_at_device"]["ratio"] == at.ratio("x")[0]
    assert {quantity.name for quantity in at.inputs} <= set(km.sensitivities)
    assert wrong_sensitivities(findings, findings.inputs) == {}


def test_only_the_thermometer_acts_by_its_sensitivity() -> None:
    assert set(INPUTS) - set(trials_in(findings_of(("io",), 4)).perturbed) == {WARMTH}


def test_a_thermometer_that_stood_still_is_an_input_that_nobody_states() -> None:
    stated = [InputQuantity(WARMTH, "offset", 0.05, "degC", "the plan")]
    rows = record(3, ("io", "ip"), 9)
    noise_K = 1e-3 * np.random.default_rng(0).standard_normal(len(rows))
    sound = replace(rows, temperature_degC=21.5 + noise_K)
    dead = replace(rows, temperature_degC=np.full(len(rows), 21.5))
    for dataset, u_degC in ((sound, 0.05), (dead, None)):
        findings = _findings(dataset, AnalysisSettings(), stated)
        (given,) = (own for own in findings.inputs if own.name == WARMTH)
        assert given.standard_uncertainty == u_degC
    by_name = {own.name: own for own in findings.estimates}
    slopes = {name: own.sensitivities.get(WARMTH) for name, own in by_name.items()}
    ki = by_name["Ki"].value
    assert ki is not None
    assert slopes.pop("K0") == pytest.approx(30e-6 * ki)
    assert slopes.pop("Ki") == pytest.approx(100e-6 * ki)
    assert set(slopes.values()) == {None}


def test_trials_agree_with_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    in_this_process(monkeypatch)
    estimates = tried(findings_of(("io", "ip"), 9), 300).estimates
    entries = {e.name: e.extra["monte_carlo"] for e in estimates if e.value is not None}
    assert len(entries) == 12
    assert {name for name, entry in entries.items() if not entry["agrees"]} == set()
    assert all(entry["linear_inputs"] == [] for entry in entries.values())
