"""The JSON Schemas say what the models say, and the shipped files follow them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft7Validator
from places import CONFIG
from typer.testing import CliRunner

from station import registry
from station.cli.app import app
from station.files.faults import FaultList
from station.files.plan import plan_of
from station.files.yaml.reading import read_yaml, read_yaml_text
from station.instruments.bench import bench_of
from station.procedure import Procedures
from station.schema import KINDS, schema_text

SHIPPED = [
    *((path, "plan") for path in sorted((CONFIG / "plans").glob("*.yaml"))),
    *((path, "bench") for path in sorted((CONFIG / "benches").glob("*.yaml"))),
]
PLAN = (CONFIG / "plans" / "rlg-magnetic-sensitivity.yaml").read_text(encoding="utf-8")
BENCH = (CONFIG / "benches" / "sim.yaml").read_text(encoding="utf-8")
DATASET = """\
dataset: 1
procedure: rlg-magnetic-sensitivity
files: {samples: samples.csv}
conditions:
  drive: {IA: {frequency: 0.08 Hz, amplitude: 1.2 mT}}
  sample_interval: 0.1 s
  timestamp: interval-end
  field_timestamp: instantaneous
  gyro_output: rate
"""


def schema_of(kind: str) -> dict[str, Any]:
    schema: dict[str, Any] = json.loads(schema_text(kind))
    return schema


def faults(kind: str, text: str) -> list[str]:
    data = read_yaml_text(text, Path("x.yaml")).data
    found = Draft7Validator(schema_of(kind)).iter_errors(data)
    return [f"{'.'.join(map(str, one.absolute_path))}: {one.message}" for one in found]


@pytest.mark.parametrize("kind", KINDS)
def test_the_copy_in_config_is_the_one_the_models_give(kind: str) -> None:
    copy = (CONFIG / "schemas" / f"{kind}.schema.json").read_text(encoding="utf-8")
    made = schema_text(kind, built_in=True)
    again = f"station schema {kind} --built-in > config/schemas/{kind}.schema.json"
    assert copy == made, f"the models have changed; run\n  {again}"


@pytest.mark.parametrize("kind", KINDS)
def test_the_verb_prints_a_valid_schema_of_draft_07(kind: str) -> None:
    done = CliRunner().invoke(app, ["schema", kind])
    assert done.exit_code == 0
    schema = json.loads(done.stdout)
    assert schema["$schema"] == "http://json-schema.org/draft-07/schema#"
    Draft7Validator.check_schema(schema)


@pytest.mark.parametrize(("path", "kind"), SHIPPED, ids=[path.name for path, _ in SHIPPED])
def test_a_shipped_file_names_its_schema_and_follows_it(path: Path, kind: str) -> None:
    first = path.read_text(encoding="utf-8").splitlines()[0]
    assert first == f"# yaml-language-server: $schema=../schemas/{kind}.schema.json"
    assert (path.parent / first.partition("$schema=")[2]).is_file()
    found = Draft7Validator(schema_of(kind)).iter_errors(read_yaml(path).data)
    assert [one.message for one in found] == []


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("frequency:", "frequenzy:", "parameters"),
        ("0.1 Hz ", "0.1 ", "parameters.frequency"),
        ("0.1 Hz ", "0.1 mT ", "parameters.frequency"),
        ("0.1 Hz ", "0.1Hz ", "parameters.frequency"),
        ("duration: 550 s", "duration: -550 s", "parameters.duration"),
        ("channel: 1", "channel: 7", "parameters.channel"),
        ("[IA, NA, LA]", "[IA, QA]", "parameters.axes"),
        ("    slope_limit: 0.4 deg/h^2", "    x: 1 s", "parameters.warm_up"),
        ("magnetic_sensitivity: {", "magnetic_sensitivty: {", "limits"),
        ("max_abs: 0.1 deg/h/mT", "max_abs: 0.1 deg/h", "limits.magnetic_sensitivity"),
        ("guarded", "strict", "decision_rule"),
        ("  serial: SN-0042", "  sn: SN-0042", "dut"),
        ("procedure: rlg-", "procedure: rlgg-", "procedure"),
        ("plan: 1", "plan: 2", "plan"),
        ("plan: 1", "", ""),
    ],
)
def test_a_faulty_plan_is_refused_by_the_schema_as_by_the_station(
    old: str, new: str, where: str
) -> None:
    text = PLAN.replace(old, new, 1)
    assert text != PLAN
    assert where in [fault.split(":")[0] for fault in faults("plan", text)]
    with pytest.raises(FaultList):
        plan_of(read_yaml_text(text, Path("plan.yaml")), Procedures())


@pytest.mark.parametrize(
    "text",
    [
        PLAN.replace("0.1 Hz ", "${drive} ") + "vars: {drive: 0.1 Hz}\n",
        PLAN.replace("[IA, NA, LA]", "${axes}") + "vars: {axes: [IA]}\n",
        PLAN.replace("0.1 Hz ", "+1E-1 Hz ").replace("550 s", "600  s"),
        PLAN.replace("{max_abs: 0.1 deg/h/mT}", "{IA: {max: 0.1 deg/h/mT}}"),
        "extends: rlg-magnetic-sensitivity\nparameters: {warm_up: {window: 5 min}}\n",
        "extends: rlg-magnetic-sensitivity\nprocedure: rlg-magnetic-sensitivity\n"
        "dut: {serial: SN-7}\nparameters: {warm_up: {window: 5 min}}\n",
    ],
)
def test_vars_and_extends_are_known_to_the_schema(text: str) -> None:
    assert faults("plan", text) == []
    plan_of(read_yaml_text(text, Path("plan.yaml")), Procedures())


def test_a_plan_that_extends_another_is_still_held_to_what_it_says() -> None:
    text = "extends: x\nprocedure: rlg-magnetic-sensitivity\nparameters: {frequency: 1 mT}\n"
    assert [fault.split(":")[0] for fault in faults("plan", text)] == ["parameters.frequency"]


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("driver: lakeshore-f71", "driver: lakeshore-f72", "instruments.gaussmeter.driver"),
        ("  gaussmeter:", "  gausmeter:", "instruments"),
        (", timestamp: interval-end", "", "instruments.gaussmeter.settings"),
        (
            ", timestamp: interval-end",
            ", timestamp: end",
            "instruments.gaussmeter.settings.timestamp",
        ),
        ('door: "2.2"', 'dor: "2.2"', "instruments.thermal_chamber.settings"),
        ("outer_axis: 1", "outer_axis: 4", "instruments.turntable.settings.outer_axis"),
        (
            "{coil_constant: 0.300 mT/A, coil_resistance: 1.2 ohm}",
            "{}",
            "instruments.coil_supply.x.settings",
        ),
        (", zero_current: 20 mA", "", "instruments.coil_supply.x.limits"),
        ("current: 8 A", "current: 8 V", "instruments.coil_supply.x.limits.current"),
        ("quantity: field", "quantity: filed", "instruments.gaussmeter.calibration"),
        ("up_to: 3.5 mT", "up_to: 3.5 mt", "instruments.gaussmeter.calibration"),
        ("{role: coil_supply,", "{", "safe_state.1"),
        ("{role: coil_supply,", "{rôle: coil_supply,", "safe_state.1"),
        ("name: sim\n", "", ""),
    ],
)
def test_a_faulty_bench_is_refused_by_the_schema_as_by_the_station(
    old: str, new: str, where: str
) -> None:
    text = BENCH.replace(old, new, 1)
    assert text != BENCH
    assert where in [fault.split(":")[0] for fault in faults("bench", text)]
    with pytest.raises(FaultList):
        bench_of(
            read_yaml_text(text, Path("b.yaml")), registry.names(registry.DRIVERS), bounded=True
        )


def test_the_conditions_of_a_dataset_follow_from_its_procedure() -> None:
    assert faults("dataset", DATASET) == []
    wrong = DATASET.replace("interval-end", "end").replace("sample_interval:", "sample_intervall:")
    assert {fault.split(":")[0] for fault in faults("dataset", wrong)} == {
        "conditions",
        "conditions.timestamp",
    }


def test_an_editor_shows_units_defaults_and_bounds() -> None:
    rules = schema_of("plan")["allOf"]
    parameters = next(
        rule["then"]["properties"]["parameters"]["properties"]
        for rule in rules
        if rule["if"].get("properties") == {"procedure": {"const": "rlg-magnetic-sensitivity"}}
    )
    assert parameters["settle"]["default"] == "20 s"
    assert parameters["settle"]["description"] == "a time such as '30 s'; at least 0 s"
