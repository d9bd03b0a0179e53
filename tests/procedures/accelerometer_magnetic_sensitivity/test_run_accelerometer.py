"""The accelerometer procedure from end to end on the simulated bench, over real sockets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.kills import warmth_K
from plan_runs import run_of, shipped_bench, shipped_plan
from served_bench import served_bench

from procedures.accelerometer_magnetic_sensitivity.outlook import expectation, outlook
from station.cli.analysing import analyse_run
from station.cli.validating import read_served
from station.files.plan import read_plan
from station.procedure import Procedures
from station.record.folder import RunFolder
from station.runner.outcome import Outcome

PROCEDURE = "accelerometer-magnetic-sensitivity"
SEEDS = (0, 1, 2)
SHORT = {"design": "efficient", "largest_field": "50 mT", "warm_up": "10 s", "readings": 3}


def short_run(
    folder: Path, parameters: dict[str, Any] | None = None, seed: int = 0
) -> tuple[Outcome, dict[str, float]]:
    """Run a plan of nine angles and three fields; return the true coefficients beside it."""
    bench_data = shipped_bench()
    plan_data = shipped_plan(PROCEDURE)
    plan_data["parameters"] = {**SHORT, **(parameters or {})}
    truth = bench_data["simulation"]["accelerometer"]
    bench_data["simulation"]["seed"] = seed
    # The zero of K0 would otherwise be that of a drift, which only the simulator knows.
    truth["drift_in_one_hour"], truth["warm_up"]["amplitude"] = "0 uV", "0 uV"
    outcome = run_of(folder, plan_data, bench_data)
    return outcome, {
        name: float(str(text).split()[0]) for name, text in truth["coefficients"].items()
    }


@pytest.fixture(scope="module", params=[SEEDS[:1], pytest.param(SEEDS, marks=pytest.mark.campaign)])
def runs(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> list[tuple[Outcome, dict[str, float]]]:
    """A short run for each seed."""
    folder = tmp_path_factory.mktemp("accelerometer")
    return [short_run(folder / f"seed-{seed}", seed=seed) for seed in request.param]


def test_the_true_coefficients_and_combinations_come_back(
    runs: list[tuple[Outcome, dict[str, float]]],
) -> None:
    errors = []
    for outcome, truth in runs:
        assert outcome.exit_code == 0, outcome.error
        assert outcome.document is not None
        warmer_K = warmth_K(outcome.folder)
        true = {**truth, "K0": truth["K0"] + 30e-6 * warmer_K, "Ki": truth["Ki"] + 1e-4 * warmer_K}
        for result in outcome.document.to_data()["results"]:
            if result["value"] is None:
                continue
            expected = sum(share * true[name] for name, share in result["terms"].items())
            errors.append((result["value"] - expected) / result["standard_uncertainty"])
    assert len(errors) == 12 * len(runs)
    assert np.mean(np.abs(errors) < 3) >= 0.95
    assert 0.2 < np.mean(np.square(errors)) < 2.0


def test_the_fold_of_one_gravity_is_named_and_not_guessed(
    runs: list[tuple[Outcome, dict[str, float]]],
) -> None:
    document = json.loads((runs[0][0].folder / "results.json").read_text(encoding="utf-8"))
    results = {one["name"]: one for one in document["results"]}
    assert len(results) == 13
    assert results["Kpp"]["value"] is None
    assert results["K0"]["terms"] == {"K0": 1, "Kpp": 1}
    flag = next(one for one in document["flags"] if one["code"] == "not-identifiable")
    assert set(flag["coefficients"]) == {"K0", "Kii", "Koo", "Kpp"}


def test_every_point_is_a_unit_and_a_new_analysis_gives_the_same_bytes(
    runs: list[tuple[Outcome, dict[str, float]]],
) -> None:
    folder = runs[0][0].folder
    assert len(RunFolder(folder).finished_units()) == 2 * 9 * 3
    analyse_run(folder, None, compare=False)
    again = (folder / "revisions" / "001" / "results.json").read_bytes()
    assert again == (folder / "results.json").read_bytes()


def test_a_level_turn_determines_three_combinations_only(tmp_path: Path) -> None:
    outcome, _ = short_run(tmp_path, {"planes": ["level"], "angles": ["0 deg", "120 deg"]})
    assert outcome.document is not None
    found = {one.estimate.name: one.estimate for one in outcome.document.results}
    assert [name for name, one in found.items() if one.value is not None] == ["K0", "Km", "Kmm"]
    assert found["Km"].extra["terms"] == {"Km": 1, "Kpm": 1}


def test_the_outlook_of_a_level_turn_expects_the_u_of_its_run(tmp_path: Path) -> None:
    wanted = {"planes": ["level"], "angles": ["0 deg", "120 deg"], "scale_factor": "2 V/g"}
    outcome, _ = short_run(tmp_path, wanted)
    assert outcome.document is not None
    parameters = read_plan(tmp_path / "plan.yaml", Procedures()).parameters
    # No point tells Ki: plan and analysis take the stated 2 V/g for how a lean moves K0.
    foreseen = expectation(parameters).standard_uncertainty["K0"]
    u = outcome.document.result("K0").to_data()["standard_uncertainty"]
    assert foreseen == pytest.approx(1e-3, rel=0.01)
    assert u == pytest.approx(foreseen, rel=0.01)
    assert any("mounting from K0: u holds 0.5 mrad" in line for line in outlook(parameters))


def test_an_overload_is_flagged_and_its_point_measured_on_a_higher_range(tmp_path: Path) -> None:
    parameters = {"planes": ["io"], "scale_factor": "0.08 V/g"}
    outcome, _ = short_run(tmp_path, parameters)
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    assert "overload" in {flag.code for flag in outcome.document.flags}
    folder = RunFolder(outcome.folder)
    widened = list(folder.events_of("overload"))
    assert widened
    assert widened[0].details["next_range_V"] > widened[0].details["range_V"]
    ki = next(one for one in outcome.document.results if one.estimate.name == "Ki")
    assert ki.estimate.value == pytest.approx(1.0003, abs=3e-4)


def test_the_published_estimate_stands_beside_the_best(
    runs: list[tuple[Outcome, dict[str, float]]],
) -> None:
    document = json.loads((runs[0][0].folder / "results.json").read_text(encoding="utf-8"))
    published = {one["name"]: one for one in document["as_published"]}
    assert published["Km"]["method"] == "finite-memory"
    assert published["Km"]["value"] == pytest.approx(0.0152, abs=1e-3)
    assert published["Kpp"]["value"] is None


@pytest.mark.campaign
def test_a_served_bench_is_mounted_anew_for_each_plane(tmp_path: Path) -> None:
    with served_bench(tmp_path, 200.0, procedure=PROCEDURE) as (head, _):
        plan = shipped_plan(PROCEDURE)
        angles = [f"{angle} deg" for angle in range(0, 360, 45)]
        few = {"planes": ["io", "ip"], "angles": angles, "fields": ["0 mT", "30 mT"]}
        few |= {"largest_field": "30 mT", "design": "as_published", "degauss": False}
        plan["parameters"] = {**SHORT, **few}
        outcome = run_of(tmp_path, plan, shipped_bench(), served=read_served(head))
    assert outcome.document is not None, outcome.error
    found = {one.estimate.name: one.estimate for one in outcome.document.results}
    assert found["Ki"].value == pytest.approx(1.0002, abs=1e-3)
    # A device left in the first plane would make the pendulous axis look like the output axis.
    assert found["Kip"].value == pytest.approx(-7e-6, abs=3e-5)
    assert found["Kio"].value == pytest.approx(-12e-6, abs=3e-5)
    asked = [event.details for event in RunFolder(outcome.folder).events_of("prompt")]
    mounted = [one["answer"] for one in asked if one["id"].startswith("mount-")]
    assert len(mounted) == 2
    assert all("simulated accelerometer was mounted" in answer for answer in mounted)
