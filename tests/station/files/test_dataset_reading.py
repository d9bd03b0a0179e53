"""An imported dataset is checked down to the cell before anything is computed from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from station.dataset_reading import RawDataset, check_ascending, read_dataset, read_table
from station.files.yaml.reading import FaultList

HEADER = "dataset: 1\nprocedure: rlg-magnetic-sensitivity\n"


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def dataset(folder: Path, text: str) -> RawDataset:
    write(folder, "dataset.yaml", HEADER + text)
    return read_dataset(folder)


def table_faults(path: Path, *columns: str) -> list[str]:
    with pytest.raises(FaultList) as caught:
        read_table(path, columns)
    assert caught.value.exit_code == 2
    return [str(fault).removeprefix(f"{path}:") for fault in caught.value.faults]


def test_a_dataset_is_given_as_its_file_or_its_folder(tmp_path: Path) -> None:
    samples = write(tmp_path, "samples.csv", "t_s\n1\n")
    raw = dataset(tmp_path, "files: {samples: samples.csv}\nconditions: {rate: 1 Hz}\n")
    assert raw.procedure == "rlg-magnetic-sensitivity"
    assert raw.file("samples") == samples
    assert raw.document.data["conditions"] == {"rate": "1 Hz"}
    assert read_dataset(tmp_path / "dataset.yaml").files == raw.files


def test_the_faults_of_a_dataset_file_are_reported_at_once(tmp_path: Path) -> None:
    write(tmp_path, "samples.csv", "t_s\n1\n")
    files = "files: {samples: sample.csv, other: ../other.csv}\nconditons: {}\n"
    with pytest.raises(FaultList) as caught:
        dataset(tmp_path, files)
    path = tmp_path / "dataset.yaml"
    assert [str(fault).removeprefix(f"{path}:") for fault in caught.value.faults] == [
        "1:1: conditions: is missing",
        "3:18: files.samples: there is no file 'sample.csv' in the dataset's folder; did you mean "
        "'samples.csv'",
        "3:37: files.other: '../other.csv' lies outside the dataset's folder; copy it into the "
        "folder",
        "4:1: conditons: is not known here; did you mean 'conditions'",
    ]


def test_a_procedure_says_which_files_it_needs(tmp_path: Path) -> None:
    write(tmp_path, "a.csv", "t_s\n1\n")
    raw = dataset(tmp_path, "files: {sample: a.csv}\nconditions: {}\n")
    with pytest.raises(FaultList, match=r"files.samples: is missing"):
        raw.file("samples")
    with pytest.raises(FaultList) as caught:
        raw.require_files(["samples"], ["drive"])
    said = str(caught.value)
    assert "files.samples: is missing" in said
    assert "files.sample: is not known here; did you mean 'samples'" in said


def test_a_folder_without_a_dataset_file_is_explained(tmp_path: Path) -> None:
    with pytest.raises(FaultList, match=r"dataset.yaml:1:1: file: the path does not exist"):
        read_dataset(tmp_path)


def test_columns_are_numbers_in_any_order_and_words_where_asked_for(tmp_path: Path) -> None:
    path = write(tmp_path, "a.csv", "\ufeffplane, v_V ,t_s\r\nio,1e-3,0\r\n\r\nip, -2 ,0.5\r\n")
    table = read_table(path, ("t_s", "plane"), optional=("v_V", "w_V"), text=("plane",))
    np.testing.assert_array_equal(table["t_s"], [0.0, 0.5])
    np.testing.assert_array_equal(table["v_V"], [0.001, -2.0])
    assert table["plane"].tolist() == ["io", "ip"]
    assert list(table.lines) == [2, 4]
    assert "w_V" not in table


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("", ["1:1: file: the file is empty"]),
        ("\n \n", ["1:1: file: the file is empty"]),
        ("t_s,b_mT\n", ["1:1: file: the file has a header but no rows"]),
        ("t_s\n1\n", ["1:1: b_mT: the column is missing"]),
        (
            "t_s,b_uT\n1,2\n",
            [
                "1:1: b_mT: the column is missing",
                "1:5: b_uT: the column is not known; did you mean 'b_mT'",
            ],
        ),
        (
            "t_s,b_mT,colour\n1,2,3\n",
            ["1:10: colour: the column is not known; known are t_s, b_mT"],
        ),
        ("t_s,b_mT,t_s\n1,2,3\n", ["1:10: t_s: the column stands twice"]),
        (
            "t_s;b_mT\n1;2\n",
            ["1:1: header: the columns are separated by ';' or tabs; separate them by ','"],
        ),
        (
            "t_s,b_mT\n1,2\n2\n3,4,5\n",
            ["3:1: row: has one cell, not 2", "4:1: row: has 3 cells, not 2"],
        ),
        (
            "t_s,b_mT\n1,x\n2.5,\n3,nan\ninf,1\n",
            [
                "2:3: b_mT: 'x' is not a number",
                "3:5: b_mT: is empty",
                "4:3: b_mT: 'nan' is not a number",
                "5:1: t_s: 'inf' is not a number",
            ],
        ),
    ],
)
def test_what_is_wrong_in_a_table_is_named_with_its_row(
    tmp_path: Path, text: str, faults: list[str]
) -> None:
    assert table_faults(write(tmp_path, "a.csv", text), "t_s", "b_mT") == faults


def test_a_table_full_of_faults_is_reported_briefly(tmp_path: Path) -> None:
    path = write(tmp_path, "a.csv", "t_s\n" + "x\n" * 1000)
    faults = table_faults(path, "t_s")
    assert len(faults) == 21
    assert faults[-1] == "22:1: file: and 980 more faults from here on"


def test_a_table_that_is_not_utf_8_is_explained(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"t_s\n1\n\xb0\n")
    assert table_faults(path, "t_s") == [
        "3:1: file: byte 0xb0 is not UTF-8; save the file as UTF-8"
    ]


def test_times_that_run_backwards_or_stand_still_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path, "a.csv", "n_1,t_s\n0,1\n0,2\n\n0,1.5\n0,1.5\n0,9\n")
    table = read_table(path, ("n_1", "t_s"))
    with pytest.raises(FaultList) as caught:
        check_ascending(path, table, "t_s")
    assert [str(fault).removeprefix(f"{path}:") for fault in caught.value.faults] == [
        "5:1: t_s: 1.5 is before 2 of the row above; times must rise",
        "6:1: t_s: 1.5 repeats 1.5 of the row above; times must rise",
    ]
    check_ascending(path, table, "n_1", strictly=False)
