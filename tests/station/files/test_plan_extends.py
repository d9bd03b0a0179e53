"""A plan may say only in what it differs: `extends`, `vars` and `--set`, with faults in place."""

from __future__ import annotations

from pathlib import Path
from time import process_time

import pytest

from station.files.faults import FaultList
from station.files.plan import Plan, read_plan
from station.procedure import Procedures

BASE = """\
plan: 1
procedure: rlg-magnetic-sensitivity
dut: {model: RLG-50, serial: SN-0042}
parameters:
  frequency: 0.1 Hz
  amplitude: 1 mT
  sample_interval: 0.1 s
  duration: 550 s
  axes: [IA, NA, LA]
  pulse_weight: 0.0625 arcsec
  warm_up: {slope_limit: 0.4 deg/h^2, window: 10 min}
limits:
  magnetic_sensitivity: {max_abs: 0.1 deg/h/mT}
"""
WITH_VARS = BASE.replace("0.1 Hz", "${drive}").replace("1 mT", '"${field}"') + (
    "vars:\n  drive: 0.1 Hz\n  field: 1 mT\n"
)


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def write(name: str, text: str) -> Path:
    path = Path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def read(name: str, *overrides: str) -> Plan:
    return read_plan(Path(name), Procedures(), overrides)


def faults_of(name: str, *overrides: str) -> list[str]:
    with pytest.raises(FaultList) as caught:
        read(name, *overrides)
    return [str(fault) for fault in caught.value.faults]


def test_mappings_merge_and_lists_are_replaced() -> None:
    write("base.yaml", BASE)
    write(
        "variant.yaml",
        "extends: base\nparameters: {axes: [NA], warm_up: {window: 5 min}}\n"
        "limits: {magnetic_sensitivity: {min: 0 deg/h/mT, max_abs: 0.1 deg/h/mT}}\n",
    )
    assert faults_of("variant.yaml") == [
        "variant.yaml:3:50: limits.magnetic_sensitivity.max_abs: limits the magnitude; give it "
        "alone, or min and max"
    ]
    write("variant.yaml", "extends: base\nparameters: {axes: [NA], warm_up: {window: 5 min}}\n")
    plan = read("variant.yaml")
    assert plan.parameters.axes == ("NA",)
    assert plan.parameters.warm_up.window_s == 300
    assert plan.parameters.warm_up.slope_limit_deg_per_h2 == 0.4
    assert plan.dut.serial == "SN-0042"
    assert plan.bases == (Path("base.yaml"),)
    assert plan.text.startswith("extends: base")


def test_a_base_is_a_path_from_the_plans_folder_or_a_name_and_may_have_a_base() -> None:
    write("plans/deep/base.yaml", "extends: rlg-magnetic-sensitivity\noperator: A\ntitle: T\n")
    write("plans/middle.yaml", "extends: deep/base.yaml\noperator: B\n")
    write("plans/own.yaml", "extends: middle\ndut: {serial: SN-7}\n")
    plan = read("plans/own.yaml")
    assert (plan.dut.serial, plan.dut.model) == ("SN-7", "RLG-50")
    assert (plan.operator, plan.title) == ("B", "T")
    assert [path.name for path in plan.bases] == [
        "middle.yaml",
        "base.yaml",
        "rlg-magnetic-sensitivity.yaml",
    ]


def test_a_fault_is_told_at_the_line_of_the_file_in_which_the_value_stands() -> None:
    write("base.yaml", BASE.replace("1 mT", "9 mT").replace("  duration: 550 s\n", ""))
    write("variant.yaml", "extends: base\nparameters:\n  frequency: 3 Hz\n  amplitud: 1 mT\n")
    assert faults_of("variant.yaml") == [
        "base.yaml:6:14: parameters.amplitude: the method is published for 0.1 mT to 2 mT",
        "variant.yaml:3:3: parameters.duration: is missing",
        "variant.yaml:3:14: parameters.frequency: the method is published for 0.05 Hz to 0.2 Hz",
        "variant.yaml:4:3: parameters.amplitud: is not known here; did you mean 'amplitude'",
    ]


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("extends: bse", "did you mean 'base'"),
        ("extends: nothing-like-it", "there are base, "),
        ("extends: [base]", "must be the name of another plan"),
        ("extends:", "must be the name of another plan"),
        ("extends: own", "in a circle: own.yaml extends own.yaml"),
        ("extends: circle", "in a circle: own.yaml extends circle.yaml extends own.yaml"),
    ],
)
def test_a_base_that_cannot_be_used_is_told_where_it_is_asked_for(line: str, fault: str) -> None:
    write("base.yaml", BASE)
    write("circle.yaml", "extends: own.yaml\n")
    write("own.yaml", f"{line}\n")
    told = faults_of("own.yaml")
    assert len(told) == 1
    assert told[0].split(".yaml:1:")[0] in ("own", "circle")
    assert ": extends: " in told[0]
    assert fault in told[0]


def test_a_base_that_is_no_yaml_is_told_by_its_own_name() -> None:
    write("base.yaml", "plan: 1\nplan: 1\n")
    write("own.yaml", "extends: base\n")
    assert faults_of("own.yaml") == [
        "base.yaml:2:1: plan: the key stands twice, first in line 1; keep one"
    ]


def test_a_changed_base_is_read_again() -> None:
    write("base.yaml", BASE)
    write("own.yaml", "extends: base\n")
    assert read("own.yaml").dut.serial == "SN-0042"
    write("base.yaml", BASE.replace("SN-0042", "SN-00043"))
    assert read("own.yaml").dut.serial == "SN-00043"


def test_vars_stand_for_whole_values_and_a_plan_may_override_those_of_its_base() -> None:
    write("base.yaml", WITH_VARS)
    write(
        "own.yaml",
        "extends: base\nvars: {drive: 0.2 Hz, axes: [LA]}\nparameters: {axes: '${axes}'}\n",
    )
    assert read("base.yaml").parameters.frequency_Hz == 0.1
    plan = read("own.yaml")
    assert (plan.parameters.frequency_Hz, plan.parameters.amplitude_mT) == (0.2, 1.0)
    assert plan.parameters.axes == ("LA",)


def test_a_value_that_replaces_a_var_leaves_the_bases_var_unused_and_that_is_no_fault() -> None:
    write("base.yaml", WITH_VARS)
    write("own.yaml", "extends: base\nparameters: {frequency: 0.2 Hz}\n")
    assert read("own.yaml").parameters.frequency_Hz == 0.2


def test_a_var_of_the_wrong_kind_is_told_where_the_var_stands() -> None:
    write("base.yaml", WITH_VARS)
    write("own.yaml", "extends: base\nvars:\n  drive: 3 mT\n")
    assert faults_of("own.yaml") == [
        "own.yaml:3:10: parameters.frequency: '3 mT' is a magnetic field, expected a frequency "
        "such as '0.1 Hz'"
    ]


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("${drive}", "${driv}", "plan.yaml:5:14: parameters.frequency: there is no var 'driv'; "
         "did you mean '${drive}'"),
        ("SN-0042", '"SN-${field}"', "plan.yaml:3:30: dut.serial: 'SN-${field}' holds '${' within "
         "a longer text; a var stands for a whole value: put all of the text into the var"),
        ("  field: 1 mT", "  field: 1 mT\n  feld: 2 mT", "plan.yaml:17:3: vars.feld: no value of "
         "the plan is '${feld}'; use the var or delete it; did you mean 'field'"),
        ("  field: 1 mT", "  field: {a: 1 mT}", "plan.yaml:16:10: vars.field: a var is one value "
         "or a list of values, not a mapping"),
        ("  field: 1 mT", "  field: ${drive}", "plan.yaml:16:10: vars.field: a var may not ask for "
         "another var; write the value out"),
        ("  field: 1 mT", "  field: 1 mT\n  1st: 2", "plan.yaml:17:3: vars.1st: is no name of a "
         "var; a name has letters, digits, '_' and '-'"),
        ("SN-0042", "${field}", 'plan.yaml:3:30: YAML: \'${…}\' within brackets or braces needs '
         'quotes, such as "${name}"'),
        ("vars:\n  drive: 0.1 Hz\n  field: 1 mT", "vars: 3", "plan.yaml:14:7: vars: must be a "
         "mapping of names and values"),
    ],
)  # fmt: skip
def test_a_var_that_cannot_be_filled_in_is_one_sentence(old: str, new: str, fault: str) -> None:
    write("plan.yaml", WITH_VARS.replace(old, new, 1))
    found = faults_of("plan.yaml")
    assert fault in found


def test_set_changes_values_lists_and_vars_of_the_merged_plan() -> None:
    write("base.yaml", WITH_VARS)
    write("own.yaml", "extends: base\nvars: {drive: 0.2 Hz}\n")
    plan = read(
        "own.yaml",
        "vars.drive=0.05 Hz",
        "parameters.axes = [LA, IA]",
        "parameters.thresholds.gap=2",
        "title=a # b",
        'operator="0042"',
        "limits.magnetic_sensitivity.max_abs=0.2 deg/h/mT",
    )
    assert plan.parameters.frequency_Hz == 0.05
    assert plan.parameters.axes == ("LA", "IA")
    assert plan.parameters.thresholds.gap == 2
    assert (plan.title, plan.operator) == ("a # b", "0042")
    assert plan.limits_by_axis()["magnetic_sensitivity", "LA"].max_abs == 0.2
    assert plan.overrides[0] == "vars.drive=0.05 Hz"


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ("x", "--set:2:1: x: 'x' is not key=value; write it like parameters.frequency=0.2 Hz"),
        ("=3", "--set:2:1: --set: '=3' is not key=value; write it like "
         "parameters.frequency=0.2 Hz"),
        ("parameters.frequncy=0.1 Hz", "--set:2:1: parameters.frequncy: is not known here; did you "
         "mean 'frequency'"),
        ("parameters.frequency=0.2", "--set:2:22: parameters.frequency: 0.2 has no unit, expected "
         "a frequency such as '0.1 Hz'; did you mean '0.2 Hz'"),
        ("parameters.axes=[IA, QA]", "--set:2:22: parameters.axes[2]: must be 'IA', 'NA' or 'LA', "
         "not 'QA'"),
        ("parameters.axes=[IA", "--set:2:17: parameters.axes: a list in brackets is not closed, or "
         "a ',' is missing"),
        ("parameters.warm_up={window: 3 s}", "--set:2:20: parameters.warm_up: set one value, or a "
         "list in brackets, with each --set; keys are joined by dots"),
        ("dut.serial.x=1", "--set:2:1: dut.serial.x: 'dut.serial' holds a value and no keys"),
        ("title=again", "--set:2:1: title: is set twice, first by --set number 1; keep one"),
        ("extends=base", "--set:2:1: extends: a plan extends what its file says; write a plan that "
         "extends the other"),
        ("parameters.amplitude=1\uff0e5 mT", "--set:2:23: parameters.amplitude: '\uff0e' is a "
         "full-width point; write '.', or put the text in quotes"),
    ],
)  # fmt: skip
def test_a_wrong_set_is_told_by_its_number_and_place(given: str, fault: str) -> None:
    write("plan.yaml", BASE)
    assert faults_of("plan.yaml", "title=first", given) == [fault]


@pytest.mark.campaign
def test_many_keys_are_laid_over_another_in_linear_time() -> None:
    keys = "".join(f"key_{n}: [{n}, {{a: {n}}}]\n" for n in range(10_000))
    write("base.yaml", BASE)
    write("plan.yaml", "extends: base\n" + keys)
    began_s = process_time()
    assert faults_of("plan.yaml")
    assert process_time() - began_s < 10.0
