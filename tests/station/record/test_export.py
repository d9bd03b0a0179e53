"""The raw data of a run as HDF5, CSV and MATLAB files, opened as another program would."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from campaign_helpers import station
from command_line import station_command
from limited_files import LIMITED
from numpy.typing import NDArray
from scipy.io import loadmat

from station.record.export.csv_files import export_csv
from station.record.export.hdf5 import CHUNK_ROWS, FEW_ROWS, export_hdf5
from station.record.export.mat import KEYWORDS, export_mat, valid_names
from station.record.export.reading import CountedTime, blocks_of
from station.record.folder import RunFolder
from station.record.raw import RawFile

UNITS = {
    ("gaussmeter", "IA"),
    ("gyro_acquisition", "IA"),
    ("gyro_acquisition", "warm-up"),
}
INTERVAL_S = 0.1


@pytest.fixture(scope="module")
def run(one_axis_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    parent = tmp_path_factory.mktemp("exports")
    folder = shutil.copytree(one_axis_run, parent / "runs" / one_axis_run.name)
    shutil.rmtree(folder / "exports", ignore_errors=True)
    return folder


@pytest.fixture(scope="module")
def broken_off(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was killed while IA was recorded: log and raw file are cut short."""
    copy = shutil.copytree(run, tmp_path_factory.mktemp("broken") / run.name)
    lines = (copy / "events.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    last = next(n for n, line in enumerate(lines) if json.loads(line).get("unit") == "IA")
    (copy / "events.jsonl").write_text("".join(lines[: last + 1]), encoding="utf-8")
    raw = copy / "raw" / "gyro_acquisition-000.mcap"
    raw.write_bytes(raw.read_bytes()[:-2000])
    (copy / "results.json").unlink()
    (copy / "manifest.json").unlink()
    return copy


@pytest.fixture(scope="module")
def exported(run: Path) -> Iterator[h5py.File]:
    path = run / "exports" / "again.h5"
    export_hdf5(RunFolder(run), path)
    with h5py.File(path) as file:
        yield file


def data_groups(file: h5py.File) -> dict[tuple[str, str], h5py.Group]:
    """Return the groups that call themselves NXdata, by the last two parts of their path."""
    found: dict[tuple[str, str], h5py.Group] = {}

    def look(name: str, thing: Any) -> None:
        if thing.attrs.get("NX_class") == "NXdata":
            *_, source, unit = name.split("/")
            found[source, unit] = thing

    file.visititems(look)
    return found


def time_axes(group: h5py.Group) -> list[h5py.Dataset]:
    """Return the time axes of an NXdata group by its attributes alone, its main axis first."""
    signal = group[group.attrs["signal"]]
    indexed = [name.removesuffix("_indices") for name in group.attrs if name.endswith("_indices")]
    (main,) = group.attrs["axes"]
    names = [main, *(name for name in indexed if name != main)]
    axes = [group[name] for name in names]
    assert all(axis.shape == signal.shape for axis in axes)
    return [axis for axis in axes if axis.attrs["units"] == "s"]


def test_hdf5_says_of_every_column_its_unit_and_what_it_is(exported: h5py.File) -> None:
    groups = data_groups(exported)
    assert set(groups) == UNITS
    for group in groups.values():
        for column in group.values():
            assert column.attrs["units"]
            assert column.attrs["long_name"]
    gaussmeter = groups["gaussmeter", "IA"]
    named = [gaussmeter.attrs["signal"], *gaussmeter.attrs["auxiliary_signals"]]
    assert {gaussmeter[name].attrs["units"] for name in named} == {"T", "1"}
    temperature = groups["gyro_acquisition", "IA"]["temperature_degC"]
    assert temperature.attrs["units"] == "degC"


def test_the_time_axes_of_hdf5_are_found_by_attributes(exported: h5py.File, run: Path) -> None:
    for (source, unit), group in data_groups(exported).items():
        own, arrival = time_axes(group)
        assert (np.diff(own[:]) > 0).all()
        recorded = RunFolder(run).rows(source, unit)
        assert (arrival[:] == recorded["arrival_time_s"]).all()
        if source == "gyro_acquisition":  # it stamps by counting
            steps = np.diff(recorded["sequence"].astype(int)) % 65536
            assert np.diff(own[:]) == pytest.approx(INTERVAL_S * steps)
        else:
            assert (own[:] == recorded["instrument_time_s"]).all()


def test_a_viewer_that_follows_the_defaults_ends_at_a_signal(exported: h5py.File) -> None:
    classes, group = [], exported
    while "default" in group.attrs:
        classes.append(group.attrs["NX_class"])
        group = group[group.attrs["default"]]
    assert classes == ["NXroot", "NXentry", "NXsubentry"]
    assert group.attrs["NX_class"] == "NXdata"
    assert group[group.attrs["signal"]].shape[0] > 0


def test_hdf5_holds_every_row_exactly_and_packs_with_gzip_and_shuffle_only(
    exported: h5py.File, run: Path
) -> None:
    folder = RunFolder(run)
    for (source, unit), group in data_groups(exported).items():
        rows = folder.rows(source, unit)
        for name in rows.dtype.names or ():
            assert group[name].dtype == rows[name].dtype
            assert (group[name][:] == rows[name]).all()
            packed = ("gzip", True) if len(rows) > FEW_ROWS else (None, False)
            assert (group[name].compression, group[name].shuffle) == packed


def test_hdf5_holds_the_texts_and_the_log_as_a_table(exported: h5py.File, run: Path) -> None:
    assert exported["plan"].asstr()[()] == (run / "plan.yaml").read_text(encoding="utf-8")
    assert exported["bench"].asstr()[()] == (run / "bench.yaml").read_text(encoding="utf-8")
    results = json.loads(exported["results"].asstr()[()])
    assert results == json.loads((run / "results.json").read_text(encoding="utf-8"))
    table, events = exported["events"], RunFolder(run).events
    assert table["time_s"].attrs["units"] == "s"
    assert list(table["time_s"]) == [event.time_s for event in events]
    assert list(table["event"].asstr()) == [event.kind for event in events]
    assert [json.loads(text) for text in table["details"].asstr()] == [
        event.details for event in events
    ]


def test_finished_and_unfinished_units_are_exported_and_told_apart(
    broken_off: Path, tmp_path: Path
) -> None:
    export_hdf5(RunFolder(broken_off), tmp_path / "part.h5")
    with h5py.File(tmp_path / "part.h5") as file:
        groups = data_groups(file)
        assert set(groups) == UNITS
        states = {unit: group.attrs["state"] for (_, unit), group in groups.items()}
        assert states == {"warm-up": "finished", "IA": "unfinished"}
        assert len(groups["gyro_acquisition", "IA"]["counts"]) > 900
        assert "results" not in file


def test_what_was_recorded_in_many_blocks_is_whole(tmp_path: Path, run: Path) -> None:
    copy = shutil.copytree(run, tmp_path / run.name)
    count, block = 3 * CHUNK_ROWS + 17, 1000
    rows = np.empty(count, dtype=[("v_V", np.float64), ("arrival_time_s", np.float64)])
    rows["v_V"] = np.arange(count)
    rows["arrival_time_s"] = np.arange(count) / 1000
    raw = RawFile(copy / "raw" / "adc-000.mcap", "adc", {"v_V": "V at the input"})
    for start in range(0, count, block):
        raw.write("shot/1", rows[start : start + block])
    raw.close()
    export_hdf5(RunFolder(copy), tmp_path / "many.h5")
    with h5py.File(tmp_path / "many.h5") as file:
        group = data_groups(file)["adc", "shot_1"]
        assert group.attrs["unit_of_work"] == "shot/1"
        assert (group["v_V"][:] == rows["v_V"]).all()
        assert [axis.name.rpartition("/")[2] for axis in time_axes(group)] == ["arrival_time_s"]


def test_a_counter_that_wraps_between_two_blocks_counts_on() -> None:
    counted = CountedTime("n", 0.5)
    blocks = [np.array(values, dtype=[("n", np.uint16)]) for values in ([65533, 65535], [1, 2])]
    times = np.concatenate([counted.times_s(block) for block in blocks])
    assert list(times) == [0.0, 1.0, 2.0, 2.5]


def test_csv_is_a_file_for_each_source_and_unit_with_the_recorded_columns(run: Path) -> None:
    done = station("export", run, "--format", "csv")
    assert done.returncode == 0, done.stderr
    place = Path(done.stdout.strip())
    assert place == run / "exports" / "csv"
    assert {path.name for path in place.iterdir()} == {f"{s}-{u}.csv" for s, u in UNITS}
    for source, unit in UNITS:
        rows = RunFolder(run).rows(source, unit)
        with (place / f"{source}-{unit}.csv").open(encoding="utf-8", newline="") as file:
            head, *lines = csv.reader(file)
        assert tuple(head) == rows.dtype.names
        values: NDArray[np.float64] = np.array(lines, dtype=float)
        for column, name in enumerate(head):
            assert (values[:, column] == rows[name]).all()


def test_csv_names_an_unfinished_unit_so_and_drops_that_name_once_it_is_finished(
    broken_off: Path, run: Path, tmp_path: Path
) -> None:
    place = tmp_path / "csv"
    export_csv(RunFolder(broken_off), place)
    assert (place / "gyro_acquisition-IA.unfinished.csv").is_file()
    assert (place / "gyro_acquisition-warm-up.csv").is_file()
    export_csv(RunFolder(run), place)
    assert {path.name for path in place.iterdir()} == {f"{s}-{u}.csv" for s, u in UNITS}


def test_mat_holds_a_struct_for_each_source_and_unit(run: Path) -> None:
    done = station("export", run, "--format", "mat")
    assert done.returncode == 0, done.stderr
    path = Path(done.stdout.strip())
    assert path.read_bytes()[:19] == b"MATLAB 5.0 MAT-file"
    data = loadmat(path, simplify_cells=True)
    for source, unit in UNITS:
        struct = data["raw"][source][unit.replace("-", "_")]
        rows = RunFolder(run).rows(source, unit)
        assert struct["unit_of_work"] == unit
        assert bool(struct["finished"]) is True
        for name in rows.dtype.names or ():
            assert (struct[name] == rows[name]).all()
            assert struct["units"][name]
            assert struct["long_names"][name]
    assert data["raw"]["gaussmeter"]["IA"]["units"]["x_T"] == "T"
    assert json.loads(data["results"])["procedure"] == "rlg-magnetic-sensitivity"
    assert [str(kind) for kind in data["events"]["event"]] == [
        event.kind for event in RunFolder(run).events
    ]


def test_mat_marks_an_unfinished_unit(broken_off: Path, tmp_path: Path) -> None:
    export_mat(RunFolder(broken_off), tmp_path / "part.mat")
    gyro = loadmat(tmp_path / "part.mat", simplify_cells=True)["raw"]["gyro_acquisition"]
    assert bool(gyro["warm_up"]["finished"]) is True
    assert bool(gyro["IA"]["finished"]) is False


def test_names_become_different_names_that_matlab_takes() -> None:
    names = ["warm-up", "warm_up", "end", "3rd", "_x", "+40 degC, 0.5 mT", "a" * 80, "a" * 79]
    found = valid_names(names)
    assert found[:4] == ["warm_up", "warm_up_2", "xend", "x3rd"]
    assert len(set(found)) == len(names)
    for name in found:
        assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", name)
        assert name not in KEYWORDS


def test_the_command_writes_into_exports_and_nothing_half_written_stays(run: Path) -> None:
    done = station("export", run, "--format", "hdf5")
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()) == run / "exports" / f"{run.name}.h5"
    assert h5py.is_hdf5(done.stdout.strip())
    assert not list((run / "exports").rglob("*.part"))
    assert "exports" not in (run / "manifest.json").read_text(encoding="utf-8")


def test_the_raw_data_of_a_run_folder_are_the_same_after_an_export(run: Path) -> None:
    before = {path: path.read_bytes() for path in (run / "raw").iterdir()}
    for source in ("gaussmeter", "gyro_acquisition"):
        assert sum(len(rows) for _, rows in blocks_of(RunFolder(run), source))
    export_hdf5(RunFolder(run), run / "exports" / "once-more.h5")
    assert {path: path.read_bytes() for path in (run / "raw").iterdir()} == before


@pytest.mark.skipif(sys.platform == "win32", reason="there is no file-size limit to set")
@pytest.mark.parametrize("format", ["hdf5", "csv", "mat"])
def test_a_full_disk_is_one_sentence_and_the_older_export_stays(
    run: Path, tmp_path: Path, format: str
) -> None:
    copy = shutil.copytree(run, tmp_path / run.name)
    shutil.rmtree(copy / "exports", ignore_errors=True)
    older = Path(station("export", copy, "--format", format).stdout.strip())
    files = [older] if older.is_file() else sorted(older.iterdir())
    before = [file.read_bytes() for file in files]
    arguments = station_command("export", copy, "--format", format)[3:]
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, "9000", *arguments],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 3, done.stderr
    assert "cannot write" in done.stderr
    assert "make room on the disk" in done.stderr
    assert "Traceback" not in done.stderr
    assert [file.read_bytes() for file in files] == before
    assert not list((copy / "exports").rglob("*.part"))
