"""Three coils at once, records that end by themselves, and repeats under other conditions."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from rlg_records import analysed, codes, off_in_u, record
from rlg_runs import short_run
from shipped import shipped_bench

from procedures.estimation.recorder import find_beat, folded_Hz
from procedures.rlg_magnetic_sensitivity.coils import coil_responses
from procedures.rlg_magnetic_sensitivity.dataset import AXES
from procedures.rlg_magnetic_sensitivity.frequencies import (
    Drive,
    choose,
    second_order,
    third_order,
)
from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters, Stop
from procedures.rlg_magnetic_sensitivity.records import all_records, sensitivity_records
from procedures.rlg_magnetic_sensitivity.stopping import (
    Standing,
    is_enough,
    samples_at_next_look,
)
from station.cli.validating import read_plan_for
from station.files.faults import FaultList
from station.files.lookup import PLANS, find
from station.procedure import procedure_of
from station.record.folder import RunFolder

AT_ONCE = {"excitation": "simultaneous", "duration": "200 s"}
TRUTH = {"IA": 0.05, "NA": -0.04, "LA": 0.03}


def plan(**given: Any) -> RlgParameters:
    common = {
        "amplitude": "1 mT",
        "sample_interval": "0.1 s",
        "duration": "100 s",
        "pulse_weight": "0.0625 arcsec",
        "warm_up": {"slope_limit": "1 deg/h^2"},
    }
    return RlgParameters.model_validate({**common, **given})


def refusal(**given: Any) -> str:
    with pytest.raises(ValidationError) as caught:
        plan(**given)
    return str(caught.value)


@pytest.mark.parametrize("duration_s", [100.0, 137.0, 200.0, 550.0])
def test_chosen_frequencies_make_whole_cycles_and_no_product_falls_on_another(
    duration_s: float,
) -> None:
    (planned,) = sensitivity_records(plan(excitation="simultaneous", duration=f"{duration_s} s"))
    record_s = planned.samples * 0.1
    driven = {axis: sine.frequency_Hz for axis, sine in planned.drive.items()}
    for f in driven.values():
        assert 0.05 - 1e-9 <= f <= 0.2 + 1e-9
        assert f * record_s == pytest.approx(round(f * record_s)) and f * record_s >= 10 - 1e-6
    fitted = [*driven.values(), *(f for _, f in second_order(driven))]
    assert min(abs(a - b) for a, b in combinations(fitted, 2)) * record_s > 2 - 1e-6
    for _, product_Hz in third_order(driven):
        assert min(abs(product_Hz - f) for f in driven.values()) * record_s > 2 - 1e-6


def test_the_frequency_of_the_first_axis_may_be_given_and_the_others_follow() -> None:
    (planned,) = sensitivity_records(plan(frequency="0.11 Hz", **AT_ONCE))
    assert planned.drive["IA"].frequency_Hz == pytest.approx(0.11)
    assert len({round(sine.frequency_Hz, 6) for sine in planned.drive.values()}) == 3


def test_frequencies_that_clash_are_refused_with_one_that_would_do() -> None:
    given = {"IA": "0.07 Hz", "NA": "0.14 Hz", "LA": "0.17 Hz"}
    said = refusal(frequencies=given, **AT_ONCE)
    assert "NA - IA (0.07 Hz) is too close to IA (0.07 Hz)" in said
    assert "NA at 0.15 Hz would do" in said
    assert plan(frequencies={**given, "NA": "0.15 Hz"}, **AT_ONCE)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "is missing"),
        ({"frequency": "0.1 Hz", "frequencies": {"IA": "0.1 Hz"}}, "excitation: simultaneous"),
        ({**AT_ONCE, "axes": ["IA"]}, "two or three axes"),
        ({**AT_ONCE, "frequencies": {"IA": "0.1 Hz"}}, "must name IA, NA, LA"),
        ({**AT_ONCE, "duration": "55 s"}, "take a longer record"),
        ({"frequency": "0.1 Hz", "stop": {"at_most": "1 h"}}, "what ends a record before"),
        (
            {"frequency": "0.1 Hz", "stop": {"early_decision": True, "at_most": "99 s"}},
            "below the least duration",
        ),
        ({"frequency": "0.1 Hz", "checks": ["linearity"], "amplitude": "0.15 mT"}, "at least 0.1"),
    ],
)
def test_what_cannot_be_done_is_refused(given: dict[str, Any], said: str) -> None:
    assert said in refusal(**given)


def test_an_early_decision_needs_a_limit_for_every_axis(tmp_path: Path) -> None:
    text = find(PLANS, "rlg-magnetic-sensitivity").read_text(encoding="utf-8")
    text = text.replace("{max_abs: 0.1", "{IA: {max_abs: 0.1").replace("h/mT}", "h/mT}}", 1)
    text = text.replace("  settle:", "  stop: {early_decision: true, at_most: 1 h}\n  settle:")
    (tmp_path / "plan.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(FaultList, match="no limit for NA, LA"):
        read_plan_for(str(tmp_path / "plan.yaml"), shipped_bench())


def test_coils_at_once_take_a_third_of_the_time_and_stay_within_every_limit() -> None:
    procedure = procedure_of("rlg-magnetic-sensitivity")
    alone, together = plan(frequency="0.1 Hz", duration="200 s"), plan(**AT_ONCE)
    for parameters, records in ((alone, 3), (together, 1)):
        recorded_s = sum(one.samples for one in all_records(parameters)) * 0.1
        assert recorded_s == pytest.approx(200.0 * records)
    assert procedure.duration(together).expected_s < procedure.duration(alone).expected_s - 400.0
    points = procedure.forecast(together, shipped_bench()).set_points
    assert max(one.field_mT or 0.0 for one in points) == pytest.approx(np.sqrt(3.0))
    assert {"S3.2"} == {one.step for one in points if "sine" in one.text}


def test_sensitivities_and_the_coils_directions_come_out_of_one_record() -> None:
    frequencies = choose(AXES, 200.0, 0.1) or {}
    drive = {axis: Drive(f, 1.0) for axis, f in frequencies.items()}
    coils = np.array([[1.01, 0.02, 0.0], [0.0, 0.99, -0.015], [0.01, 0.0, 1.0]])
    segment = record(3, TRUTH, drive, cycles=200.0 * drive["IA"].frequency_Hz, coils=coils)
    analysis = analysed(segment)
    for axis, truth in TRUTH.items():
        assert off_in_u(analysis, axis, truth) < 3.5
    found = coil_responses(analysis.lines, [segment])
    matrix = np.array([found[axis].components for axis in AXES])
    assert matrix == pytest.approx(coils, abs=1e-4)
    assert found["IA"].lean_deg == pytest.approx(
        [np.degrees(np.arctan2(0.02, 1.01)), np.degrees(np.arctan2(0.02, 1.01)), 0.0], abs=0.005
    )


def test_a_record_goes_on_until_every_axis_is_known_or_clear() -> None:
    (planned,) = sensitivity_records(
        plan(frequency="0.1 Hz", axes=["IA"], stop={"early_decision": True, "at_most": "1 h"})
    )
    target = Stop.model_validate({"uncertainty": "0.003 deg/h/mT", "at_most": "1 h"})
    early = Stop.model_validate({"early_decision": True, "at_most": "1 h"})
    far, near = (
        Standing("IA", 0.09, 0.012, (-0.05, 0.05)),
        Standing("NA", 0.04, 0.006, (-0.05, 0.05)),
    )
    assert is_enough([far], early) and not is_enough([far, near], early)
    assert not is_enough([Standing("IA", 0.0, 0.003)], target)
    assert is_enough([Standing("IA", 0.0, 0.0029)], target)
    assert samples_at_next_look([far], target, planned, 1000) == 1600
    almost = [Standing("IA", 0.0, 0.003)]
    assert samples_at_next_look(almost, target, planned, 10000) == 10800
    assert samples_at_next_look([far], target, planned, 35000) == planned.most == 36000


def test_a_beat_of_the_pulses_is_told_with_what_would_help() -> None:
    assert folded_Hz(23.16, 1.0) == pytest.approx(0.16)
    for pulses, told in ((23.0, "stands still"), (23.16, "beats at 0.16"), (23.34, "")):
        drive = {"NA": Drive(0.16, 0.8)}
        segment = record(5, interval_s=1.0, drive=drive, cycles=80.0, sigma=0.06)
        rate = segment.rate_deg_per_h
        rate = rate - rate.mean() + 0.4 * pulses
        angle = np.concatenate(([0.0], np.cumsum(rate))) / 0.4
        counted = np.diff(np.floor(angle)) * 0.4
        analysis = analysed(replace(segment, rate_deg_per_h=counted, quantum_deg_per_h=0.4))
        flags = [flag for flag in analysis.flags if flag.code == "quantisation-beat"]
        assert len(flags) == bool(told), codes(analysis)
        for flag in flags:
            assert told in flag.message and "azimuth" in flag.message
            interval_s, f = (
                flag.details["sample_interval_s"],
                flag.details.get("frequency_Hz", 0.16),
            )
            assert isinstance(interval_s, float) and isinstance(f, float)
            assert find_beat(0.4 * pulses, 0.4, interval_s, 1e-3, [0.16], 500.0) is None
            assert f == 0.16 or find_beat(0.4 * pulses, 0.4, 1.0, 1e-3, [f], 500.0) is None


@pytest.mark.campaign
def test_a_run_with_all_coils_at_once_ends_by_itself_and_recovers_the_truth(
    tmp_path: Path,
) -> None:
    outcome, truth = short_run(
        tmp_path,
        {
            "parameters/excitation": "simultaneous",
            "parameters/duration": "100 s",
            "parameters/stop": {"uncertainty": "0.007 deg/h/mT", "at_most": "10 min"},
            "parameters/checks": ["background"],
        },
    )
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    for result in outcome.document.results:
        assert result.combined is not None and result.estimate.value is not None
        u = result.combined.standard_uncertainty
        assert u < 0.007
        assert abs(result.estimate.value - truth[str(result.estimate.axis)]) < 3.5 * u
        assert result.to_data()["coil_field"][result.estimate.axis] == pytest.approx(1, abs=0.01)
        assert [one["check"] for one in result.to_data()["checks"]] == ["background"]
    folder = RunFolder(outcome.folder)
    units = folder.finished_units()
    assert list(units) == ["warm-up", "IA-NA-LA", "background"]
    assert 1000 < units["IA-NA-LA"]["samples"] < 6000
    on, off = (
        [event.time_s for event in folder.events_of(kind)] for kind in ("field-on", "field-off")
    )
    assert len(on) == len(off) == 3 and max(on) < min(off)
    largest_mT = 1e3 * max(np.abs(folder.rows("gaussmeter", "background")["x_T"]))
    assert largest_mT < 0.1
