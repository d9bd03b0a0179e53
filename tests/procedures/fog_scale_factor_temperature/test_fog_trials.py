"""The analysis of scale factors over temperature tried again: turns, and drives."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from fog_records import record
from navigated_example import drive_of
from simulated_journey import simulated_journey
from test_fog_navigation import flawed
from trials import in_this_process, trials_in, tried, wrong_sensitivities

from procedures.fog_scale_factor_temperature.analysis import analyse
from procedures.fog_scale_factor_temperature.dataset import FogDataset
from procedures.fog_scale_factor_temperature.evaluate import _tried, to_findings
from procedures.fog_scale_factor_temperature.navigation import NAMES, RUNS
from procedures.fog_scale_factor_temperature.parameters import AnalysisSettings
from procedures.fog_scale_factor_temperature.trials import biased, trials_of
from station.findings import Findings, InputQuantity
from station.uncertainty import combine

AXES = ("x", "y", "z")
NAVIGATED = {f"{name}_{run}" for name in NAMES for run in RUNS}


def made(dataset: FogDataset, **u: float) -> Findings:
    """Return findings with inputs that are stated so."""
    analysis = analyse(dataset)
    stated = [InputQuantity(name, name, own, "1", "the test") for name, own in u.items()]
    findings = to_findings(analysis, dataset, [], "the test", stated)
    others = [quantity for quantity in findings.inputs if quantity.name not in u]
    trials = trials_of(analysis, dataset, partial(_tried, settings=AnalysisSettings()))
    return replace(findings, inputs=[*others, *stated], trials=trials)


def drive_to_heading() -> FogDataset:
    drive = replace(drive_of(flawed(0, laps=2)), specific_force_m_per_s2=None, reference=None)
    return replace(record(0, (360,), axes=AXES), drive=drive)


def all_alike(dataset: FogDataset, bias_deg_per_h: float) -> FogDataset:
    """A bias of all gyros that moves a result moves it as its own gyro's does."""
    return biased(dataset, np.full(3, bias_deg_per_h))


def test_each_input_does_to_the_data_what_its_sensitivity_says() -> None:
    findings = made(drive_to_heading(), gyro_bias=0.02, latitude=1e-3)
    trials = trials_in(findings)
    perturbed = {**trials.perturbed, "gyro_bias": all_alike}
    held = replace(findings, trials=replace(trials, perturbed=perturbed))
    assert wrong_sensitivities(held, findings.inputs) == {}


@pytest.fixture(scope="module")
def navigated() -> Findings:
    dataset = record(0, axes=AXES, gyro_bias_deg_per_h=0.001)
    drive = drive_of(simulated_journey(laps=2, gyro_noise_deg_per_s=1e-4, seed=3))
    # Of a gyro whose scale factor is off by more than all that is stated.
    rate = drive.rate_deg_per_s * 1.002
    inputs = {"gyro_bias": 1e-3, "accelerometer_bias": 1.0, "initial_level": 0.5}
    return made(
        replace(dataset, drive=replace(drive, rate_deg_per_s=rate)), **inputs, initial_heading=0.05
    )


def test_the_first_heading_moves_a_navigated_drive_as_its_sensitivity_says(
    navigated: Findings,
) -> None:
    (heading,) = (q for q in navigated.inputs if q.name == "initial_heading")
    wrong = wrong_sensitivities(navigated, [heading])
    assert {key[1] for key in wrong} & NAVIGATED == set()


@pytest.mark.parametrize("turns", [(360, -360), (360,)], ids=["pairs", "single turns"])
def test_trials_of_turns_agree_with_the_budget(
    turns: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    in_this_process(monkeypatch)
    findings = made(record(1, turns, walk=0.05 if len(turns) > 1 else 0.0))
    whole = combine(findings.estimates, findings.inputs)
    for estimate, linear in zip(tried(findings, 200).estimates, whole, strict=True):
        assert linear is not None
        own = estimate.extra["monte_carlo"]
        assert own["linear_inputs"] == ["checks_x"]
        assert own["agrees"], (estimate.name, own)
        assert own["standard_uncertainty"] == pytest.approx(linear.standard_uncertainty, rel=0.2)


def test_trials_of_a_navigated_drive_agree_where_its_errors_are_larger_than_u(
    navigated: Findings, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_this_process(monkeypatch)
    whole = combine(navigated.estimates, navigated.inputs)
    for estimate, linear in zip(tried(navigated, 100).estimates, whole, strict=True):
        if estimate.name not in NAVIGATED:
            continue
        assert linear is not None
        own = estimate.extra["monte_carlo"]
        assert own["agrees"], (estimate.name, own)
        assert own["standard_uncertainty"] == pytest.approx(linear.standard_uncertainty, rel=0.35)
