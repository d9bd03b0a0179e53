"""The tumble test from end to end on the simulated bench: the world's accelerometer comes out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.kills import PER_DEGC, warmth_K
from plan_runs import run_of, shipped_bench, shipped_plan
from quick_yaml import dump_yaml
from short_forms import read_bench_at

import procedures.accelerometer_tumble
from procedures.accelerometer_tumble import PROCEDURE, check
from procedures.accelerometer_tumble.figures import draw_parts
from procedures.accelerometer_tumble.outlook import expected_u
from procedures.accelerometer_tumble.parameters import TumbleParameters
from station.cli.validating import read_plan_for
from station.files.faults import FaultList
from station.record.folder import RunFolder
from station.runner.evaluation import evaluate_run
from station.runner.outcome import Outcome

NAME = "accelerometer-tumble"
SEEDS = (0, 1, 2)
SHORT = {"positions": 8, "warm_up": "30 min", "dwell": "2 s"}
ARCSEC_PER_RAD = 3600.0 * 180.0 / math.pi


def bench_of(seed: int) -> dict[str, Any]:
    """Return the bench with every error that stands in the budget drawn by a seed."""
    bench, rng = shipped_bench(), np.random.default_rng((seed, 73))
    meter, stage = (bench["instruments"][name] for name in ("multimeter", "rotary_stage"))
    meter["simulator"] |= {
        "gain_error": f"{17.5 * rng.standard_normal():.3f} ppm",
        "offset": f"{3.5 * rng.standard_normal():.3f} uV",
    }
    stage["simulator"]["encoder_offset"] = f"{10.0 * rng.standard_normal():.3f} arcsec"
    truth = bench["simulation"]
    truth["seed"] = seed
    truth["tumble"] |= {
        "local_gravity": f"{0.9996 + 20e-6 * rng.standard_normal():.7f} g",
        "fixture_error": f"{rng.uniform(40.0, 120.0):.2f} arcsec",
    }
    # The zero of K0 would otherwise be that of a drift, which only the simulator knows.
    truth["accelerometer"]["drift_in_one_hour"] = "0 uV"
    truth["accelerometer"]["warm_up"]["amplitude"] = "0 uV"
    return bench


def number(text: object) -> float:
    return float(str(text).split()[0])


def true_of(bench: Mapping[str, Any], folder: Path) -> dict[str, float]:
    """Return the true coefficients, K0 and Ki at the mean temperature of the positions."""
    given = bench["simulation"]["accelerometer"]["coefficients"]
    true = {name: number(text) for name, text in given.items()}
    for name, per_degC in PER_DEGC.items():
        true[name] += per_degC * warmth_K(folder)
    fixture = number(bench["simulation"]["tumble"]["fixture_error"]) / ARCSEC_PER_RAD
    return {**true, "Kf": true["Ki"] * fixture}


def errors(outcome: Outcome, bench: Mapping[str, Any]) -> dict[str, float]:
    """Return by how many u each result is off."""
    assert outcome.exit_code in (0, 6), outcome.error
    assert outcome.document is not None
    results = {(one["name"], one["axis"]): one for one in outcome.document.to_data()["results"]}
    true = true_of(bench, outcome.folder)
    bias = sum(share * true.get(name, 0.0) for name, share in results["K0", None]["terms"].items())
    expected = {
        "bias": bias / true["Ki"],
        "misalignment o": true["Ko"] / true["Ki"] * ARCSEC_PER_RAD,
        "misalignment p": true["Kp"] / true["Ki"] * ARCSEC_PER_RAD,
        "fixture_error": true["Kf"] / true["Ki"] * ARCSEC_PER_RAD,
    }
    off = {}
    for (name, axis), result in results.items():
        if result["value"] is None:
            continue
        what = f"{name} {axis}" if axis else name
        terms = result.get("terms", {})
        is_true = expected.get(what, sum(part * true.get(own, 0.0) for own, part in terms.items()))
        off[what] = (result["value"] - is_true) / result["standard_uncertainty"]
    return off


Runs = list[tuple[Outcome, dict[str, Any]]]


@pytest.fixture(scope="module", params=[SEEDS, pytest.param(range(24), marks=pytest.mark.campaign)])
def runs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """A run for each seed, as the shipped plan with fewer positions."""
    folder, made = tmp_path_factory.mktemp("tumble"), []
    for seed in request.param:
        plan, bench = shipped_plan(NAME), bench_of(seed)
        plan["parameters"] |= SHORT
        made.append((run_of(folder / f"seed-{seed}", plan, bench), bench))
    return made


def test_the_true_coefficients_come_back(runs: Runs) -> None:
    off = [errors(*one) for one in runs]
    assert {"K0", "Ki", "Kii", "Kiii", "Kio", "Kip", "Koo", "Kf", "Ko", "Kp"} < off[0].keys()
    every = np.array([list(one.values()) for one in off])
    assert np.mean(np.abs(every) < 3.0) >= 0.98, off
    assert 0.3 < np.mean(every**2) < 1.6


def test_each_position_is_a_unit_of_its_own(runs: Runs) -> None:
    units = list(RunFolder(runs[0][0].folder).finished_units())
    assert len(units) == 4 * 2 * SHORT["positions"]
    assert units[0] == "io up 0 deg" and units[16] == "io-reversed up 0 deg"
    assert units[8] == "io down 315 deg" and units[-1] == "ip-reversed down 0 deg"


def test_the_record_gives_the_same_results_again_and_plots(runs: Runs) -> None:
    outcome = runs[0][0]
    assert outcome.document is not None
    again, findings = evaluate_run(RunFolder(outcome.folder))
    assert again.to_data()["results"] == outcome.document.to_data()["results"]
    titles = [part.title for part in draw_parts(findings, again)]
    assert titles == [
        "Output and residuals by angle",
        "Residuals and drift over time",
        "Angles of encoder and mountings",
    ]


def test_the_budget_holds_what_plan_and_records_state(runs: Runs) -> None:
    document = runs[0][0].document
    assert document is not None
    data = document.to_data()
    of_type_b = {
        one["name"]: {line["description"]: line["source"] for line in one.get("budget", ())}
        for one in data["results"]
    }
    scale, fixture = of_type_b["Ki"], of_type_b["fixture_error"]
    assert scale["local gravity"] == scale["mountings, 1 arcsec each"] == "the plan"
    assert "SIM-DMM-0001" in scale["gain of the multimeter"]
    assert "SIM-STAGE-0001" in scale["harmonics of the encoder, 1 arcsec each"]
    assert "SIM-STAGE-0001" in fixture["zero of the angle of rotary_stage"]
    assert not {flag["code"] for flag in data["flags"]} & {"uncalibrated", "calibration-unused"}


def test_the_outlook_says_what_a_plan_determines() -> None:
    plan = {**shipped_plan(NAME)["parameters"], "mountings": ["io"]}
    one = TumbleParameters.model_validate(plan)
    undetermined = PROCEDURE.undetermined(one)
    assert {"Kf", "Ko", "K0", "Koo", "misalignment", "fixture_error"} < undetermined.keys()
    assert undetermined["misalignment"].startswith("this plan does not determine misalignment p;")
    assert PROCEDURE.outlook(one)[0] == "48 positions in 1 mountings"
    encoder = {"encoder_accuracy": "1 arcsec", "mounting_repeatability": "1 arcsec"}
    four = TumbleParameters.model_validate(shipped_plan(NAME)["parameters"] | encoder)
    turned = TumbleParameters.model_validate(
        shipped_plan(NAME)["parameters"] | encoder | {"heads": ["0 deg", "90 deg"]}
    )
    (terms, u), (_, u_turned) = expected_u(four), expected_u(turned)
    third = list(terms).index("Kiii")
    assert u[third] == pytest.approx(9.8e-6, rel=0.02)
    assert u_turned[third] < 1e-6


def test_a_dry_run_asks_for_each_mounting_once() -> None:
    plan = shipped_plan(NAME)["parameters"] | {"heads": ["0 deg", "90 deg"]}
    walk = PROCEDURE.walk(TumbleParameters.model_validate(plan))
    asked = [prompt.id for prompt in walk.prompts]
    assert asked[:3] == ["connect-cables", "mount-io", "mount-io-reversed"]
    assert asked[-1] == "mount-ip-reversed-head-90"
    assert len(asked) == 9
    assert len(walk.units) == 2 * 4 * 48
    pictures = Path(procedures.accelerometer_tumble.__file__).parent / "pictures"
    assert all((pictures / prompt.picture).exists() for prompt in walk.prompts)


def test_a_bench_without_the_roles_refuses_it_by_a_sentence(tmp_path: Path) -> None:
    bench = shipped_bench()
    del bench["instruments"]["rotary_stage"]
    bench["safe_state"] = [at for at in bench["safe_state"] if at["role"] != "rotary_stage"]
    path = tmp_path / "bench.yaml"
    path.write_text(dump_yaml(bench), encoding="utf-8")
    with pytest.raises(FaultList, match="has no rotary_stage, which this plan needs"):
        read_plan_for(NAME, read_bench_at(path), ())


def test_an_encoder_of_which_nobody_states_how_well_it_is_is_refused(tmp_path: Path) -> None:
    bench = shipped_bench()
    del bench["instruments"]["rotary_stage"]["calibration"]
    parameters = TumbleParameters.model_validate(shipped_plan(NAME)["parameters"])
    path = tmp_path / "bench.yaml"
    path.write_text(dump_yaml(bench), encoding="utf-8")
    (problem,) = check(parameters, read_bench_at(path))
    assert "states no graduation; state encoder_accuracy" in problem.what


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"mountings": []}, "name at least one"),
        ({"mountings": ["io", "io"]}, "each once"),
        ({"heads": ["45 deg"]}, "turned by 0, 90, 180 or 270 deg"),
    ],
)
def test_a_plan_that_nobody_can_mount_is_refused(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        TumbleParameters.model_validate(shipped_plan(NAME)["parameters"] | change)


def test_an_overload_is_measured_again_on_a_higher_range(tmp_path: Path) -> None:
    plan = shipped_plan(NAME)
    one = {"mountings": ["io"], "scale_factor": "0.08 V/g", "positions": 8}
    plan["parameters"] |= {**SHORT, **one}
    plan["limits"] = {}
    outcome = run_of(tmp_path, plan, shipped_bench())
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    (flag,) = [one for one in outcome.document.flags if one.code == "overload"]
    assert "higher range" in flag.message
    found = {one.estimate.name: one.estimate for one in outcome.document.results}
    assert found["Ki"].value == pytest.approx(1.0003, abs=3e-4)


def test_the_fixture_turned_on_the_head_determines_the_third_order(tmp_path: Path) -> None:
    plan, bench = shipped_plan(NAME), bench_of(5)
    plan["parameters"] |= {**SHORT, "heads": ["0 deg", "90 deg"], "up_and_down": False}
    outcome = run_of(tmp_path, plan, bench)
    off = errors(outcome, bench)
    assert max(abs(one) for one in off.values()) < 3.5, off
    assert outcome.document is not None
    third = outcome.document.result("Kiii").to_data()
    assert third["standard_uncertainty"] < 5e-6
