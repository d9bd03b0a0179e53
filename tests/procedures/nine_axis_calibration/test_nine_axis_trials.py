"""The nine-axis analysis tried again: inputs that act on records, stands that lean, and noise."""

from __future__ import annotations

import numpy as np
import pytest
from nine_axis_stands import EDGES, FACES, Bench, write
from trials import in_this_process, trials_in, tried, with_inputs, wrong_sensitivities

from procedures.nine_axis_calibration.evaluate import findings_of_dataset
from procedures.nine_axis_calibration.trials import Recorded
from station.dataset_reading import read_dataset
from station.findings import Findings
from station.uncertainty import combine

U = {"latitude": 1e-3, "time_scale": 1e-6, "prior_local_gravity": 1e-5}
"""Of the inputs that are one number each."""
TRIALS, SCATTER = 60, 0.35
DOUBTED = {"nonlinearity", "g_sensitivity"}
"""A largest value of several is no linear result."""


@pytest.fixture(scope="module")
def findings(tmp_path_factory: pytest.TempPathFactory) -> Findings:
    data = Bench(9, poses=(*FACES, *EDGES[:3])).data()
    return findings_of_dataset(read_dataset(write(data, tmp_path_factory.mktemp("trials"))))


def test_each_input_does_to_the_data_what_its_sensitivity_says(findings: Findings) -> None:
    assert wrong_sensitivities(with_inputs(findings, **U), with_inputs(findings, **U).inputs) == {}


def test_every_input_acts_on_the_data_and_leaves_their_shape(findings: Findings) -> None:
    trials, random = trials_in(findings), np.random.default_rng(2)
    named = {quantity.name for quantity in findings.inputs}
    assert named <= {*trials.perturbed, *trials.drawn}
    for draw in (*trials.drawn.values(), lambda data, u, random: trials.noisy(data, random)):
        other = draw(trials.dataset, 1.0, random)
        assert isinstance(other, Recorded)
        for sort in ("static", "turns"):
            own, theirs = (getattr(data.dataset, sort) for data in (other, trials.dataset))
            assert len(own) == len(theirs)
            for record, before in zip(own, theirs, strict=True):
                assert record.time_s.shape == before.time_s.shape


def test_trials_agree_with_the_budget(findings: Findings, monkeypatch: pytest.MonkeyPatch) -> None:
    in_this_process(monkeypatch)
    whole = combine(findings.estimates, findings.inputs)
    for estimate, linear in zip(tried(findings, TRIALS).estimates, whole, strict=True):
        if linear is None:
            continue
        own = estimate.extra["monte_carlo"]
        assert own["linear_inputs"] == []
        if estimate.name not in DOUBTED:
            assert own["agrees"], (estimate.name, estimate.axis, own)
            assert own["standard_uncertainty"] == pytest.approx(
                linear.standard_uncertainty, rel=SCATTER
            )
