"""Imported positions: the example within tolerance, inputs of the budget, the command line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from bad_input_files import here
from places import DATA

from procedures.accelerometer_tumble.evaluate import findings_of_dataset
from station.dataset_reading import read_dataset

DATA = DATA / "accelerometer-tumble"
Row = list[str]


def test_the_example_comes_out_within_its_tolerance() -> None:
    findings = findings_of_dataset(read_dataset(DATA))
    truth = json.loads((DATA / "truth.json").read_text(encoding="utf-8"))
    found = {(one.name, one.axis): one for one in findings.estimates}
    for expected in truth["expected"]:
        one = found[expected["name"], expected.get("axis")]
        assert one.unit == expected["unit"]
        assert one.value is not None
        assert abs(one.value - expected["value"]) < expected["tolerance"], one
        assert dict(one.extra.get("terms", {})) == expected.get("terms", {})
        squares = [one.sensitivities[name] ** 2 for name in ("encoder", "mounting")]
        u = ((one.standard_uncertainty or 0.0) ** 2 + sum(squares)) ** 0.5
        assert u == pytest.approx(expected["crlb"], rel=0.1)
    for name in truth["null"]:
        assert found[name["name"], None].value is None
    flags = {one.code: one for one in findings.flags}
    assert set(flags) >= {one["code"] for one in truth["flags"]}
    assert flags["not-identifiable"].details["coefficients"] == truth["not_identifiable"]
    published = {one.name: one.value for one in findings.published}
    assert (published["Ko"] or 0.0) > 5e-4  # the fixture's error is in it


def changed(folder: Path, change: Callable[[Row], Row], conditions: str = "") -> Path:
    """Write the example with each row changed."""
    head, *rows = (DATA / "positions.csv").read_text(encoding="utf-8").splitlines()
    lines = [head, *(",".join(change(row.split(","))) for row in rows)]
    (folder / "positions.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = (DATA / "dataset.yaml").read_text(encoding="utf-8").rstrip() + "\n" + conditions
    (folder / "dataset.yaml").write_text(text, encoding="utf-8")
    return folder


def test_multimeter_and_gravity_are_inputs_of_the_budget(tmp_path: Path) -> None:
    stated = "  local_gravity_uncertainty: 20 ug\n  multimeter_gain: 10 ppm\n"
    findings = findings_of_dataset(read_dataset(changed(tmp_path, lambda row: row, stated)))
    inputs = {one.name: one.standard_uncertainty for one in findings.inputs}
    assert {inputs.pop(name) for name in ("thermometer_degC", "multimeter_zero")} == {None}
    assert inputs == pytest.approx(
        {"encoder": 1.0, "mounting": 1.0, "local_gravity": 20e-6, "multimeter_gain": 10e-6}
    )
    scale = next(one for one in findings.estimates if one.name == "Ki")
    assert scale.sensitivities["multimeter_gain"] == scale.value
    assert scale.sensitivities["local_gravity"] == -(scale.value or 0.0)


def test_the_command_line_analyses_it(tmp_path: Path) -> None:
    done = here(["analyse", str(DATA), "--output", "out", "--json"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["procedure"] == "accelerometer-tumble"
