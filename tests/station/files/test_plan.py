"""A plan is read as a whole: header, device, parameters and limits, with all their faults."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest
from pydantic import BaseModel, ValidationInfo, field_validator

from station.decision import Limit
from station.fields import Hertz, Millitesla, StrictModel
from station.files.lookup import BENCHES, PLANS, available, find
from station.files.plan import Plan, plan_of, read_plan
from station.files.yaml.document import yaml_text
from station.files.yaml.reading import FaultList, read_yaml_text


class ShakeParameters(StrictModel):
    frequency_Hz: Hertz
    amplitude_mT: Millitesla = 1.0

    @field_validator("amplitude_mT")
    @classmethod
    def within_reach(cls, amplitude_mT: float, info: ValidationInfo) -> float:
        frequency_Hz = info.data.get("frequency_Hz")
        if frequency_Hz is not None and amplitude_mT * frequency_Hz > 1:
            raise ValueError("the supply cannot follow")
        return amplitude_mT


@dataclass(frozen=True)
class Kind:
    axes: tuple[str, ...]
    unit: str


@dataclass(frozen=True)
class Shake:
    parameters: type[BaseModel]
    results: dict[str, Kind]


PROCEDURES = {
    "shake-and-listen": Shake(
        ShakeParameters,
        {"sensitivity": Kind(("IA", "NA"), "deg/h/mT"), "gain": Kind((), "1")},
    )
}

GOOD = """\
plan: 1
procedure: shake-and-listen
title: "验收：三轴"
operator: J. Doe
dut: {model: M-1, serial: SN-0042}
parameters: {frequency: 0.1 Hz, amplitude: 500 uT}
limits:
  sensitivity: {IA: {max_abs: 0.1 deg/h/mT}, NA: {min: -1 deg/h/mT, max: 2 deg/h/mT}}
  gain: {min: 0.99, max: 1.01}
decision_rule: guarded
"""


def plan_from(text: str) -> Plan:
    return plan_of(read_yaml_text(text, Path("plan.yaml")), PROCEDURES)


def faults_of(text: str) -> list[str]:
    with pytest.raises(FaultList) as caught:
        plan_from(text)
    return [str(fault).removeprefix("plan.yaml:") for fault in caught.value.faults]


def test_a_plan_gives_device_parameters_rule_and_limits() -> None:
    plan = plan_from(GOOD)
    assert plan.procedure == "shake-and-listen"
    assert plan.dut.serial == "SN-0042"
    assert plan.decision_rule == "guarded"
    assert plan.parameters == ShakeParameters.model_validate(
        {"frequency": "0.1 Hz", "amplitude": "0.5 mT"}
    )
    assert plan.limits_by_axis() == {
        ("sensitivity", "IA"): Limit(max_abs=0.1),
        ("sensitivity", "NA"): Limit(min=-1.0, max=2.0),
        ("gain", None): Limit(min=0.99, max=1.01),
    }


def test_a_limit_on_a_whole_result_holds_for_each_of_its_axes() -> None:
    text = GOOD.replace("{IA: {max_abs: 0.1 deg/h/mT}, NA:", "").replace("mT}}", "mT}")
    limits = plan_from(text).limits_by_axis()
    assert limits["sensitivity", "IA"] == limits["sensitivity", "NA"] == Limit(min=-1.0, max=2.0)


def test_the_resolved_plan_spells_out_defaults_and_reads_back_the_same() -> None:
    plan = plan_from(GOOD.replace(", amplitude: 500 uT", ""))
    again = plan_from(yaml_text(plan.to_yaml_data()))
    assert plan.to_yaml_data()["parameters"] == {"frequency": "0.1 Hz", "amplitude": "1 mT"}
    assert again.parameters == plan.parameters
    assert again.header.dut == plan.header.dut
    assert again.limits_by_axis() == plan.limits_by_axis()


def test_the_faults_of_all_parts_are_reported_at_once() -> None:
    faults = faults_of(
        "plan: 2\n"
        "procedure: shake-and-listen\n"
        "dut: {model: M-1, serial: 0042}\n"
        "parameters: {frequency: 1 Hz, amplitude: 3 mT, amplitud: 1}\n"
        "limits:\n"
        "  sensitivty: {max: 1 deg/h/mT}\n"
        "  sensitivity: {IA: {min: 2 deg/h/mT, max: 1 deg/h/mT}, QA: {max: 1}}\n"
        "  gain: {max_abs: 3 mT}\n"
        "decision_rule: strict\n"
        "notes: x\n"
    )
    assert faults == [
        "1:7: plan: must be 1, not 2",
        '3:27: dut.serial: must be text, not 42; did you mean "0042"',
        "4:42: parameters.amplitude: the supply cannot follow",
        "4:48: parameters.amplitud: is not known here; did you mean 'amplitude'",
        "6:3: limits.sensitivty: is no result of this procedure; did you mean 'sensitivity'",
        "7:27: limits.sensitivity.IA.min: is above max (1 deg/h/mT); exchange them",
        "7:57: limits.sensitivity.QA: is not known here; known are IA, NA",
        "8:19: limits.gain.max_abs: '3 mT' is a magnetic field, expected a ratio such as '0.5 %'",
        "9:16: decision_rule: must be 'simple' or 'guarded', not 'strict'",
        "10:1: notes: is not known here; known are plan, procedure, title, operator, released, "
        "check_standard, dut, customer, room, parameters, limits, decision_rule, references, "
        "deviations, extends, vars",
    ]


@pytest.mark.parametrize(
    ("limit", "fault"),
    [
        ("{}", "must be a mapping of min, max, max_abs, or of axes"),
        ("3 deg/h/mT", "must be a mapping of min, max, max_abs, or of axes"),
        ("{IA: {}}", "limits.sensitivity.IA: must be a mapping of min, max, max_abs"),
        ("{max_abs: -1 deg/h/mT}", "a magnitude cannot be below zero"),
        ("{max_abs: 1 deg/h/mT, min: 0 deg/h/mT}", "give it alone, or min and max"),
        ("{IA: {max: 1 deg/h/mT}, max: 1 deg/h/mT}", "stands beside axes"),
        ("{maxabs: 1 deg/h/mT}", "did you mean 'max_abs'"),
        ("{max: 0.1}", "0.1 has no unit, expected a magnetic sensitivity of rate"),
    ],
)
def test_a_limit_that_cannot_be_held_is_refused(limit: str, fault: str) -> None:
    start = GOOD.index("  sensitivity:")
    end = GOOD.index("  gain:")
    found = faults_of(GOOD[:start] + f"  sensitivity: {limit}\n" + GOOD[end:])
    assert len(found) == 1
    assert fault in found[0]


def test_an_unknown_procedure_is_answered_with_the_one_that_was_meant() -> None:
    assert faults_of(GOOD.replace("shake-and-listen", "shake_and_lisen")) == [
        "2:12: procedure: there is no procedure 'shake_and_lisen'; did you mean 'shake-and-listen'"
        "; there are shake-and-listen"
    ]


def test_a_plan_without_parameters_names_those_that_are_missing() -> None:
    text = GOOD.replace("parameters: {frequency: 0.1 Hz, amplitude: 500 uT}\n", "")
    assert faults_of(text) == ["1:1: parameters.frequency: is missing"]


@pytest.mark.parametrize("serial", ["a/b", "a\\b", "a:b"])
def test_a_serial_number_that_cannot_name_a_folder_is_refused(serial: str) -> None:
    assert "may not hold" in faults_of(GOOD.replace("SN-0042", f"'{serial}'"))[0]


def test_a_serial_number_that_is_too_long_for_a_folder_is_refused() -> None:
    assert plan_from(GOOD.replace("SN-0042", "A" * 100)).dut.serial == "A" * 100
    (fault,) = faults_of(GOOD.replace("SN-0042", "A" * 101))
    assert "dut.serial: names the run folder and has 101 characters; 100 at most" in fault


def test_a_fault_found_later_is_placed_in_the_plan() -> None:
    fault = plan_from(GOOD).fault(("parameters", "amplitude"), "is too much for the bench")
    assert str(fault) == "plan.yaml:6:44: parameters.amplitude: is too much for the bench"


def test_a_plan_is_found_as_a_path_then_in_the_folder_then_in_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config" / "plans").mkdir(parents=True)
    own = Path("config", "plans", "own.yaml")
    own.write_text(GOOD, encoding="utf-8")
    Path("loose.yaml").write_text(GOOD, encoding="utf-8")
    assert find(PLANS, "own") == find(PLANS, "own.yaml") == own
    assert find(PLANS, "loose.yaml") == Path("loose.yaml")
    assert find(BENCHES, "sim").is_file()
    assert ("own", "config/plans/own.yaml") in [
        (name, Path(where).as_posix()) for name, where in available(PLANS)
    ]
    assert read_plan(find(PLANS, "own"), PROCEDURES).dut.model == "M-1"
    said = r"no such plan, neither as a file nor by name; did you mean 'own'; there are .*own"
    with pytest.raises(FaultList, match=said):
        find(PLANS, "owm")
    with pytest.raises(FaultList, match=r"nor by name; there are .*own"):
        find(PLANS, "zzz")


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("lose.yaml", "the path does not exist; did you mean 'loose.yaml'"),
        ("config/plans/owm.yaml", f"did you mean '{Path('config', 'plans', 'own.yaml')}'"),
        ("sim.yml", "the path does not exist; did you mean 'sim'"),
        ("config/none", "the path does not exist"),
        ("none/own.yaml", "the path does not exist: there is no folder none"),
        ("config", "is a folder, not a file"),
    ],
)
def test_a_path_that_is_not_there_is_said_to_be_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("config", "plans").mkdir(parents=True)
    for file in (Path("loose.yaml"), Path("config", "plans", "own.yaml")):
        file.write_text(GOOD, encoding="utf-8")
    with pytest.raises(FaultList) as raised:
        find(BENCHES, path)
    (told,) = str(raised.value).splitlines()
    assert said in told
    assert "there are" not in told
