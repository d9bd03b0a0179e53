"""The places of a thermometer: what their spread over the device does to a budget, and to a run."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from fog_runs import short_run
from places import DATA
from plan_runs import run_of, shipped_bench, shipped_plan

from procedures.common.places import (
    GRADIENT,
    AtPlaces,
    PlaceRows,
    at_places,
    gradient_inputs,
    judged,
    place_flags,
    table_of,
    widest,
    with_gradient,
)
from procedures.estimation.channel import still
from procedures.gyro_bias_temperature import dataset as of_gyro
from station.dataset_reading import read_dataset
from station.findings import Estimate
from station.instruments.bench import read_bench
from station.method.dry_run import DryRun
from station.procedure import procedure_of
from station.record.folder import RunFolder
from station.registry import DRIVERS, names
from station.report.certificate import certificate_of_run
from station.results import Result, ResultDocument
from station.runner.calibration_flags import record_flags
from station.runner.evaluation import evaluate_dataset, evaluate_run
from station.runner.outcome import Outcome
from station.runner.run import ActingRun
from station.texts import Texts
from station.uncertainty import combine

GYRO, FOG = "gyro-bias-temperature", "fog-scale-factor-temperature"
THERMOMETER, FAR = "thermometer", "device_far_temperature_degC"
SHORT = {
    "soaks": ["10 degC", "20 degC", "30 degC"],
    "soak": "40 min",
    "warm_up": "20 min",
    "ramp_down": "1 degC/min",
}
SPREAD_K = 0.8
CHANNELS = (101, 102, 103)


def rows_of(**degC: float) -> np.ndarray:
    names = [f"{place}_temperature_degC" for place in degC]
    names[0] = "temperature_degC"
    rows = np.zeros(4, dtype=[(name, np.float64) for name in [*names, "arrival_time_s"]])
    for name, value in zip(names, degC.values(), strict=True):
        rows[name] = value + np.array([-0.1, 0.1, -0.1, 0.1])
    return rows


def test_the_spread_is_that_of_the_farthest_place_at_the_device() -> None:
    rows = rows_of(device=20.0, device_far=20.2, device_top=19.5, chamber=30.0)
    reading = at_places("soak 1", PlaceRows(rows), lambda degC: degC + 1.0)
    assert reading.temperature_degC == pytest.approx(
        {"device": 21.0, "device_far": 21.2, "device_top": 20.5, "chamber": 31.0}
    )
    assert reading.spread_degC == pytest.approx(0.5)
    near = AtPlaces("soak 2", {"device": 20.0, "device_far": 20.1, "chamber": 0.0})
    assert widest([near, reading, near]) is reading
    (given,) = gradient_inputs([near, reading], True)
    assert (given.name, given.distribution) == (GRADIENT, "uniform")
    assert given.standard_uncertainty == pytest.approx(0.5 / math.sqrt(3.0))


def test_a_single_place_at_the_device_says_nothing_of_a_spread() -> None:
    alone = AtPlaces("soak 1", {"device": 20.0, "chamber": 25.0})
    assert alone.spread_degC is None and widest([alone]) is None
    assert list(gradient_inputs([alone], False)) == [] == list(gradient_inputs([], False))
    (table,) = table_of([alone])
    assert table.rows == [["soak 1", "20.000", "25.000", ""]]
    assert list(table_of([])) == []


def test_a_sensor_that_reads_no_number_for_a_while_counts_where_it_does() -> None:
    rows = rows_of(device=20.0, device_far=20.2, device_top=19.5)
    whole = at_places("soak 1", PlaceRows(rows), lambda degC: degC)
    rows["temperature_degC"][2:] += 5.0
    rows["device_far_temperature_degC"][2:] = math.nan
    rows["device_top_temperature_degC"] = math.nan
    part = at_places("soak 2", PlaceRows(rows), lambda degC: degC)
    assert part.spread_degC == pytest.approx(0.2) and widest([part, whole]) is whole
    (table,) = table_of([part])
    assert table.rows == [["soak 2", "20.000", "20.200", "", "0.200"]]
    rows["temperature_degC"] = math.nan
    none = at_places("soak 3", PlaceRows(rows), lambda degC: degC)
    assert none.spread_degC is None and list(gradient_inputs([none], False)) == []


def test_a_place_that_reads_now_and_then_keeps_no_other_from_its_mean() -> None:
    rows = rows_of(device=20.0, device_far=20.2, chamber=30.0)
    rows["device_far_temperature_degC"][0] = math.nan
    rows["chamber_temperature_degC"][1:] = math.nan
    reading = at_places("soak 1", PlaceRows(rows), lambda degC: degC)
    assert reading.spread_degC == pytest.approx(0.2)
    assert math.isnan(reading.temperature_degC["chamber"])


def test_a_silent_place_at_the_device_is_flagged_and_another_is_not() -> None:
    dead = AtPlaces("soak 1", {"device": 20.0, "device_far": math.nan, "chamber": math.nan})
    well = AtPlaces("soak 2", {"device": 20.0, "device_far": 20.1, "chamber": math.nan})
    (flag,) = place_flags([dead, well])
    assert (flag.code, flag.details["count"]) == ("place-silent", 1)
    assert "at device_far in 1 of 2 readings" in flag.message
    assert list(place_flags([well])) == [] == list(place_flags([]))


@pytest.mark.campaign
def test_a_run_whose_far_sensor_is_open_ends_well_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    monkeypatch.setattr(ActingRun, "say", lambda run, text: told.append(text))
    plan, bench = shipped_plan(GYRO), bench_with(SPREAD_K)
    plan["parameters"] |= SHORT
    plan["limits"] = {}
    bench["instruments"][THERMOMETER]["settings"]["places"]["device_far"] = 107
    without = run_of(tmp_path, plan, bench)
    assert without.exit_code == 0, without.error
    assert without.document is not None
    assert [flag.code for flag in without.document.flags].count("place-silent") == 1
    begins = "WARNING: the thermometer reads no number at device_far;"
    assert [text.startswith(begins) for text in told].count(True) == 1
    assert is_not_stated(line_of(bias_of(RunFolder(without.folder))))


def test_a_result_depends_on_the_spread_as_on_an_offset_of_the_thermometer() -> None:
    far = AtPlaces("soak 1", {"device": 20.0, "device_far": 20.6})
    inputs = list(gradient_inputs([far], True))
    bias = Estimate("bias", "X", 1.0, "deg/h", 0.1, None, "weighted", {"thermometer_degC": -0.5})
    lag = Estimate("lag", "X", 1.0, "s", 0.1, None, "weighted", {})
    own, other = with_gradient([bias, lag], inputs, "thermometer_degC")
    (whole,) = combine([own], inputs)
    assert whole is not None and other is lag
    wanted = math.hypot(0.1, 0.5 * 0.6 / math.sqrt(3.0))
    assert whole.standard_uncertainty == pytest.approx(wanted)
    assert with_gradient([bias, lag], [], "thermometer_degC") == [bias, lag]


@pytest.mark.parametrize("name", [GYRO, FOG])
def test_a_bench_without_places_is_asked_for_no_thermometer(name: str) -> None:
    procedure = procedure_of(name)
    parameters = procedure.parameters.model_validate(shipped_plan(name)["parameters"])
    walk = DryRun(parameters).walk(procedure.steps)
    assert THERMOMETER not in walk.instruments
    assert walk.optional == ((THERMOMETER, "places"),)


def bench_with(spread_K: float) -> dict[str, Any]:
    bench = shipped_bench("sim-alternate")
    bench["simulation"]["gyro"]["switch_on_scatter"] = "0 deg/h"
    bench["simulation"]["gradient"] = {"device": f"{spread_K} K", "chamber": "0.6 K"}
    # Each sensor is what the bench file says of it, and the meter has no noise.
    own = bench["instruments"][THERMOMETER]
    own["settings"]["places"] = {
        "device": {"channel": 101, "r0": "100.01 ohm"},
        "device_far": {"channel": 102, "r0": "100.005 ohm"},
        "chamber": {"channel": 103, "r0": "99.99 ohm"},
    }
    return bench


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    plan = shipped_plan(GYRO)
    plan["parameters"] |= SHORT
    plan["limits"] = {}
    return run_of(tmp_path_factory.mktemp("places"), plan, bench_with(SPREAD_K))


def bias_of(folder: RunFolder) -> Result:
    document, _ = evaluate_run(folder)
    return document.result("bias", "IA")


def is_not_stated(line: dict[str, Any]) -> bool:
    said = (line["distribution"], line["standard_uncertainty"], line["contribution"])
    return said == ("not stated", None, 0.0) and line["sensitivity"] != 0.0


def line_of(result: Result) -> dict[str, Any]:
    return next(one for one in result.to_data()["budget"] if one["quantity"] == GRADIENT)


def test_u_of_a_run_grows_by_the_gradient_of_its_world(outcome: Outcome) -> None:
    assert outcome.exit_code == 0, outcome.error
    folder = RunFolder(outcome.folder)
    result = bias_of(folder).to_data()
    line = next(one for one in result["budget"] if one["quantity"] == GRADIENT)
    assert line["standard_uncertainty"] == pytest.approx(SPREAD_K / math.sqrt(3.0), rel=0.01)
    offset = next(one for one in result["budget"] if one["quantity"] == "thermometer_degC")
    assert line["sensitivity"] == offset["sensitivity"] != 0.0
    others = [one["contribution"] for one in result["budget"] if one is not line]
    grown = abs(line["sensitivity"]) * SPREAD_K / math.sqrt(3.0)
    assert result["standard_uncertainty"] == pytest.approx(math.hypot(*others, grown), rel=1e-3)


def test_all_places_are_recorded_and_stand_in_the_report(outcome: Outcome) -> None:
    folder = RunFolder(outcome.folder)
    _, findings = evaluate_run(folder)
    (table,) = [
        part
        for part in procedure_of(GYRO).report(findings, evaluate_run(folder)[0])
        if part.title == "Temperatures by place"
    ]
    assert [row[0] for row in table.rows] == [f"soak {number}" for number in range(1, 5)]
    for row, air_degC in zip(table.rows, (10.0, 20.0, 30.0, 22.0), strict=True):
        read = dict(zip(table.columns, row, strict=True))
        device, far, air = (
            float(read[f"{place}, degC"]) for place in ("device", "device_far", "chamber")
        )
        assert far - device == pytest.approx(SPREAD_K, abs=0.02)
        assert float(read["spread over the device, degC"]) == pytest.approx(far - device, abs=2e-3)
        assert air == pytest.approx(air_degC + 0.3, abs=0.4)
    rows = folder.rows(THERMOMETER, "soak 2")
    # Every minute, and what is begun is fetched at the next look.
    assert 0.8 * 40 < len(rows) <= 41


def test_what_is_not_used_of_the_record_of_a_scanner_is_named(tmp_path: Path) -> None:
    procedure, plan = procedure_of(GYRO), shipped_plan(GYRO)
    parameters = procedure.parameters.model_validate(plan["parameters"])

    def unused(*places: str) -> list[Any]:
        raw = bench_with(SPREAD_K)
        raw["instruments"][THERMOMETER]["settings"]["places"] = dict(
            zip(places, CHANNELS, strict=False)
        )
        file = tmp_path / "bench.yaml"
        file.write_text(yaml.safe_dump(raw, sort_keys=False), encoding="utf-8")
        flags = record_flags(procedure, parameters, read_bench(file, names(DRIVERS)))
        return [
            flag.details["unused"]
            for flag in flags
            if flag.details.get("instrument") == THERMOMETER
        ]

    assert unused("device", "device_far", "chamber") == []
    assert unused("device", "chamber") == [["uncertainty of temperature"]]


def test_a_certificate_rests_on_the_scanner_and_names_its_places(outcome: Outcome) -> None:
    folder = RunFolder(outcome.folder)
    certificate = certificate_of_run(folder, evaluate_run(folder)[0])
    assert [row[2] for row in certificate.traceability if row[0] == THERMOMETER] == [
        "SIM-PT100-0002"
    ]
    assert THERMOMETER not in [row[0] for row in certificate.other_instruments]
    read = [own.quantity for own in certificate.ambient if own.source == THERMOMETER]
    assert sorted(read) == ["temperature", "temperature, chamber", "temperature, device_far"]
    assert Texts("zh")(read[-1]).startswith("温度，")


class Shifted(RunFolder):
    """A folder one column of whose raw data reads otherwise."""

    def __init__(self, path: Path, source: str, column: str, by: float) -> None:
        super().__init__(path)
        self._of, self._column, self._by = source, column, by

    def rows(self, source: str, unit: str) -> Any:
        rows = super().rows(source, unit)
        if source == self._of:
            rows = rows.copy()
            rows[self._column] += self._by
        return rows


def test_raw_data_that_are_moved_move_result_and_u_as_is_declared(outcome: Outcome) -> None:
    before = bias_of(RunFolder(outcome.folder))
    slope = line_of(before)["sensitivity"]
    # The far place: the input alone.
    further = bias_of(Shifted(outcome.folder, THERMOMETER, FAR, 0.5))
    assert further.estimate.value == before.estimate.value
    more = line_of(further)["contribution"] - line_of(before)["contribution"]
    assert more == pytest.approx(abs(slope) * 0.5 / math.sqrt(3.0), rel=1e-3)
    # What the device's thermometer reads, by the same slope, moves the bias at a temperature.
    by_degC = 0.2
    warmer = bias_of(Shifted(outcome.folder, "gyro_acquisition", "temperature_degC", by_degC))
    assert warmer.estimate.value is not None and before.estimate.value is not None
    moved = warmer.estimate.value - before.estimate.value
    assert abs(moved) == pytest.approx(abs(slope) * by_degC, rel=0.1)


def test_a_record_without_its_places_has_the_results_that_it_had(
    outcome: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_places = bias_of(RunFolder(outcome.folder)).to_data()
    monkeypatch.setattr(of_gyro, "recorded_rows", lambda *of: {})
    without = bias_of(RunFolder(outcome.folder)).to_data()
    assert with_places["value"] == without["value"]
    lines = [one["quantity"] for one in with_places["budget"]]
    assert sorted(one["quantity"] for one in without["budget"]) == sorted(lines)
    assert without["standard_uncertainty"] < with_places["standard_uncertainty"]


class StandsStill(RunFolder):
    """A folder whose thermometer repeats its first readings at some places for ever."""

    def __init__(self, path: Path, *columns: str) -> None:
        super().__init__(path)
        self._columns = columns

    def rows(self, source: str, unit: str) -> Any:
        rows = super().rows(source, unit)
        if source == THERMOMETER:
            rows = rows.copy()
            for column in self._columns:
                rows[column] = 21.5
        return rows


@pytest.mark.parametrize("columns", [(FAR,), ("temperature_degC", FAR)], ids=["a place", "both"])
def test_places_that_stand_still_are_flagged_and_tell_no_spread(
    outcome: Outcome, columns: tuple[str, ...]
) -> None:
    document, _ = evaluate_run(StandsStill(outcome.folder, *columns))
    flags = [flag for flag in document.flags if flag.code == "frozen"]
    places = ["device", "device_far"][-len(columns) :]
    assert [flag.message.split(" repeats")[0] for flag in flags] == [
        f"The thermometer at {place}" for place in places
    ]
    assert all(flag.details["instrument"] == THERMOMETER for flag in flags)
    assert "place-silent" not in [flag.code for flag in document.flags]
    assert is_not_stated(line_of(document.result("bias", "IA")))
    sound, _ = evaluate_run(RunFolder(outcome.folder))
    assert not {"frozen", "place-silent"} & {flag.code for flag in sound.flags}


def test_what_stands_still_is_told_over_the_whole_run() -> None:
    noise = np.random.default_rng(0)
    times_s = np.arange(120.0)
    rows = np.zeros(120, dtype=[(name, float) for name in ("arrival_time_s", "temperature_degC")])
    rows["arrival_time_s"] = times_s
    # A sensor of 0.1 degC stands in its soak, and moves in the ramp.
    rows["temperature_degC"] = np.round(np.clip(times_s - 60.0, 0.0, 60.0), 1)
    rows["temperature_degC"][60:] += np.round(0.2 * noise.standard_normal(60), 1)
    coarse = judged({"soak 1": rows[:60], "ramp 1": rows[60:]}, still)
    assert not coarse["soak 1"].still["device"].any()
    rows["temperature_degC"] = times_s + 0.01 * noise.standard_normal(120)
    rows["temperature_degC"][40:80] = rows["temperature_degC"][40]
    fine = judged({"ramp 1": rows[60:], "soak 1": rows[:60]}, still)
    assert [int(own.still["device"].sum()) for own in fine.values()] == [20, 20]


def warmed(table: Path) -> None:
    """Have the temperature of a table's rows go up and down, and the output follow it."""
    head, *rows = table.read_text(encoding="utf-8").splitlines()
    names = head.split(",")
    warm, output = names.index("temperature_degC"), names.index("output_V")
    for number, row in enumerate(rows):
        cells, warmer_K = row.split(","), math.sin(0.37 * number)
        cells[warm] = f"{21.0 + warmer_K:.4f}"
        cells[output] = f"{float(cells[output]) + 1e-3 * warmer_K:.9f}"
        rows[number] = ",".join(cells)
    table.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")


@pytest.mark.parametrize(
    "example, name, axis",
    [
        ("gyro-bias-temperature", "bias", "IA"),
        ("fog-pairs", "scale_factor_error", "z"),
        ("accelerometer-three-planes", "K0", None),
        ("accelerometer-tumble", "K0", None),
    ],
)
def test_the_spread_may_be_stated_of_an_import(
    example: str, name: str, axis: str | None, tmp_path: Path
) -> None:
    folder = tmp_path / "import"
    shutil.copytree(DATA / example, folder)
    if axis is None:
        (table,) = folder.glob("*.csv")
        warmed(table)

    def result() -> Result:
        return evaluate_dataset(read_dataset(folder))[0].result(name, axis)

    before, file = result(), folder / "dataset.yaml"
    text = file.read_text(encoding="utf-8")
    stated = text.replace("\nconditions:\n", "\nconditions:\n  device_gradient: 3 K\n")
    file.write_text(stated, encoding="utf-8")
    after = result()
    assert after.estimate.value == before.estimate.value
    line = line_of(after)
    assert line["standard_uncertainty"] == pytest.approx(3.0 / math.sqrt(3.0))
    assert (line["distribution"], line["source"]) == ("uniform", "the dataset's conditions")
    u, grown = (own.to_data()["standard_uncertainty"] for own in (before, after))
    assert grown == pytest.approx(math.hypot(u, line["contribution"]))
    assert grown > u


def without_file(folder: Path, into: Path) -> RunFolder:
    """Return a copy of a run whose thermometer's raw file is lost."""
    shutil.copytree(folder, into)
    (into / "raw" / "thermometer-000.mcap").unlink()
    return RunFolder(into)


def messages_of(document: ResultDocument, code: str) -> list[str]:
    return [flag.message for flag in document.flags if flag.code == code]


def test_a_lost_record_of_the_scanner_leaves_no_soak_out(outcome: Outcome, tmp_path: Path) -> None:
    lost, _ = evaluate_run(without_file(outcome.folder, tmp_path / "run"))
    whole, _ = evaluate_run(RunFolder(outcome.folder))
    assert [own.estimate.value for own in lost.results] == [
        own.estimate.value for own in whole.results
    ]
    assert is_not_stated(line_of(lost.result("bias", "IA")))
    (message,) = messages_of(lost, "data-damaged")
    assert message == (
        "raw/thermometer-000.mcap is damaged from byte 0 on, the file is gone; every unit of work "
        "stays, as no value is made of it; u may lack its part."
    )


def test_a_lost_record_that_every_point_needs_is_told_so(tumble: Outcome, tmp_path: Path) -> None:
    document, _ = evaluate_run(without_file(tumble.folder, tmp_path / "run"))
    assert {own.estimate.value for own in document.results} == {None}
    gone, told = messages_of(document, "data-damaged")
    assert gone.startswith("raw/thermometer-000.mcap is damaged from byte 0 on, the file is gone;")
    assert told == (
        "No result is left: each unit of work needs what was recorded in raw/thermometer-000.mcap. "
        "Put it back from a copy of the run folder, then analyse the run again."
    )


def test_a_stage_whose_scanner_stands_still_says_what_u_lacks(tumble: Outcome) -> None:
    document, _ = evaluate_run(StandsStill(tumble.folder, "temperature_degC", FAR))
    assert "frozen" in {flag.code for flag in document.flags}
    for name, part_of_ki in (("K0", 30e-6), ("Ki", 100e-6), ("bias", 30e-6)):
        budget = document.result(name, None).to_data()["budget"]
        lines = {line["quantity"]: line for line in budget}
        for quantity in ("thermometer_degC", GRADIENT):
            assert is_not_stated(lines[quantity])
            assert lines[quantity]["sensitivity"] == pytest.approx(part_of_ki, rel=0.01)


@pytest.fixture(scope="module")
def tumble(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    plan, bench = shipped_plan("accelerometer-tumble"), shipped_bench()
    plan["parameters"] |= {"mountings": ["io"], "positions": 8, "warm_up": "30 min"}
    plan["limits"] = {}
    scanner = bench_with(SPREAD_K)
    bench["instruments"][THERMOMETER] = scanner["instruments"][THERMOMETER]
    bench["simulation"]["gradient"] = scanner["simulation"]["gradient"]
    return run_of(tmp_path_factory.mktemp("tumble"), plan, bench)


def test_a_stage_has_the_scanner_as_its_thermometer(tumble: Outcome) -> None:
    assert tumble.exit_code == 0, tumble.error
    document, findings = evaluate_run(RunFolder(tumble.folder))
    budgets = [one.to_data().get("budget", []) for one in document.results]
    by_quantity = [{line["quantity"]: line for line in budget} for budget in budgets]
    (lines, *_) = [lines for lines in by_quantity if GRADIENT in lines]
    own = lines[GRADIENT]
    assert own["standard_uncertainty"] == pytest.approx(SPREAD_K / math.sqrt(3.0), rel=0.02)
    assert own["sensitivity"] == lines["thermometer_degC"]["sensitivity"] != 0.0
    parts = procedure_of("accelerometer-tumble").report(findings, document)
    assert "Temperatures by place" in [part.title for part in parts]


@pytest.mark.campaign
def test_the_scale_factor_over_temperature_has_the_spread_in_its_budget(tmp_path: Path) -> None:
    outcome, _ = short_run(tmp_path, 3, bench_name="sim-alternate")
    assert outcome.exit_code == 0, outcome.error
    document, findings = evaluate_run(RunFolder(outcome.folder))
    spread_K = widest(findings.detail.dataset.places).spread_degC
    assert spread_K == pytest.approx(0.25, abs=0.05)
    for axis in "xyz":
        budget = document.result("scale_factor_error", axis).to_data()["budget"]
        (own,) = [one for one in budget if one["quantity"] == GRADIENT]
        assert own["standard_uncertainty"] == pytest.approx(spread_K / math.sqrt(3.0))
        assert own["sensitivity"] != 0.0
