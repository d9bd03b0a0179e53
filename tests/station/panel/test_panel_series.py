"""What the plots show is thinned, never cut, and read as it grows."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from station.clock import RealClock
from station.panel.watching import LOOKS_EVERY_S, RunWatch
from station.record.folder import RunFolder
from station.record.raw_tail import RawTail
from station.record.series import MAX_POINTS, RunSeries, Thinned, columns_of


@pytest.mark.parametrize("block", [1, 7, 100, 5000])
def test_a_series_keeps_its_extremes_its_mean_and_its_length(block: int) -> None:
    time_s = np.arange(5000) * 0.1
    value = np.sin(time_s / 30.0)
    series = Thinned()
    for at in range(0, 5000, block):
        series.add(time_s[at : at + block], value[at : at + block])
    shown = series.data()
    assert MAX_POINTS // 3 <= len(shown["t"]) < MAX_POINTS
    assert all(a < b for a, b in zip(shown["t"][:-1], shown["t"][1:], strict=True))
    assert np.allclose(shown["v"], np.sin(np.array(shown["t"]) / 30.0), atol=1e-6)
    assert series.mean == pytest.approx(value.mean())


@pytest.mark.parametrize("block", [3, 1000])
def test_a_fast_sine_is_shown_as_large_as_it_is(block: int) -> None:
    time_s = np.arange(20_000) * 0.1
    value = 1.0e-3 * np.sin(2.0 * np.pi * 0.5 * time_s)
    series = Thinned()
    for at in range(0, 20_000, block):
        series.add(time_s[at : at + block], value[at : at + block])
    shown = np.array(series.data(factor=1e3)["v"])
    for part in np.array_split(shown, 20):  # no beat
        assert (part.min(), part.max()) == pytest.approx((-1.0, 1.0), abs=1e-6)


def test_rows_that_came_together_keep_the_least_and_the_greatest() -> None:
    series = Thinned()
    for look in range(1000):
        series.add(np.full(10, float(look)), np.linspace(-1.0, 1.0, 10))
    assert set(series.data()["v"]) == {-1.0, 1.0}


def test_the_field_is_plotted_in_the_unit_in_which_it_is_set(one_axis_run: Path) -> None:
    plots = RunSeries(one_axis_run)
    plots.look()
    (columns,) = (plot["columns"] for plot in plots.data() if plot["source"] == "gaussmeter")
    assert set(columns) == {"x_mT", "y_mT", "z_mT"}
    assert max(columns["x_mT"]["v"]) == pytest.approx(1.0, abs=0.06)


def test_all_columns_that_are_chosen_are_read_however_many_stand_before_them() -> None:
    rows = np.zeros(2, [(f"c{n}_T", "f8") for n in range(9)] + [("air_degC", "f8")])
    assert columns_of(rows) == [f"c{n}_T" for n in range(4)]
    assert columns_of(rows, lambda name: name.endswith("_degC")) == ["air_degC"]


def test_what_is_no_number_is_left_out() -> None:
    series = Thinned()
    series.add(np.arange(4.0), np.array([1.0, np.nan, np.inf, 2.0]))
    assert series.data() == {"t": [0.0, 3.0], "v": [1.0, 2.0]}


def test_the_tail_of_a_raw_file_has_every_row_once(one_axis_run: Path, tmp_path: Path) -> None:
    whole = (one_axis_run / "raw" / "gyro_acquisition-000.mcap").read_bytes()
    growing = tmp_path / "raw" / "gyro_acquisition-000.mcap"
    growing.parent.mkdir()
    growing.write_bytes(b"")
    tail, rows = RawTail(growing), 0
    for end in [*range(0, len(whole), 20_011), len(whole)]:
        growing.write_bytes(whole[:end])
        rows += sum(len(one) for _, one in tail.new_rows())
    folder = RunFolder(one_axis_run)
    units = folder.index(one_axis_run / "raw" / "gyro_acquisition-000.mcap").scan.places
    assert rows == sum(len(folder.rows("gyro_acquisition", unit)) for unit in units)


def test_counts_are_shown_as_a_rate_in_its_own_unit(one_axis_run: Path) -> None:
    plots = RunSeries(one_axis_run)
    assert plots.look()
    assert not plots.look()
    first = plots.data()[0]
    assert (first["source"], first["unit"], first["device"]) == ("gyro_acquisition", "deg/h", True)
    # What the gyro feels of the earth's rate, 0.0625 arcsec a pulse.
    assert np.median(first["columns"]["rate_deg/h"]["v"]) == pytest.approx(9.65, rel=0.05)


def test_a_steady_rate_has_no_spike_whose_outputs_come_in_batches() -> None:
    """At many times the real speed what waits on the line arrives in one go."""
    counted = np.cumsum(np.full(5000, 2.0))
    measured_s = np.arange(5000) * 0.1
    arrived_s = np.ceil(measured_s / 2.3) * 2.3 + (np.arange(5000) % 7) * 1e-3
    series = Thinned(counted=True)
    for rows in np.split(np.arange(5000), 50):
        series.add(np.maximum.accumulate(arrived_s)[rows], counted[rows])
    values = series.data()["v"]
    assert len(values) > 50
    assert max(abs(value - 20.0) for value in values) < 10.0


def test_counts_that_arrived_together_make_one_point_of_the_rate() -> None:
    series = Thinned(counted=True)
    series.add(np.array([1.0, 1.0, 2.0, 2.0, 3.0]), np.array([5.0, 10.0, 15.0, 20.0, 30.0]))
    assert series.data() == {"t": [1.5, 2.5], "v": [10.0, 10.0]}
    assert Thinned(counted=True).data() == {"t": [], "v": []}


def test_a_run_folder_that_is_gone_is_said_and_ends_no_viewer(
    one_axis_run: Path, tmp_path: Path
) -> None:
    folder = tmp_path / one_axis_run.name
    shutil.copytree(one_axis_run, folder)
    watch, seen = RunWatch(folder), dict[str, int]()
    assert [name for name, _ in watch.news(seen)] == ["state", "live", "plots"]
    shutil.rmtree(folder)
    RealClock().sleep(2 * LOOKS_EVERY_S)
    ((name, text),) = watch.news(seen)
    assert name == "unreadable"
    assert "cannot be read" in text
