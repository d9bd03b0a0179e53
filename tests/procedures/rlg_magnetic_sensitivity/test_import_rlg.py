"""Imported laser-gyro datasets: the examples within tolerance, every fault in one sentence."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from places import DATA

from station.cli.analysing import analyse_dataset
from station.files.faults import FaultList
from station.results import ResultDocument

EXAMPLES = sorted(path.name for path in DATA.glob("rlg-*"))


def analysed(path: Path) -> ResultDocument:
    return analyse_dataset(path, None)


def copy_of(name: str, folder: Path, **replacements: str) -> Path:
    """Copy an example and replace text in its dataset.yaml; `__` stands for a colon and blank."""
    place = folder / name
    shutil.copytree(DATA / name, place)
    text = (place / "dataset.yaml").read_text(encoding="utf-8")
    for old, new in replacements.items():
        key = old.replace("__", ": ").replace("_dash_", "-")
        assert key in text, key
        text = text.replace(key, new)
    (place / "dataset.yaml").write_text(text, encoding="utf-8")
    return place


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_come_out_within_their_tolerance(name: str) -> None:
    truth = json.loads((DATA / name / "truth.json").read_text(encoding="utf-8"))
    document = analysed(DATA / name)
    values = {(r.estimate.name, r.estimate.axis): r.estimate.value for r in document.results}
    assert len(values) == len(truth["expected"])
    for expected in truth["expected"]:
        value = values[expected["name"], expected["axis"]]
        assert value is not None
        assert abs(value - expected["value"]) < expected["tolerance"]
    assert document.verdict == "none"


def test_file_and_folder_name_the_same_dataset() -> None:
    folder, file = DATA / "rlg-one-axis", DATA / "rlg-one-axis" / "dataset.yaml"
    assert analysed(folder).to_data() == analysed(file).to_data()


def test_the_time_stamps_convention_changes_the_phase(tmp_path: Path) -> None:
    name = "rlg-counts"  # 1 s intervals at 0.16 Hz: half an interval is 29 degrees
    right = analysed(DATA / name).results[0].estimate.value
    wrong = copy_of(name, tmp_path, timestamp__interval_dash_end="timestamp: interval-start")
    value = analysed(wrong).results[0].estimate.value
    assert right is not None
    assert value is not None
    assert abs(value) < 0.8 * abs(right)


def fault_of(path: Path) -> str:
    with pytest.raises(FaultList) as caught:
        analysed(path)
    return str(caught.value)


@pytest.mark.parametrize(
    ("replacements", "said"),
    [
        ({"timestamp__interval_dash_end": "note: x"}, "timestamp"),
        ({"field_timestamp__instantaneous": "field_timestamp: interval-end"}, "field_averaging"),
        ({"gyro_output__rate": "gyro_output: counts"}, "pulse_weight"),
        ({"sample_interval__0.1 s": "sample_interval: 0.1"}, "sample_interval"),
        ({"sample_interval__0.1 s": "sample_intervall: 0.1 s"}, "did you mean"),
        ({"gyro_output__rate": "gyro_output: angle"}, "gyro_output"),
    ],
)
def test_a_wrong_condition_is_one_sentence(
    tmp_path: Path, replacements: dict[str, str], said: str
) -> None:
    message = fault_of(copy_of("rlg-one-axis", tmp_path, **replacements))
    assert said in message
    assert "dataset.yaml:" in message


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda lines: [], "empty"),
        (lambda lines: lines[:1], "no"),
        (lambda lines: [lines[0].replace("b_la_mT", "b_la"), *lines[1:]], "b_la_mT"),
        (lambda lines: [*lines[:9], "0.900,none,0,0,0", *lines[10:]], ":10:"),
        (lambda lines: [*lines[:9], lines[4], *lines[10:]], ":10:"),
        (lambda lines: [*lines[:9], "0.900,9.1,0,0", *lines[10:]], ":10:"),
    ],
)
def test_a_wrong_table_names_file_row_and_reason(tmp_path: Path, spoil, said: str) -> None:
    place = copy_of("rlg-one-axis", tmp_path)
    table = place / "samples.csv"
    lines = spoil(table.read_text(encoding="utf-8").splitlines())
    table.write_text("\n".join(lines) + "\n" * bool(lines), encoding="utf-8")
    message = fault_of(place)
    assert "samples.csv" in message
    assert said in message


def test_missing_rows_and_spikes_are_survived_and_said(tmp_path: Path) -> None:
    place = copy_of("rlg-one-axis", tmp_path)
    table = place / "samples.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    kept = [*lines[:700], *lines[740:]]
    time, _, *field = kept[1200].split(",")
    kept[1200] = ",".join([time, "99.0", *field])
    table.write_text("\n".join(kept) + "\n", encoding="utf-8")
    document = analysed(place)
    (result,) = document.results
    assert result.estimate.value is not None
    assert result.combined is not None
    assert abs(result.estimate.value - 0.031) < 3 * result.combined.standard_uncertainty
    flags = {flag.code: flag for flag in document.flags}
    assert flags["outliers-rejected"].details["count"] == 1
    assert "gap" in flags
    assert document.published[0].value is None
