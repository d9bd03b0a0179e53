"""A plan for a gyro over temperature: published ranges, a schedule that fits, what to expect."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from places import CONFIG
from pydantic import ValidationError

from procedures.fog_scale_factor_temperature import PROCEDURE
from procedures.fog_scale_factor_temperature.outlook import check, expected_uncertainty, outlook
from procedures.fog_scale_factor_temperature.parameters import FogParameters
from station import registry
from station.files.plan import read_plan
from station.files.yaml.reading import read_yaml, read_yaml_text
from station.instruments.bench import Bench, bench_of
from station.procedure import Procedures
from station.runner.static_limits import problems_of_plan

PLAN = CONFIG / "plans" / "fog-scale-factor-temperature.yaml"
BASE = {
    "temperature_range": ["-40 degC", "60 degC"],
    "latitude": "39.9 deg",
    "turn_rate": "10 deg/s",
    "gyro_bias": "0.02 deg/h",
}


def parameters(**changes: Any) -> FogParameters:
    return FogParameters.model_validate({**BASE, **changes})


def refusal(**changes: Any) -> str:
    with pytest.raises(ValidationError) as caught:
        parameters(**changes)
    return str(caught.value)


def bench(**limits: str) -> Bench:
    document = read_yaml(CONFIG / "benches" / "sim.yaml")
    text = document.text
    for name, value in limits.items():
        old = next(one for one in text.split(name + ": ")[1:]).split(",")[0].split("}")[0]
        text = text.replace(f"{name}: {old}", f"{name}: {value}", 1)
    changed = read_yaml_text(text, document.path)
    return bench_of(changed, registry.names(registry.DRIVERS))


def test_the_shipped_plan_is_one() -> None:
    plan = read_plan(PLAN, Procedures())
    assert plan.parameters.turns == "pairs"
    assert list(check(plan.parameters, bench())) == []
    assert set(plan.limits) == {("residual_scale_factor_error", axis) for axis in "xyz"}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"soak": "1 h"}, "published for a soak of 4 h to 6 h"),
        ({"ramp_rate": "30 degC/h"}, "published for 6 degC/h to 12 degC/h"),
        ({"ramp_rate": "1 degC/min"}, "outside_published_range: true allows it"),
        ({"set_interval": "15 min"}, "every 10 min"),
        ({"temperature_range": ["60 degC", "-40 degC"]}, "from the lowest to the highest"),
        ({"axes": ["x", "x"]}, "each once"),
        ({"reference_temperature": "70 degC"}, "not extrapolated"),
        ({"navigator_rate": "50 Hz"}, "less than or equal to 10"),
        ({"latitude": "95 deg"}, "less than or equal to 90"),
        ({"gyro_bias": None}, "cannot separate the gyro's bias from its scale factor"),
        ({"warm_up": {"window": "1 h", "at_most": "10 min"}}, "before its window"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(changes: dict[str, Any], said: str) -> None:
    assert said in refusal(**changes)


def test_a_plan_may_leave_the_published_ranges_and_then_says_so() -> None:
    free = parameters(outside_published_range=True, soak="1 h", ramp_rate="30 degC/h")
    assert len(free.outside) == 2
    assert "outside the published range: a soak of 1 h" in outlook(free)[-1]
    assert parameters().outside == ()


def test_pairs_fit_ten_minutes_and_a_palindrome_says_the_rate_at_which_it_would() -> None:
    assert parameters(turns="pairs").schedule.set_s == pytest.approx(513.0)
    said = refusal(turns="+--+")
    assert "takes 807 s, the interval is 600 s" in said
    rate = float(said.split(" deg/s would do")[0].split()[-1])
    assert parameters(turns="+--+", turn_rate=f"{rate:g} deg/s").schedule.fits
    assert "deg/s would do" in refusal(turns="+--+", turn_rate=f"{rate - 1:g} deg/s")


def test_where_no_rate_would_do_the_plan_says_that() -> None:
    said = refusal(turns="+--+", turn_acceleration="2 deg/s^2")
    assert "no rate would do at 2 deg/s^2" in said


def test_expected_uncertainties_are_those_of_the_science() -> None:
    plain = expected_uncertainty(parameters())
    assert plain.turn_ppm == pytest.approx(1.01, abs=0.03)
    assert plain.rms_ppm == pytest.approx(0.31, abs=0.03)
    assert plain.bias_ppm == pytest.approx(0.725, abs=0.01)
    pairs = expected_uncertainty(parameters(turns="pairs"))
    assert pairs.rms_ppm == pytest.approx(plain.rms_ppm / 2**0.5, rel=1e-3)
    assert pairs.bias_ppm == 0.0


def test_a_heading_too_coarse_for_what_is_asked_is_said_with_the_ppm_to_expect() -> None:
    coarse = parameters(turns="pairs", heading_resolution="0.01 deg", asked_uncertainty="1 ppm")
    (problem,) = check(coarse, bench())
    assert problem.where == ("parameters", "heading_resolution")
    assert "11 ppm of every turn" in problem.what
    assert "u = 2.4 ppm is to be expected where 1 ppm is asked for" in problem.what


def test_a_bias_too_large_for_what_is_asked_is_an_argument_for_pairs() -> None:
    (problem,) = check(parameters(gyro_bias="1 deg/h", asked_uncertainty="5 ppm"), bench())
    assert problem.where == ("parameters", "turns")
    assert "take turns: pairs" in problem.what


@pytest.mark.parametrize(
    ("limits", "where", "said"),
    [
        (
            {"temperature_low": "-30 degC"},
            "temperature_range",
            "is less than the -30 degC",
        ),
        ({"temperature_high": "55 degC"}, "temperature_range", "is more than the 55 degC"),
        ({"temperature_slew": "0.1 degC/min"}, "ramp_rate", "0.2 degC/min is more than the 0.1"),
    ],
)
def test_what_the_chamber_cannot_do_is_said(limits: dict[str, str], where: str, said: str) -> None:
    problems = list(problems_of_plan(PROCEDURE, parameters(), bench(**limits)))
    assert problems[0].where == ("parameters", where)
    assert said in problems[0].what


def test_a_drive_must_be_a_file_with_the_columns_of_one(tmp_path: Path) -> None:
    missing = parameters(drive={"file": str(tmp_path / "drive.csv")})
    (problem,) = check(missing, bench())
    assert problem.what == "the path does not exist"
    (problem,) = check(parameters(drive={"file": "fog"}), bench())
    assert "neither as a file nor by name; did you mean 'fog-yard-laps'; there are" in problem.what
    (tmp_path / "drive.csv").write_text("t_s,heading_deg\n0,0\n", encoding="utf-8")
    problems = list(check(missing, bench()))
    assert {one.where for one in problems} == {("parameters", "drive", "file")}
    assert "rate_x_deg_per_s" in problems[0].what


def test_only_what_a_plan_measures_may_have_a_limit() -> None:
    measured = PROCEDURE.measured_axes(parameters(axes=["z"]))
    assert measured["scale_factor_error"] == ("z",)
    assert measured["residual_scale_factor_error"] == ()
    assert measured["heading_error_compensated"] == ()
    whole = parameters(axes=["z"], verification={}, drive={"file": "fog-yard-laps"})
    measured = PROCEDURE.measured_axes(whole)
    assert measured["residual_scale_factor_error"] == ("z",)
    assert "heading_error_compensated" not in measured
