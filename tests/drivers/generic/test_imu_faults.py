"""What becomes of a nine-axis sensor's outputs when its line, or it itself, goes wrong."""

from __future__ import annotations

import numpy as np
import pytest
from fixture import recorded, said_of_a_line_that_is_gone
from imu_fixture import KINDS, NAME, imu

from station.errors import InstrumentError, InstrumentTimeout

both = pytest.mark.parametrize("kind", KINDS)


@both
@pytest.mark.parametrize("seconds", [5, 20])
def test_a_silent_sensor_leaves_a_gap_in_the_counter(kind: str, seconds: int) -> None:
    """Of seven bits, also a gap that is longer than a round of them."""
    fault = {"fault": "silent", "at": "10.05 s", "for": f"{seconds} s"}
    with imu(kind, fault) as (fixture, driver):
        driver.start(10.0)
        steps = np.diff(recorded(fixture, driver, 40.0).columns["counter"].astype(int))
        assert sorted(set(steps.tolist())) == [1, 10 * seconds + 1]


@both
def test_a_silence_is_told_to_whoever_watches_the_temperature(kind: str) -> None:
    with imu(kind, {"fault": "silent", "at": "10 s"}) as (fixture, driver):
        driver.start(10.0)
        for _ in range(8):  # the temperature comes with every fourth output
            recorded(fixture, driver, 1.05)
        assert driver.read_quantity("temperature") is not None
        recorded(fixture, driver, 10.0)
        with pytest.raises(InstrumentError, match="no output came for"):
            driver.read_quantity("temperature")


LOST = [("can", "lost-frame", name) for name in ("0D0", "0D1", "0D2", "0D3")]
LOST += [
    ("kvh", kind, "output")
    for kind in ("lost-frame", "no-reply", "garbled", "wrong-crc", "partial", "previous-reply")
]


@pytest.mark.parametrize(("kind", "fault", "message"), LOST)
def test_a_lost_output_is_a_gap_and_no_more(kind: str, fault: str, message: str) -> None:
    rate_Hz = 100.0 if kind == "kvh" else 10.0  # ten outputs in a batch, or each alone
    entry = {"fault": fault, "command": message, "nth": 50, "count": 1}
    with imu(kind, entry) as (fixture, driver):
        driver.identify()
        driver.start(rate_Hz)
        counter = recorded(fixture, driver, 100.0 / rate_Hz).columns["counter"].astype(int)
        assert sorted(set(np.diff(counter).tolist())) == [1, 2]
        lost = set(range(1, int(counter[-1]) + 1)) - set(counter.tolist())
        assert len(lost) == 1


def test_an_output_that_comes_late_is_left_out() -> None:
    entry = {"fault": "late", "command": "output", "nth": 50, "count": 1, "delay": "1.05 s"}
    with imu("kvh", entry) as (fixture, driver):
        driver.start(10.0)
        counter = recorded(fixture, driver, 20.0).columns["counter"].astype(int)
        assert sorted(set(np.diff(counter).tolist())) == [1, 2]


@both
def test_an_overloaded_gyro_is_at_its_range_and_not_valid(kind: str) -> None:
    with imu(kind, {"fault": "overload", "at": "5 s", "for": "5 s"}) as (fixture, driver):
        driver.start(10.0)
        columns = recorded(fixture, driver, 15.0).columns
        bad = columns["status"] == 1
        assert bad.sum() == pytest.approx(50, abs=1)
        assert columns["gyro_x_deg_per_s"][bad] == pytest.approx(400.0)
        assert not columns["status"][~bad].any()


@both
def test_a_gyro_that_failed_its_test_is_told(kind: str) -> None:
    with imu(kind, {"fault": "gyro-fails", "at": "5 s"}) as (fixture, driver):
        driver.start(10.0)
        assert recorded(fixture, driver, 10.0).columns["status"][-1] == 1
        (fault, *_) = driver.status().faults
        assert "gyro" in fault or "built-in test, byte 1, bit 0" in fault


@both
def test_a_frozen_sensor_repeats_its_last_values(kind: str) -> None:
    with imu(kind, {"fault": "frozen", "at": "5 s"}) as (fixture, driver):
        driver.start(10.0)
        columns = recorded(fixture, driver, 10.0).columns
        assert np.ptp(columns["gyro_x_deg_per_s"][:45]) > 0.003
        assert np.ptp(columns["gyro_x_deg_per_s"][-45:]) == 0.0
        assert (np.diff(columns["counter"].astype(int)) == 1).all()


@both
def test_an_overheated_sensor_reads_warmer(kind: str) -> None:
    with imu(kind, {"fault": "overheating", "at": "5 s", "rise": "60 K"}) as (fixture, driver):
        driver.start(10.0)
        recorded(fixture, driver, 10.0)
        assert driver.read_quantity("temperature") == pytest.approx(80.1, abs=0.1)


@pytest.mark.parametrize(
    ("kind", "message", "said"),
    [
        ("kvh", "command =dr", "sent =DR,10: no answer came within 0.5 s; check"),
        ("can", "0C0", "sent the command start: no acknowledgement came within 0.5 s; check"),
    ],
)
@pytest.mark.parametrize("fault", ["lost-frame", "no-reply"])
def test_a_lost_answer_is_told_clearly(kind: str, message: str, said: str, fault: str) -> None:
    entry = {"fault": fault, "command": message, "nth": 2 if kind == "can" else 1, "count": 1}
    with imu(kind, entry) as (fixture, driver):
        with pytest.raises(InstrumentTimeout) as raised:
            driver.start(10.0)
        assert str(raised.value).startswith(f"{NAME}: {said}")
        driver.start(10.0)
        assert len(recorded(fixture, driver, 2.0))


def test_a_late_answer_is_not_taken_for_the_next() -> None:
    entry = {"fault": "late", "command": "command ?is", "count": 1, "delay": "0.8 s"}
    with imu("kvh", entry) as (fixture, driver):
        with pytest.raises(InstrumentTimeout):
            driver.identify()
        fixture.clock.sleep(1.0)
        assert driver.identify().serial == "0"


@both
def test_a_line_that_ends_is_told_clearly(kind: str) -> None:
    with imu(kind, {"fault": "port-gone", "at": "5 s"}) as (fixture, driver):
        driver.start(10.0)
        fixture.clock.sleep(4.0)
        assert len(driver.drain())
        fixture.clock.sleep(3.0)
        said = said_of_a_line_that_is_gone(driver)
        assert said.startswith(NAME) and "broke (" in said
