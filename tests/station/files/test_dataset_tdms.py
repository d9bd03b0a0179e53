"""A record in TDMS is analysed to the last byte as the same one in CSV, and refused as plainly."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nptdms import ChannelObject, TdmsFile, TdmsWriter
from places import DATA

from station.dataset_reading import read_dataset, read_table
from station.files.faults import FaultList
from station.runner.evaluation import evaluate_dataset

EXAMPLES = ("rlg-one-axis", "gyro-static-noise", "gyro-rate-table", "gyro-bias-temperature")

Groups = Mapping[str, Mapping[str, Sequence[Any]]]


def write(path: Path, groups: Groups) -> Path:
    """Write a TDMS file with nptdms: a channel for each column of each group."""
    with TdmsWriter(path) as file:
        for group, columns in groups.items():
            channels = [ChannelObject(group, name, values) for name, values in columns.items()]
            file.write_segment(channels)
    return path


def columns_of(path: Path) -> dict[str, Sequence[Any]]:
    """Return a CSV file's columns, numbers where every cell is one."""
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    columns: dict[str, Sequence[Any]] = {}
    for name, cells in zip(head, zip(*rows, strict=True), strict=True):
        try:
            columns[name] = np.array([float(cell) for cell in cells])
        except ValueError:
            columns[name] = list(cells)
    return columns


def table_faults(path: Path) -> list[str]:
    with pytest.raises(FaultList) as caught:
        read_table(path, ("t_s", "rate_deg_per_h"), text=("phase",), group="samples")
    return [line.removeprefix(f"{path}:") for line in str(caught.value).splitlines()]


@pytest.mark.parametrize("example", EXAMPLES)
def test_a_gyro_record_in_tdms_gives_the_results_of_csv_to_the_last_byte(
    example: str, tmp_path: Path
) -> None:
    place = Path(shutil.copytree(DATA / example, tmp_path / example))
    (file,) = place.glob("*.csv")
    write(file.with_suffix(".tdms"), {"Untitled": columns_of(file)})
    file.unlink()
    text = (place / "dataset.yaml").read_text(encoding="utf-8")
    changed = text.replace(file.name, f"{file.stem}.tdms")
    (place / "dataset.yaml").write_text(changed, encoding="utf-8")
    results = [
        json.dumps(evaluate_dataset(read_dataset(folder))[0].to_data())
        for folder in (DATA / example, place)
    ]
    assert results[0] == results[1]


def test_of_several_groups_that_of_the_datasets_name_is_read(tmp_path: Path) -> None:
    groups = {"drive": {"t_s": [9.0]}, "samples": {"t_s": [1, 2], "rate_deg_per_h": [0.5, -0.5]}}
    path = write(tmp_path / "a.TDMS", groups)
    table = read_table(path, ("t_s", "rate_deg_per_h"), group="samples")
    np.testing.assert_array_equal(table["t_s"], [1.0, 2.0])
    assert table["t_s"].dtype == np.float64 and list(table.lines) == [1, 2]
    assert table_faults(write(path, {"drive": {"t_s": [1.0]}, "pairs": {"t_s": [1.0]}})) == [
        "1:1: file: the file has several groups and none is called 'samples'; it has drive, pairs"
    ]


@pytest.mark.parametrize(
    ("columns", "faults"),
    [
        ({}, ["1:1: file: the file is empty"]),
        ({"t_s": [1.0]}, ["1:1: rate_deg_per_h: the column is missing"]),
        (
            {"t_s": [1.0], "rate_deg_per_s": [1.0], "Voltage, 0": [1.0]},
            [
                "1:1: rate_deg_per_h: the column is missing",
                "1:5: rate_deg_per_s: the column is not known; did you mean 'rate_deg_per_h'",
                "1:20: Voltage, 0: the column is not known; known are t_s, rate_deg_per_h",
            ],
        ),
        (
            {"t_s": [1.0, 2.0], "rate_deg_per_h": [1.0]},
            ["1:1: rate_deg_per_h: has 1 values, 't_s' has 2"],
        ),
        (
            {"t_s": [1.0, 2.0], "rate_deg_per_h": ["a", "b"]},
            ["1:1: rate_deg_per_h: holds no numbers; write numbers in the unit that its name has"],
        ),
        (
            {"t_s": [np.nan, 2.0, np.inf], "rate_deg_per_h": [1.0, 1e39, 2.0]},
            [
                "1:1: t_s: 'nan' is not a number",
                "2:1: rate_deg_per_h: '1e+39' is too large for anything that is measured",
                "3:1: t_s: 'inf' is not a number",
            ],
        ),
    ],
)
def test_every_fault_is_a_sentence_with_channel_and_row(
    columns: Mapping[str, Sequence[Any]], faults: list[str], tmp_path: Path
) -> None:
    assert table_faults(write(tmp_path / "a.tdms", {"samples": columns})) == faults


def test_too_little_memory_is_no_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "a.tdms", {"samples": {"t_s": [1.0], "rate_deg_per_h": [1.0]}})

    def without_room(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(TdmsFile, "open", without_room)
    with pytest.raises(MemoryError):
        read_table(path, ("t_s", "rate_deg_per_h"), group="samples")


def test_what_is_no_tdms_or_was_cut_off_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.tdms"
    path.write_bytes(b"t_s,rate_deg_per_h\n1,2\n")
    damaged = ["1:1: file: the file is no TDMS file, or it is damaged"]
    assert table_faults(path) == damaged
    write(path, {"samples": {"t_s": np.arange(9.0), "rate_deg_per_h": np.arange(9.0)}})
    whole = path.read_bytes()
    path.write_bytes(whole[:-8])
    assert table_faults(path) == ["1:1: file: the file ends within its last segment; copy it again"]
    for length in range(1, len(whole)):
        path.write_bytes(whole[:length])
        assert table_faults(path), length
