"""What a run shows of its instruments while it runs: set-points, read-backs, interlocks."""

from __future__ import annotations

import math
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from station import registry
from station.clock import VirtualClock, boot_seconds
from station.control import run_reader
from station.control.run_reader import LiveValues
from station.errors import StationError
from station.files.lookup import BENCHES, find
from station.instruments.bench import read_bench
from station.runner.live import LiveBoard
from station.safety.interlocks.monitor import InterlockLook
from station.safety.readings import Readings
from station.units import shown


@pytest.fixture
def board() -> LiveBoard:
    clock = VirtualClock()
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    return LiveBoard(clock, Readings(clock), bench)


def test_a_set_point_stands_beside_what_its_instrument_reads_back(board: LiveBoard) -> None:
    board.commanded("coil_supply.x", "1 A, at rest", {"current_A": 1.0})
    board.commanded("coil_supply.x", "0.5 mT at 2 Hz", {"current_A": 0.5, "field_mT": 0.15})
    board._readings.publish("coil_supply.x", "current", 0.49987, "A")
    board._readings.publish("coil_supply.x", "output", "on")
    board._readings.publish("gaussmeter", "field", 1e-3, "T")
    board.interlocks = lambda: [InterlockLook("chain", "clear", "the chain is closed")]
    data = board.data()
    supply, gaussmeter = data["instruments"]
    assert (supply["instrument"], supply["set"]) == ("coil_supply.x", "0.5 mT at 2 Hz")
    current, output = supply["read"]
    assert current == {
        "quantity": "current",
        "text": "500 mA",
        "age_s": 0.0,
        "unit": "A",
        "value": 0.49987,
        "set": 0.5,
        "limit": 8.0,  # of the bench file; the interlock trips beyond it
    }
    assert output == {"quantity": "output", "text": "on", "age_s": 0.0}
    # The gaussmeter has no limit of its own: that of its interlock.
    assert gaussmeter["read"][0]["limit"] == 60.0
    assert (gaussmeter["read"][0]["value"], gaussmeter["read"][0]["unit"]) == (1.0, "mT")
    assert data["interlocks"] == [
        {"name": "chain", "state": "clear", "said": "the chain is closed"}
    ]


def test_the_newest_row_of_a_source_is_shown_with_its_units(board: LiveBoard) -> None:
    columns = ["sequence", "gyro_x_deg_per_s", "temperature_degC", "arrival_time_s"]
    rows = np.array(
        [(1, 0.5, 20.0, 0.1), (2, 1.25, np.nan, 0.2)], dtype=[(one, float) for one in columns]
    )
    board.came("imu", rows)
    (one,) = board.data()["instruments"]
    shown = [(each["quantity"], each["text"]) for each in one["read"]]
    assert shown == [("gyro_x", "1.25 deg/s")]


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (-0.0005537, "A", "-0.554 mA"),
        (0.49987, "A", "500 mA"),
        (5.00012, "A", "5 A"),
        (0.00099832, "T", "0.9983 mT"),
        (2.2e-7, "V", "0.22 uV"),
        (0.0, "A", "0 A"),
        (123.4567, "deg", "123.5 deg"),
        (2.5e-5, "deg/s", "2.5e-05 deg/s"),
        (math.inf, "mT", "inf mT"),
    ],
)
def test_a_value_is_shown_as_people_read_it(value: float, unit: str, text: str) -> None:
    assert shown(value, unit) == text


def test_what_a_run_no_longer_answers_grows_old(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    answers = [{"instruments": [{"instrument": "imu"}], "interlocks": []}]

    def ask(folder: Path, request: str) -> dict[str, object]:
        if folder != tmp_path:  # somebody else still looks at a run of an earlier test
            raise StationError("gone")
        assert request == "live"
        if answers:
            return answers.pop()
        raise StationError("gone")

    for name, value in {"ask": ask, "EVERY_S": 0.01, "AGAIN_S": 0.01, "OLD_AFTER_S": 0.2}.items():
        monkeypatch.setattr(run_reader, name, value)
    values = LiveValues(tmp_path)
    until_s = boot_seconds() + 20.0
    while (seen := values.newest()) is None and boot_seconds() < until_s:
        Event().wait(0.01)
    assert seen is not None
    assert seen["instruments"] == [{"instrument": "imu"}]
    while values.newest() is not None and boot_seconds() < until_s:
        Event().wait(0.01)
    assert values.newest() is None
