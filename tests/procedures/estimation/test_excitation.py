"""A field that is not the commanded one gives no verdict on the device: exit code 3, and why."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from accelerometer_records import record as accelerometer_record
from places import DATA, ROOT
from rlg_records import analysed, record
from rlg_runs import short_run
from serf_shots import Cell

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse as of_accelerometer
from procedures.estimation.flags import LARGEST_ERROR
from procedures.rlg_magnetic_sensitivity.frequencies import Drive
from procedures.serf_nonorthogonality.analysis import analyse as of_cell
from station.cli.analysing import analyse_data
from station.findings import Flag
from station.record.folder import RunFolder
from station.report.tables import junit_of

CODE = "wrong-excitation"
COIL = "instruments/coil_supply.{}/simulator/coil"


def wrong(flags: object) -> list[Flag]:
    return [flag for flag in flags if flag.code == CODE]  # type: ignore[attr-defined]


def test_wrong_excitation_of_a_run_gives_no_verdict_on_the_device(tmp_path: Path) -> None:
    # The supply of IA drives the strong coil, which the gyro does not feel.
    outcome, _ = short_run(
        tmp_path,
        plan={
            "parameters/axes": ["IA"],
            "limits": {"magnetic_sensitivity": {"max_abs": "5 deg/h/mT"}},
        },
        bench={COIL.format("x"): "dc", COIL.format("dc"): "x"},
    )
    document = outcome.document
    assert outcome.exit_code == 3 and document is not None, outcome.error
    assert document.verdict == "inconclusive"
    assert {one.decision.verdict for one in document.results} == {"inconclusive"}
    (flag,) = wrong(document.flags)
    assert "coil IA appears on no axis" in flag.message
    assert "two supplies exchanged" in flag.message
    assert analyse_data(outcome.folder, None, compare=False, as_json=True) == 3
    assert f'<error type="{CODE}"' in junit_of(RunFolder(outcome.folder), document)


def test_two_exchanged_supplies_are_named(tmp_path: Path) -> None:
    outcome, _ = short_run(
        tmp_path,
        plan={"parameters/axes": ["IA", "LA"]},
        bench={COIL.format("x"): "z", COIL.format("z"): "x"},
    )
    assert outcome.exit_code == 3 and outcome.document is not None, outcome.error
    assert [flag.details["appears_on"] for flag in wrong(outcome.document.flags)] == ["LA", "IA"]
    assert "supplies of IA and LA exchanged?" in wrong(outcome.document.flags)[0].message


@pytest.mark.parametrize(
    ("gain", "found"), [(0.0, "is missing"), (-1.0, "reversed"), (0.3, "weak")]
)
def test_wrong_excitation_of_an_accelerometer(gain: float, found: str) -> None:
    (flag,) = wrong(of_accelerometer(accelerometer_record(3, field_gain=gain)).flags)
    assert found in flag.message
    assert flag.details["relative_difference"] == pytest.approx(gain - 1.0, abs=0.01)


def test_an_imported_record_with_exchanged_columns_is_no_verdict(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = shutil.copytree(DATA / "rlg-three-axes-at-once", tmp_path / "data")
    with (place / "samples.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    first, last = rows[0].index("b_ia_mT"), rows[0].index("b_la_mT")
    for row in rows[1:]:
        row[first], row[last] = row[last], row[first]
    with (place / "samples.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(rows)
    assert analyse_data(place, tmp_path / "out", compare=False, as_json=True) == 3
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "The device was not exposed to the commanded field" in page
    document = json.loads(capsys.readouterr().out)
    assert document["verdict"] == "inconclusive"
    named = [flag for flag in document["flags"] if flag["code"] == CODE]
    assert {(flag["axis"], flag["appears_on"]) for flag in named} == {("IA", "LA"), ("LA", "IA")}


def test_the_bound_is_half_of_the_commanded_field() -> None:
    for error, count in ((-0.9, 0), (0.9, 0), (-1.1, 1), (1.1, 1)):
        gain = 1.0 + error * LARGEST_ERROR
        assert len(wrong(analysed(record(1, coils=gain * np.eye(3))).flags)) == count
        assert len(wrong(of_accelerometer(accelerometer_record(1, field_gain=gain)).flags)) == count


def test_a_line_is_found_where_it_is_although_its_own_axis_is_silent() -> None:
    coils = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    drive = {"IA": Drive(0.1, 1.0), "NA": Drive(0.13, 1.0), "LA": Drive(0.17, 1.0)}
    segment = record(
        2,
        drive={k: replace(d, frequency_Hz=d.frequency_Hz * 1.001) for k, d in drive.items()},
        coils=coils,
        cycles=300.0,
    )
    flags = wrong(analysed(replace(segment, drive=drive)).flags)
    assert [(flag.axis, flag.details["appears_on"]) for flag in flags] == [
        ("IA", "LA"),
        ("LA", "IA"),
    ]
    one_axis = segment.field_mT * np.array([1.0, 0.0, 0.0])
    (flag,) = wrong(analysed(replace(segment, drive={"IA": drive["IA"]}, field_mT=one_axis)).flags)
    assert "is missing" in flag.message


@pytest.mark.parametrize("coil", [0, 1, 2])
def test_a_coil_that_does_not_turn_the_spins_is_named(coil: int) -> None:
    cell = Cell(noise_V=0.002, known=True, residual_nT=(0.3, 0.2, 0.4))
    assert not wrong(of_cell(cell.dataset(0)).flags)
    shots = cell.but(
        pattern=tuple(
            tuple(0 if k == coil else one for k, one in enumerate(shot)) for shot in cell.pattern
        )
    )
    seen = shots.dataset(0)
    told = [
        replace(shot, field_nT=field)
        for shot, field in zip(seen.shots, cell.commanded_nT, strict=True)
    ]
    flags = wrong(of_cell(replace(seen, shots=told)).flags)
    assert [flag.axis for flag in flags] == ["xyz"[coil]]


def test_the_bound_stands_in_the_docs() -> None:
    page = ROOT / "docs" / "reference" / "flags.md"
    assert f"more than {100 * LARGEST_ERROR:g} %" in page.read_text(encoding="utf-8")
