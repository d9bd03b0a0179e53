"""A check of a whole bench is short, and names whatever of its figures has drifted."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commissioning_parts import EARTH, only
from plan_runs import shipped_bench
from quick_yaml import dump_yaml, load_yaml
from tiers import quick

from procedures.commissioning import PARTS, WATCHED
from station.cli.commissioning import commission_bench

Bench = dict[str, Any]
STATED = tuple(f"parameters.earth.{key}={value}" for key, value in EARTH.items())
WHOLE = [part for part in PARTS if part.drift]
BRIEF = tuple(line for part in WHOLE for line in part.short)


def ran(bench: Path, runs: Path, *overrides: str, check: bool) -> tuple[int, Path]:
    """Commission a bench file, or check it; return the exit code and the run folder."""
    code = commission_bench(str(bench), overrides, True, None, runs, check=check, as_json=False)
    (folder,) = runs.iterdir()
    return code, folder


def results_of(folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    return document


@pytest.fixture(scope="module")
def commissioned(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """Return the simulated bench as a commissioning of all that may drift leaves it."""
    parts = tuple(part.name for part in WHOLE)
    return commission("sim", tmp_path_factory.mktemp("commissioned"), *parts)


def commission(name: str, place: Path, *parts: str) -> Bench:
    """Return a shipped bench as a commissioning of some parts leaves it."""
    bench = place / "bench.yaml"
    bench.write_text(dump_yaml(shipped_bench(name)), encoding="utf-8")
    brief = (*BRIEF, *STATED, *only(*parts))
    code, folder = ran(bench, place / "runs", *brief, check=False)
    assert code == 0
    left: Bench = load_yaml((folder / "bench-commissioned.yaml").read_text(encoding="utf-8"))
    return left


def written(bench: Bench, folder: Path, seed: int) -> Path:
    """Write a bench of another day: what is noise is drawn anew."""
    bench["simulation"]["seed"] = seed
    path = folder / "bench.yaml"
    path.write_text(dump_yaml(bench), encoding="utf-8")
    return path


def copy(bench: Bench) -> Bench:
    same: Bench = load_yaml(dump_yaml(bench))
    return same


def test_the_bench_file_holds_every_figure_that_may_drift(commissioned: Bench) -> None:
    held = {figure["name"] for figure in commissioned["commissioned"]["figures"]}
    assert held == set(WATCHED)
    assert {part.name for part in WHOLE} == {
        *("coils", "pick_up", "motion", "stage", "gyro", "chamber", "clocks")
    }


@pytest.mark.parametrize("seed", quick([2, 3, 4], 2))
def test_a_bench_that_has_not_drifted_passes_its_check(
    commissioned: Bench, seed: int, tmp_path: Path
) -> None:
    bench = written(copy(commissioned), tmp_path, seed)
    code, folder = ran(bench, tmp_path / "runs", *STATED, check=True)
    document = results_of(folder)
    assert (code, document["verdict"]) == (0, "pass")
    assert [flag["code"] for flag in document["flags"]] == ["simulated"]
    drifts = [one for one in document["results"] if one["name"] == "drift"]
    assert len(drifts) == len(commissioned["commissioned"]["figures"])


@pytest.mark.campaign
def test_a_gaussmeter_that_keeps_no_readings_decides_a_drift(tmp_path: Path) -> None:
    bench = commission("sim-alternate", tmp_path, "coils", "motion", "gyro", "chamber")
    (tmp_path / "check").mkdir()
    path = written(bench, tmp_path / "check", 2)
    code, _ = ran(path, tmp_path / "check" / "runs", *STATED, check=True)
    assert code == 0


def weight(bench: Bench) -> None:
    bench["simulation"]["gyro"]["pulse_weight"] = "0.063 arcsec"


def chamber_sensor(bench: Bench) -> None:
    bench["instruments"]["thermal_chamber"]["simulator"]["sensor_error"] = "0.9 K"


def thermometer(bench: Bench) -> None:
    bench["simulation"]["fog"]["gyros"]["sensor_offset"]["y"] = "-0.9 K"


def overshoot(bench: Bench) -> None:
    bench["simulation"]["fog"]["chamber"]["overshoot"] = "25 %"


def leads(bench: Bench) -> None:
    bench["instruments"]["multimeter"]["simulator"]["pick_up"] = "2.5 uV"


def table_zero(bench: Bench) -> None:
    bench["instruments"]["turntable"]["simulator"]["axis_2"]["encoder_offset"] = "0.06 deg"


def table_lean(bench: Bench) -> None:
    bench["simulation"]["fog"]["table"]["outer"]["lean"]["towards_x"] = "0.045 deg"


def sensor_gyro(bench: Bench) -> None:
    gyros = bench["simulation"]["nine_axis"]["sensor"]["gyros"]
    gyros["z"]["scale_factor_error"] = "4500 ppm"


def stage_zero(bench: Bench) -> None:
    bench["instruments"]["rotary_stage"]["simulator"]["encoder_offset"] = "0.05 deg"


def stage_lean(bench: Bench) -> None:
    bench["simulation"]["accelerometer"]["axis_tilt"] = "0.04 deg"


def scale_factor(bench: Bench) -> None:
    bench["simulation"]["accelerometer"]["coefficients"]["Ki"] = "1.02 V/g"


def board_clock(bench: Bench) -> None:
    bench["instruments"]["gyro_acquisition"]["simulator"]["clock_error"] = "70 ppm"


def gaussmeter_clock(bench: Bench) -> None:
    bench["instruments"]["gaussmeter"]["simulator"]["clock_error"] = "100 ppm"


def coil(bench: Bench) -> None:
    bench["simulation"]["coils"]["x"]["spacing_error"] = "1.5 %"


COILS = ("x", "y", "z")
ABOVE = {f"thermometer_above_air {axis}" for axis in COILS}
DRIFTS: dict[str, tuple[Callable[[Bench], None], str, set[str]]] = {
    "pulse weight": (weight, "gyro", {"pulse_weight_ratio"}),
    "chamber sensor": (chamber_sensor, "chamber", {"chamber_steady_error", *ABOVE}),
    "device thermometer": (thermometer, "chamber", {"thermometer_above_air y"}),
    "overshoot": (overshoot, "chamber", {"chamber_overshoot", "chamber_lag"}),
    "pick-up": (leads, "pick_up", {f"pick_up {coil}" for coil in COILS}),
    "table zero": (table_zero, "motion", {"encoder_zero middle"}),
    "table lean": (table_lean, "motion", {"axis_lean outer"}),
    "gyro of the sensor": (sensor_gyro, "motion", {"turn_ratio outer"}),
    "stage zero": (stage_zero, "stage", {"stage_zero"}),
    "stage lean": (stage_lean, "stage", {"stage_lean"}),
    "accelerometer": (scale_factor, "stage", {"stage_response"}),
    "board clock": (board_clock, "gyro", {"board_clock_error"}),
    "gaussmeter clock": (gaussmeter_clock, "clocks", {"gaussmeter_clock_error"}),
    "coil constant": (coil, "coils", {"coil_constant_ratio x"}),
}
"""What has changed, the part that measures it, and the figures that have drifted."""


@pytest.mark.parametrize("name", quick(DRIFTS, "pulse weight", "chamber sensor", "pick-up"))
def test_what_has_drifted_is_named_alone(
    commissioned: Bench, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    change, part, expected = DRIFTS[name]
    bench = copy(commissioned)
    change(bench)
    parts = (f"parameters.checks=[{part}]", *(STATED if part == "gyro" else ()))
    path = written(bench, tmp_path, 5)
    code, folder = ran(path, tmp_path / "runs", *parts, check=True)
    flags = results_of(folder)["flags"]
    assert code == 1
    assert {flag["axis"] for flag in flags if flag["code"] == "drifted"} == expected


def test_a_figure_that_the_check_cannot_measure_is_not_decided(
    commissioned: Bench, tmp_path: Path
) -> None:
    bench = written(copy(commissioned), tmp_path, 2)
    code, folder = ran(bench, tmp_path / "runs", "parameters.checks=[gyro]", check=True)
    assert code == 6
    flags = {(flag["code"], flag["axis"]) for flag in results_of(folder)["flags"]}
    assert ("drift-undecided", "pulse_weight_ratio") in flags


def test_a_figure_that_was_not_commissioned_is_not_watched(
    commissioned: Bench, tmp_path: Path
) -> None:
    bench = copy(commissioned)
    block = bench["commissioned"]
    without = [one for one in block["figures"] if one["name"] != "pulse_weight_ratio"]
    block["figures"] = without
    path = written(bench, tmp_path, 2)
    code, folder = ran(path, tmp_path / "runs", "parameters.checks=[gyro]", check=True)
    assert code == 0
    document = results_of(folder)
    drifts = [one["axis"] for one in document["results"] if one["name"] == "drift"]
    assert drifts == ["board_clock_error"]
