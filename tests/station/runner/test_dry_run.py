"""The dry run: what a plan will do, said without opening an instrument or writing a file."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import station
from rlg_runs import short_run
from shipped import shipped_bench
from small_disk import small_disk

from station import registry
from station.files.faults import FaultList
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import Plan, read_plan
from station.instruments.bench import Bench, read_bench
from station.method.set_points import SetPoint
from station.procedure import Procedures, procedure_of
from station.runner.dry_run import Extreme, extremes, walk
from station.runner.resources import BESIDE_RAW_BYTES, in_bytes, needed_bytes
from station.runner.session import clock_for

NAME = "rlg-magnetic-sensitivity"


def bench_of(text: str, folder: Path) -> Bench:
    (folder / "bench.yaml").write_text(text, encoding="utf-8")
    return read_bench(folder / "bench.yaml", registry.names(registry.DRIVERS))


def sim_text() -> str:
    return find(BENCHES, "sim").read_text(encoding="utf-8")


def shipped_plan() -> Plan:
    return read_plan(find(PLANS, NAME), Procedures())


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("dry")
    done = station(folder, "run", NAME, "--dry-run", "--json")
    assert done.returncode == 0, done.stderr
    assert list(folder.iterdir()) == []
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def test_every_step_is_told_with_its_beginning_and_its_duration(document: dict[str, Any]) -> None:
    procedure = procedure_of(NAME)
    assert [one["step"] for one in document["steps"]] == [step.number for step in procedure.steps]
    ends_s = 0.0
    for one in document["steps"]:
        assert one["starts_s"] == pytest.approx(ends_s)
        ends_s += one["expected_s"]
    assert document["expected_s"] == pytest.approx(ends_s)


def test_set_points_stand_in_the_step_that_commands_them(document: dict[str, Any]) -> None:
    points = {one["step"]: one["set_points"] for one in document["steps"]}
    drive = next(one for one in points["S3.2"] if one["instrument"] == "coil_supply.x")
    assert drive["text"] == "sine 0.1 Hz, 3.33 A, 1 mT"
    assert drive["field_mT"] == 1.0
    assert drive["current_A"] == pytest.approx(1 / 0.3)
    others = {one["instrument"] for one in points["S8"]}
    assert {"coil_supply.y", "coil_supply.z"} <= others


def test_no_set_point_stands_outside_the_steps() -> None:
    plan = shipped_plan()
    procedure = procedure_of(NAME)
    foreseen = procedure.forecast(plan.parameters, shipped_bench())
    assert {one.step for one in foreseen.set_points} <= {step.number for step in procedure.steps}


def test_the_extremes_name_value_unit_and_instrument(document: dict[str, Any]) -> None:
    found = {one["quantity"]: one for one in document["extremes"]}
    assert (found["field"]["value"], found["field"]["unit"]) == (1.0, "mT")
    assert found["current"]["instrument"] == "coil_supply.x"
    assert found["current"]["value"] == pytest.approx(1 / 0.3)


def with_resistance(resistances: dict[str, str], folder: Path) -> Bench:
    """Return the shipped bench with these coil resistances and no others."""
    data = yaml.safe_load(sim_text())
    for axis in "xyz":
        settings = data["instruments"][f"coil_supply.{axis}"]["settings"]
        settings.pop("coil_resistance", None)
        if axis in resistances:
            settings["coil_resistance"] = resistances[axis]
    return bench_of(yaml.safe_dump(data, sort_keys=False), folder)


def test_coil_heating_comes_from_the_benchs_coil_resistance(tmp_path: Path) -> None:
    bench = with_resistance({"x": "1.2 ohm", "y": "1.1 ohm", "z": "1 ohm"}, tmp_path)
    walked = walk(shipped_plan(), bench, tmp_path)
    (heating,) = [one for one in walked.extremes if one.quantity == "coil heating"]
    assert heating.instrument == "coil_supply.x"
    assert heating.value == pytest.approx((1 / 0.3) ** 2 / 2 * 1.2)


def test_coil_heating_without_a_resistance_is_said_to_be_unknown(tmp_path: Path) -> None:
    bench = with_resistance({"y": "1.1 ohm"}, tmp_path)
    walked = walk(shipped_plan(), bench, tmp_path)
    known, unknown = [one for one in walked.extremes if one.quantity == "coil heating"]
    assert known.instrument == "coil_supply.y"
    assert unknown.value is None
    assert unknown.note == "not known: the bench file gives no coil_resistance"
    assert unknown.instrument == "coil_supply.x, coil_supply.z"


def test_a_coil_resistance_without_unit_is_a_fault_with_its_place(tmp_path: Path) -> None:
    with pytest.raises(
        FaultList, match=r"bench\.yaml:\d+:\d+: .*coil_resistance: '1\.2' has no unit"
    ):
        with_resistance({"x": "1.2"}, tmp_path)


def test_rates_and_temperatures_have_extremes_too() -> None:
    points = [
        SetPoint("1", "turntable", "turn", rate_deg_per_s=-100.0),
        SetPoint("1", "turntable", "turn", rate_deg_per_s=50.0),
        SetPoint("2", "thermal_chamber", "soak", temperature_degC=-40.0),
        SetPoint("3", "thermal_chamber", "soak", temperature_degC=60.0),
    ]
    assert list(extremes(points, shipped_bench())) == [
        Extreme("largest", "rate", 100.0, "deg/s", "turntable"),
        Extreme("lowest", "temperature", -40.0, "degC", "thermal_chamber"),
        Extreme("highest", "temperature", 60.0, "degC", "thermal_chamber"),
    ]


def test_a_simulated_bench_tells_no_end_because_waiting_is_skipped(tmp_path: Path) -> None:
    done = station(tmp_path, "run", NAME, "--dry-run")
    assert done.returncode == 0, done.stderr
    assert "virtual time, where waiting is skipped" in done.stdout
    assert "coil_supply.x: sine 0.1 Hz, 3.33 A, 1 mT" in done.stdout
    assert "nothing was written" in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_a_real_bench_tells_when_the_run_would_end(tmp_path: Path) -> None:
    bench = bench_of(sim_text().split("\nsimulation:")[0], tmp_path)
    before = datetime.now(UTC)
    walked = walk(shipped_plan(), bench, tmp_path)
    assert walked.ends_utc is not None
    late = walked.ends_utc - timedelta(seconds=walked.duration.expected_s)
    assert before <= late <= datetime.now(UTC)


def test_a_served_bench_ends_sooner_by_its_speed(tmp_path: Path) -> None:
    served = {"instruments": {}, "clock": {"speed": 50.0, "epoch_unix": 1.7e9}}
    (tmp_path / "served.json").write_text(json.dumps(served), encoding="utf-8")
    done = station(tmp_path, "run", NAME, "--dry-run", "--served", "served.json")
    assert done.returncode == 0, done.stderr
    assert "UTC if it begins now, at 50 times real time" in done.stdout


def test_a_faulty_plan_is_told_with_its_faults(tmp_path: Path) -> None:
    done = station(tmp_path, "run", NAME, "--dry-run", "--set", "parameters.amplitude=5 mT")
    assert done.returncode == 2
    assert "0.1 mT to 2 mT" in done.stderr
    assert done.stdout == ""


def test_a_disk_too_small_is_warned_of(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk") as disk:
        done = station(tmp_path, "run", NAME, "--dry-run", "--output", str(disk))
    assert done.returncode == 0, done.stderr
    assert f"WARNING: the disk of {disk} is too small for this plan" in done.stderr


@pytest.mark.campaign
def test_the_disk_space_foretold_is_what_a_run_takes(tmp_path: Path) -> None:
    outcome, _ = short_run(tmp_path)
    taken = sum(file.stat().st_size for file in (outcome.folder / "raw").iterdir())
    plan = read_plan(tmp_path / "plan.yaml", Procedures())
    bench = read_bench(tmp_path / "bench.yaml", registry.names(registry.DRIVERS))
    foreseen = procedure_of(NAME).forecast(plan.parameters, bench)
    needed = needed_bytes(foreseen, bench, clock_for(bench)) - BESIDE_RAW_BYTES
    assert taken <= needed <= 1.6 * taken


def test_a_real_bench_is_looked_at_more_often_and_so_takes_more_disk(tmp_path: Path) -> None:
    simulated, plan = shipped_bench(), shipped_plan()
    real = bench_of(sim_text().split("\nsimulation:")[0], tmp_path)
    foreseen = procedure_of(NAME).forecast(plan.parameters, real)
    on_virtual_time = needed_bytes(foreseen, simulated, clock_for(simulated))
    assert needed_bytes(foreseen, real, clock_for(real)) > on_virtual_time


def test_bytes_are_written_for_a_person() -> None:
    assert in_bytes(999) == "999 B"
    assert in_bytes(2_300_000) == "2.3 MB"
    assert in_bytes(10**15) == "1000 TB"
