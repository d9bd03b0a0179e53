"""Imported laser-gyro datasets: the examples within tolerance, and what stamps mean."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from places import DATA

from station.cli.analysing import analyse_dataset
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
