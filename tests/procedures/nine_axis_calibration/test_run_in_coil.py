"""The magnetometer in the three-axis coil within a run, beside the turns in the earth's field."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.truths import number
from places import ROOT
from plan_runs import run_of, shipped_bench, shipped_plan
from quick_yaml import dump_yaml
from test_run_nine_axis import SHORT
from trials import in_this_process, trials_in, tried, wrong_sensitivities

from procedures.nine_axis_calibration import PROCEDURE
from procedures.nine_axis_calibration.all_axes.stands import CoilRecord
from procedures.nine_axis_calibration.all_axes.two_ways import (
    Compared,
    disagreements,
    not_as_commanded,
)
from procedures.nine_axis_calibration.evaluate import findings_with, records_of_run
from procedures.nine_axis_calibration.parameters import NineAxisParameters
from procedures.nine_axis_calibration.trials import Recorded
from station.findings import Estimate
from station.record.folder import RunFolder
from station.recorded import read_plan_and_bench
from station.runner.evaluation import evaluate_run
from station.runner.outcome import Outcome
from station.runner.resuming import ResumeRequest, resume
from station.uncertainty import combine

PLAN = "nine-axis-calibration-coil"
IN_COIL = {"levels": ["60 uT"], "record": "5 s"}
OFFSET, SCALE, LEAN = (
    f"magnetometer_{what}" for what in ("offset", "scale_factor", "misalignment")
)
WITHIN_U = 3.5
TRIALS, SCATTER = 30, 0.45


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """One short run on the shipped bench."""
    return run_with(tmp_path_factory.mktemp("coil"), shipped_bench())


def short_plan() -> dict[str, Any]:
    plan = shipped_plan(PLAN)
    plan["parameters"] |= SHORT | {"static_time": "20 s", "magnetometer_in_coil": IN_COIL}
    plan["limits"] = {SCALE: {"min": 0.9, "max": 1.1}}
    return plan


def run_with(folder: Path, bench: dict[str, Any]) -> Outcome:
    return run_of(folder, short_plan(), bench)


def recorded_in(run: Outcome) -> Recorded:
    """Return what the analysis of the run takes."""
    _, findings = evaluate_run(RunFolder(run.folder))
    recorded: Recorded = trials_in(findings).dataset
    return recorded


def coil_of(run: Outcome) -> CoilRecord:
    """Return the run's fields in the coil."""
    others = recorded_in(run).others
    assert others is not None
    assert others.coil is not None
    return others.coil


def magnetic(outcome: Outcome) -> dict[tuple[str, str], Any]:
    assert outcome.document is not None, outcome.error
    return {
        (result.estimate.name, str(result.estimate.axis)): result
        for result in outcome.document.results
        if result.estimate.name in (OFFSET, SCALE, LEAN)
    }


def denied(outcome: Outcome) -> dict[str, list[str]]:
    """Return the axes in which coil and turns deny each other, by what they deny."""
    assert outcome.document is not None
    return {
        flag.details["statement"]: flag.details["axes"]
        for flag in outcome.document.flags
        if flag.code == "contradicts-statement" and "axes" in flag.details
    }


def test_coil_and_turns_agree_with_each_other_and_with_the_truth(run: Outcome) -> None:
    outcome = run
    assert outcome.exit_code == 0, outcome.error
    results = magnetic(outcome)
    assert len(results) == 12
    assert denied(outcome) == {}
    true = shipped_bench()["simulation"]["nine_axis"]["sensor"]["magnetometers"]
    for (name, axis), result in results.items():
        own = result.estimate.extra["in_coil"]
        assert abs(own["normalised_error"]) < 1.5, (name, axis, own)
        off = own["difference"] / own["difference_uncertainty"]
        assert own["normalised_error"] == pytest.approx(off / 2.0)
        assert np.hypot.reduce([*own["contributions"].values()]) == pytest.approx(
            own["standard_uncertainty"]
        )
        if name == LEAN:
            assert own["frame"] == "coil"
            assert own["standard_uncertainty"] > 1000.0  # 0.3 deg
            continue
        wanted = number(true["offset"][axis.lower()])
        if name == SCALE:
            wanted = 1.0 + number(true["scale_factor_error"][axis.lower()]) / 100.0
        for value, u in (
            (result.estimate.value, result.combined.standard_uncertainty),
            (own["value"], own["standard_uncertainty"]),
        ):
            assert abs(value - wanted) < WITHIN_U * u, (name, axis, value, u)
    finished = RunFolder(outcome.folder).finished_units()
    assert [unit for unit in finished if unit.startswith("coil")] == [
        f"coil {coil} {field} uT" for coil in "xyz" for field in ("+0", "+60", "-60")
    ]


def test_trials_of_a_sensor_that_gives_its_axes_in_turn_hold_the_budget(
    run: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The accelerometers are not determined: what leans must not make the turns' fit fail."""
    in_this_process(monkeypatch)
    _, findings = evaluate_run(RunFolder(run.folder))
    turned = [e for e in findings.estimates if e.name in (OFFSET, SCALE, LEAN)]
    whole = combine(turned, findings.inputs)
    tried_again = {(e.name, e.axis): e for e in tried(findings, TRIALS).estimates}
    for estimate, linear in zip(turned, whole, strict=True):
        own = tried_again[estimate.name, estimate.axis].extra["monte_carlo"]
        assert linear is not None
        assert own["undetermined"] == 0
        assert own["agrees"], (estimate.name, estimate.axis, own)
        ratio = own["standard_uncertainty"] / linear.standard_uncertainty
        assert ratio == pytest.approx(1.0, abs=SCATTER)


def test_the_coils_part_of_the_field_is_that_at_the_sensor(run: Outcome) -> None:
    coil = coil_of(run)
    at = coil.at_device
    assert at is not None
    assert coil.commanded_nT is not None
    read = coil.carried(np.linalg.inv(at.matrix))
    assert read.ambient_nT == pytest.approx(coil.ambient_nT, abs=1e-6)
    driven = coil.commanded_nT.any(axis=1)
    moved = coil.applied_nT - read.applied_nT
    assert np.abs(moved[~driven]).max() < 1.0
    assert np.abs(moved[driven]).max() > 10.0
    for (name, axis), result in magnetic(run).items():
        own = result.estimate.extra["in_coil"]
        assert {"probe_x_mm", "device_z_mm", "coil_y_radius_mm"} <= {*own["contributions"]}
        if name == SCALE:
            ratio, u = at.ratio(axis.lower())
            assert own["field_at_device"] == {"ratio": ratio, "standard_uncertainty": u}


def test_places_of_coils_probe_and_sensor_do_what_their_sensitivities_say(run: Outcome) -> None:
    at = coil_of(run).at_device
    assert at is not None
    off_centre = at.stated_mm | {"device_x_mm": 30.0, "device_y_mm": 25.0, "device_z_mm": -20.0}
    at = replace(at, lengths_mm={name: (value, 0.2) for name, value in off_centre.items()})
    recorded = recorded_in(run)
    dataset, others = recorded.dataset, recorded.others
    assert others is not None
    commanded = np.tile(np.kron(np.eye(3), np.array([[0.0], [6e4], [-6e4]])), (4, 1))
    applied = commanded + np.array([2e4, 5e2, -4.8e4])
    gain = np.array([[1.01, 0.02, -0.01], [0.005, 0.98, 0.01], [-0.02, 0.01, 1.03]])
    noise = 1e-4 * np.random.default_rng(1).standard_normal(applied.shape)
    coil = CoilRecord(
        applied, applied @ gain.T + noise + 300.0, 0.0, 0.0, 0.0, commanded, at_device=at
    )
    rests = tuple(replace(rest, field_nT=None) for rest in others.rests)
    findings = findings_with(dataset, replace(others, rests=rests, mountings=(), coil=coil), ())
    own = [e for e in findings.estimates if e.name in (OFFSET, SCALE, LEAN)]
    assert {e.extra["frame"] for e in own} == {"coil"}
    assert all("probe_x_mm" in e.sensitivities for e in own)
    findings = replace(findings, estimates=own, inputs=[*at.inputs])
    assert wrong_sensitivities(findings, findings.inputs) == {}


def test_without_the_coils_geometry_the_field_is_that_at_the_probe(run: Outcome) -> None:
    folder = RunFolder(run.folder)
    plan, bench = read_plan_and_bench(folder)
    bench = replace(bench, file=bench.file.model_copy(update={"coil_geometry": None}))
    _, others = records_of_run(folder, plan.parameters, bench)
    assert others is not None
    assert others.coil is not None
    assert others.coil.at_device is None
    coil = coil_of(run)
    assert coil.at_device is not None
    read = coil.carried(np.linalg.inv(coil.at_device.matrix))
    assert read.applied_nT == pytest.approx(others.coil.applied_nT)


KILLED = """
import os, sys
from pathlib import Path
from procedures.nine_axis_calibration.in_coil import Sensing
from plan_runs import run_of
from quick_yaml import load_yaml

folder, during = Path(sys.argv[1]), sys.argv[2]
take, began = Sensing.take, {}

def until_the_middle(sensing):
    came, now_s = take(sensing), sensing._run.now_s
    if sensing.unit == during and now_s > began.setdefault(during, now_s) + 4.0:
        os.kill(os.getpid(), 9)
    return came

Sensing.take = until_the_middle
plan, bench = (load_yaml((folder / name).read_text("utf-8")) for name in ("plan", "bench"))
run_of(folder, plan, bench)
"""


def test_a_run_that_is_killed_in_the_coil_goes_on_with_the_field_that_it_was_in(
    tmp_path: Path,
) -> None:
    during = "coil y +60 uT"
    for name, data in (("plan", short_plan()), ("bench", shipped_bench())):
        (tmp_path / name).write_text(dump_yaml(data), encoding="utf-8")
    command = [sys.executable, "-c", KILLED, tmp_path, during]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests" / "support")}
    killed = subprocess.run(command, env=environment, check=False, capture_output=True)
    assert killed.returncode == -9, killed.stderr
    (path,) = (tmp_path / "runs").glob("[!.]*")
    before = RunFolder(path).finished_units()
    assert [*before][-1] == "coil y +0 uT"
    outcome = resume(ResumeRequest(path, quiet=True, report=False))
    assert outcome.exit_code == 0, outcome.error
    folder = RunFolder(path)
    units = folder.finished_units()
    assert {name: units[name] for name in before} == before
    assert [*units][len(before) :] == [
        during,
        "coil y -60 uT",
        *(f"coil z {field} uT" for field in ("+0", "+60", "-60")),
    ]
    asked = [event.details["id"] for event in folder.events_of("prompt")]
    assert asked.count("mount-in-coil") == 2
    assert denied(outcome) == {}
    assert len(magnetic(outcome)) == 12
    assert outcome.document is not None
    assert "resumed" in {flag.code for flag in outcome.document.flags}


@pytest.mark.parametrize("what", ["coil", "gaussmeter"])
def test_an_error_of_three_per_cent_is_flagged(tmp_path: Path, what: str) -> None:
    """A coil constant leaves the results as they are; a gaussmeter's gain does not."""
    bench = shipped_bench()
    if what == "coil":
        bench["instruments"]["coil_supply.y"]["settings"]["coil_constant"] = "0.343 mT/A"
    else:
        bench["instruments"]["gaussmeter"]["simulator"]["gain_error"] = dict.fromkeys("xyz", "3 %")
    outcome = run_with(tmp_path, bench)
    assert outcome.document is not None, outcome.error
    off = {
        flag.axis: flag.details["relative_difference"]
        for flag in outcome.document.flags
        if flag.code == "field-differs-from-commanded"
    }
    if what == "coil":
        assert set(off) == {"Y"}
        assert off["Y"] == pytest.approx(-0.03, abs=0.006)
        assert denied(outcome) == {}
        return
    assert set(off) == {"X", "Y", "Z"}
    assert denied(outcome) == {"gaussmeter_gain": ["X", "Y", "Z"]}
    for axis in "XYZ":
        own = magnetic(outcome)[SCALE, axis].estimate.extra["in_coil"]
        assert own["difference"] == pytest.approx(-0.03, abs=0.004)


def test_the_coil_is_the_last_step_and_the_device_is_off_after_it() -> None:
    data = shipped_plan(PLAN)["parameters"]
    parameters = NineAxisParameters.model_validate(data)
    walk = PROCEDURE.walk(parameters)
    assert [unit for unit in walk.units if unit.startswith("coil")] == [
        level.unit for level in parameters.coil_fields
    ]
    assert walk.prompts[-1].id == "mount-in-coil"
    without = NineAxisParameters.model_validate({**data, "magnetometer_in_coil": None})
    assert not [unit for unit in PROCEDURE.walk(without).units if unit.startswith("coil")]
    assert PROCEDURE.walk(without).prompts[-1].id == "mount-table"


def test_a_level_that_stands_twice_is_refused() -> None:
    given = {"latitude": "40 deg", "magnetometer_in_coil": {"levels": ["60 uT", "0.06 mT"]}}
    with pytest.raises(ValueError, match=r"0\.06 mT stands twice"):
        NineAxisParameters.model_validate(given)


def compared(name: str, in_turns: float, in_coil: float) -> Compared:
    one, other = (
        Estimate(name, "X", value, "1", 0.001, None, "least-squares")
        for value in (in_turns, in_coil)
    )
    return Compared(one, 0.001, other, {"prior_gaussmeter_gain": 0.0025})


def test_the_two_ways_disagree_where_chance_does_not_make_the_difference() -> None:
    alike, apart = compared(SCALE, 1.0, 1.008), compared(SCALE, 1.0, 0.99)
    assert alike.agrees
    assert alike.normalised_error == pytest.approx(0.008 / 2.0 / np.hypot(0.001, 0.0025))
    assert [*disagreements([alike])] == []
    (flag,) = disagreements([alike, apart])
    assert flag.details["statement"] == "gaussmeter_gain"
    assert flag.details["normalised_error"] == pytest.approx(-1.857, abs=0.01)


def test_a_coil_whose_field_is_not_as_commanded_is_named() -> None:
    commanded = np.kron(np.eye(3), np.array([[0.0], [6e4], [-6e4]]))
    applied = commanded * [1.0, 0.985, 1.004] + [2e4, 0.0, -4e4]
    record = CoilRecord(applied, applied, 0.0025, 500.0, 5e-3, commanded)
    (flag,) = not_as_commanded(record)
    assert flag.axis == "Y"
    assert flag.details["relative_difference"] == pytest.approx(-0.015)
