"""Calibration records: what is missing, what nothing uses, and corrections that are applied."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from plan_runs import run_of as execute_plan
from plan_runs import shipped_bench, shipped_plan
from rlg_runs import short_run
from short_forms import SHORT_FORMS
from tiers import quick

from station import registry
from station.cli.validating import outlook_of, read_bench_named, read_plan_for
from station.files.faults import FaultList
from station.files.lookup import PLANS, find
from station.files.yaml.reading import read_yaml_text
from station.findings import Findings
from station.instruments.bench import Bench, bench_of
from station.procedure import procedure_of
from station.record.folder import RunFolder
from station.recorded import read_plan_and_bench
from station.results import OUTSIDE_RANGE, UNCALIBRATED, conclude
from station.runner.calibration_flags import record_flags
from station.runner.evaluation import quiet_numbers

RLG, ACCELEROMETER, SERF, FOG, NINE = (
    "rlg-magnetic-sensitivity",
    "accelerometer-magnetic-sensitivity",
    "serf-nonorthogonality",
    "fog-scale-factor-temperature",
    "nine-axis-calibration",
)
NEEDED = {
    RLG: ["gaussmeter", "gyro_acquisition"],
    ACCELEROMETER: ["gaussmeter", "multimeter"],
    SERF: ["digitizer"],
    FOG: ["turntable"],
    NINE: ["turntable"],
}
ONE_AXIS = {"parameters/axes": ["IA"], "parameters/duration": "100 s"}
TEN_DEG = {"quantity": "angle", "absolute": "10 deg", "coverage_factor": 1.0}


def bench_with(records: Mapping[str, Mapping[str, Any] | None] | None) -> Bench:
    """Return the simulated bench with other entries in some records, or without any record."""
    data = shipped_bench()
    for name, entry in data["instruments"].items():
        if records is None:
            entry.pop("calibration", None)
        elif name in records:
            record = {"due": "2036-01-15", **entry.get("calibration", {})}
            for key, more in (records[name] or {}).items():
                kept = [one for one in record.get(key, []) if one["quantity"] != more["quantity"]]
                record[key] = [more, *kept]
            entry["calibration"] = record
    document = read_yaml_text(yaml.safe_dump(data), Path("bench.yaml"))
    return bench_of(document, registry.names(registry.DRIVERS))


def flags_on(procedure: str, bench: Bench, *changes: str) -> dict[str, list[dict[str, Any]]]:
    """Return the flags that a plan gets from the records of a bench, by code."""
    plan = read_plan_for(procedure, read_bench_named("sim"), changes)
    found: dict[str, list[dict[str, Any]]] = {}
    for flag in record_flags(procedure_of(plan.procedure), plan.parameters, bench):
        found.setdefault(flag.code, []).append({"message": flag.message, **flag.details})
    return found


def findings(folder: Path, bench: Bench) -> Findings:
    """Return what the data of a run say on a bench with other records."""
    run = RunFolder(folder)
    plan, _ = read_plan_and_bench(run)
    with quiet_numbers():
        return procedure_of(plan.procedure).evaluate_run(run, plan.parameters, bench)


def values(found: Findings) -> dict[tuple[str, str | None], float]:
    """Return the values that were determined."""
    return {(one.name, one.axis): one.value for one in found.estimates if one.value is not None}


def test_a_bench_without_calibration_records_does_not_pass(tmp_path: Path) -> None:
    plan, bench = shipped_plan(RLG), shipped_bench()
    plan["parameters"] |= {"axes": ["IA"], "duration": "100 s"}
    plan["parameters"]["warm_up"] = {"slope_limit": "10 deg/h^2", "window": "1 min"}
    for entry in bench["instruments"].values():
        entry.pop("calibration", None)
    outcome = execute_plan(tmp_path, plan, bench)
    assert outcome.document is not None
    flags = {flag.code: flag for flag in outcome.document.flags}
    assert flags["uncalibrated"].details["instruments"] == NEEDED[RLG]
    assert (outcome.document.verdict, outcome.exit_code) == ("inconclusive", 6)


@pytest.mark.parametrize("procedure", quick(NEEDED, RLG, FOG))
def test_what_an_analysis_needs_and_lacks_is_named_and_evaluated_without(
    procedure: str, run_of: Callable[[str], Path]
) -> None:
    bare = bench_with(None)
    (flag,) = flags_on(procedure, bare).pop("uncalibrated")
    assert flag["instruments"] == NEEDED[procedure]
    folder = run_of(procedure)
    whole = findings(folder, read_bench_named("sim"))
    assert values(findings(folder, bare)) == values(whole)


@pytest.mark.parametrize("path", sorted(find(PLANS, RLG).parent.glob("*.yaml")), ids=str)
def test_shipped_benches_have_the_records_that_shipped_plans_need(path: Path) -> None:
    for name in ("sim", "sim-alternate"):
        bench = read_bench_named(name)
        plan = read_plan_for(str(path), read_bench_named("sim"))
        procedure = procedure_of(plan.procedure)
        if set(procedure.walk(plan.parameters).instruments) <= set(bench.instruments):
            found = record_flags(procedure, plan.parameters, bench)
            assert not {flag.code for flag in found} & {UNCALIBRATED, OUTSIDE_RANGE}, name


@pytest.mark.parametrize(
    ("procedure", "instrument", "entries", "named"),
    [
        (
            RLG,
            "gaussmeter",
            {"corrections": {"quantity": "angle", "offset": "1 deg"}},
            "correction of angle",
        ),
        (
            RLG,
            "coil_supply.x",
            {"uncertainty": {"quantity": "current", "relative": "1 %", "coverage_factor": 2.0}},
            "uncertainty of current",
        ),
        (
            ACCELEROMETER,
            "gaussmeter",
            {"corrections": {"quantity": "angle", "offset": "1 deg"}},
            "correction of angle",
        ),
        (SERF, "signal_generator.xy", {}, "uncertainty of scale"),
        (
            FOG,
            "turntable",
            {"corrections": {"quantity": "angle", "offset": "1 deg"}},
            "correction of angle",
        ),
    ],
)
def test_records_that_nothing_uses_are_named(
    procedure: str, instrument: str, entries: dict[str, Any], named: str
) -> None:
    bench = bench_with({instrument: entries})
    unused = {one["instrument"]: one for one in flags_on(procedure, bench)["calibration-unused"]}
    assert unused[instrument]["unused"] == [named]
    warnings = outlook_of(read_plan_for(procedure, bench), bench)["warnings"]
    assert unused[instrument]["message"] in warnings


def test_records_that_are_used_are_not_named_as_unused() -> None:
    known = "parameters.coil_constants=known"
    assert flags_on(SERF, read_bench_named("sim"), known) == {}
    assert flags_on(RLG, bench_with({"gaussmeter": {"uncertainty": TEN_DEG}})) == {}


SHIFT = 1.01
CORRECTIONS = [
    (RLG, "gaussmeter", "field", ("magnetic_sensitivity", "IA"), 1 / SHIFT),
    (RLG, "gyro_acquisition", "scale", ("magnetic_sensitivity", "IA"), SHIFT),
    (ACCELEROMETER, "gaussmeter", "field", ("Km", None), 1 / SHIFT),
    (ACCELEROMETER, "multimeter", "voltage", ("Km", None), SHIFT),
    pytest.param(
        *(SERF, "digitizer", "frequency", ("slowing_down_factor", None), 1 / SHIFT),
        marks=pytest.mark.campaign,
    ),
    pytest.param(
        *(NINE, "turntable", "angle", ("scale_factor", "X"), 1 / SHIFT), marks=pytest.mark.campaign
    ),
]


@pytest.mark.parametrize(("procedure", "instrument", "quantity", "result", "factor"), CORRECTIONS)
def test_a_correction_that_is_stated_is_applied(
    procedure: str,
    instrument: str,
    quantity: str,
    result: tuple[str, str | None],
    factor: float,
    run_of: Callable[[str], Path],
) -> None:
    folder = run_of(procedure)
    before = values(findings(folder, read_bench_named("sim")))
    entry = {"corrections": {"quantity": quantity, "gain": SHIFT}}
    after = values(findings(folder, bench_with({instrument: entry})))
    assert after[result] / before[result] == pytest.approx(factor, rel=2e-4)


def test_corrections_of_angle_and_temperature_are_applied(run_of: Callable[[str], Path]) -> None:
    folder = run_of(ACCELEROMETER)
    before = findings(folder, read_bench_named("sim")).detail.dataset
    bench = bench_with(
        {
            "rotary_stage": {"corrections": {"quantity": "angle", "offset": "1 deg"}},
            "thermometer": {"corrections": {"quantity": "temperature", "offset": "20 K"}},
        }
    )
    after = findings(folder, bench).detail.dataset
    assert after.theta_deg == pytest.approx(before.theta_deg + 1.0)
    assert after.temperature_degC == pytest.approx(before.temperature_degC + 20.0)


def test_corrections_of_known_coil_constants_are_applied(run_of: Callable[[str], Path]) -> None:
    from procedures.serf_nonorthogonality.evaluate import dataset_of_run

    run = RunFolder(run_of(SERF))
    plan = read_plan_for(
        SERF, read_bench_named("sim"), (*SHORT_FORMS[SERF], "parameters.coil_constants=known")
    )
    entry = {"corrections": {"quantity": "scale", "gain": SHIFT}}
    shown = [
        dataset_of_run(run, plan.parameters, bench).commanded_nT
        for bench in (read_bench_named("sim"), bench_with({"signal_generator.xy": entry}))
    ]
    assert shown[1] == pytest.approx(shown[0] * [SHIFT, SHIFT, 1.0])


def test_the_direction_of_a_gaussmeter_of_three_axes_is_in_u(
    run_of: Callable[[str], Path],
) -> None:
    folder = run_of(RLG)
    known = [
        conclude(RLG, findings(folder, bench), {}, "simple").results[0].combined
        for bench in (
            read_bench_named("sim"),
            bench_with({"gaussmeter": {"uncertainty": TEN_DEG}}),
        )
    ]
    assert known[0] is not None
    assert known[1] is not None
    assert any("direction of the gaussmeter" in line.description for line in known[1].budget)
    assert known[1].standard_uncertainty > known[0].standard_uncertainty


def test_the_probe_and_the_thermometer_of_an_accelerometer_are_in_u(
    run_of: Callable[[str], Path],
) -> None:
    folder = run_of(ACCELEROMETER)
    bench = bench_with({"gaussmeter": {"uncertainty": TEN_DEG}})
    documents = [
        conclude(ACCELEROMETER, findings(folder, used), {}, "simple")
        for used in (read_bench_named("sim"), bench)
    ]
    probes = [
        {line.quantity: line for line in document.result("Km").budget}["probe_cosine"]
        for document in documents
    ]
    assert (probes[0].standard_uncertainty, probes[0].source) == (None, "not stated")
    size = 1.0 - math.cos(math.radians(10.0))
    assert probes[1].contribution == pytest.approx(size * abs(probes[1].sensitivity))
    lines = {line.quantity: line for line in documents[0].result("K0").budget}
    assert lines["thermometer_degC"].standard_uncertainty == pytest.approx(0.05)
    assert lines["thermometer_degC"].contribution > 0.0


def test_a_gaussmeter_that_states_another_quantity_alone_is_uncalibrated(tmp_path: Path) -> None:
    only = [TEN_DEG]
    change = {"instruments/gaussmeter/calibration/uncertainty": only}
    outcome, _ = short_run(tmp_path, plan=ONE_AXIS, bench=change)
    assert outcome.document is not None
    flags = {flag.code: flag for flag in outcome.document.flags}
    assert flags["uncalibrated"].details["instruments"] == ["gaussmeter"]
    assert outcome.exit_code == 6


def test_a_field_outside_the_certified_range_does_not_pass_and_is_named(tmp_path: Path) -> None:
    entry = {"quantity": "field", "up_to": "0.5 mT", "relative": "1 %", "coverage_factor": 2}
    change = {"instruments/gaussmeter/calibration/uncertainty": [entry]}
    outcome, _ = short_run(tmp_path, plan=ONE_AXIS, bench=change)
    assert outcome.document is not None
    flags = {flag.code: flag for flag in outcome.document.flags}
    assert "uncalibrated" not in flags
    assert flags["outside-certified-range"].details["value"].startswith("1.0")
    assert (outcome.document.verdict, outcome.exit_code) == ("inconclusive", 6)


def test_what_was_measured_is_held_against_the_certified_range_and_not_the_plan_alone(
    tmp_path: Path,
) -> None:
    entry = {"quantity": "field", "up_to": "1 mT", "relative": "1 %", "coverage_factor": 2}
    change = {"instruments/gaussmeter/calibration/uncertainty": [entry]}
    outcome, _ = short_run(tmp_path, plan=ONE_AXIS, bench=change)
    assert outcome.document is not None
    (outside,) = [f for f in outcome.document.flags if f.code == "outside-certified-range"]
    assert 1.0 < float(outside.details["value"].removesuffix(" mT")) < 1.1
    assert outcome.document.verdict == "inconclusive"
    procedure = procedure_of(RLG)
    plan = read_plan_for(RLG, read_bench_named("sim"))
    used = bench_with({"gaussmeter": {"uncertainty": entry}})
    assert not [*record_flags(procedure, plan.parameters, used)]
    for value, codes in ((0.9999, []), (1.0001, ["outside-certified-range"])):
        known = {("gaussmeter", "field"): (value,)}
        flags = record_flags(procedure, plan.parameters, used, known)
        assert [flag.code for flag in flags] == codes


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"up_to": "-3.5 mT", "relative": "0.5 %", "coverage_factor": 2}, "ranges are of the magn"),
        ({"relative": "500 %", "coverage_factor": 2}, "relative: must be at most 1, not '500 %'"),
        ({"relative": "0.5 %", "coverage_factor": 2000}, "coverage_factor: must be at most 250"),
        ({"gain": 1e-9}, "gain: must be at least 0.001"),
    ],
)
def test_absurd_records_are_refused_at_their_place(entry: dict[str, Any], said: str) -> None:
    kind = "corrections" if "gain" in entry else "uncertainty"
    with pytest.raises(
        FaultList, match=re.escape(f"instruments.gaussmeter.calibration.{kind}[1].")
    ):
        bench_with({"gaussmeter": {kind: {"quantity": "field", **entry}}})
    with pytest.raises(FaultList, match=re.escape(said)):
        bench_with({"gaussmeter": {kind: {"quantity": "field", **entry}}})
