"""What both models do in the role of the multimeter, over their real lines."""

from __future__ import annotations

from typing import Any

import pytest
from keysight_fixture import burst, meter

from station.errors import InstrumentError

both = pytest.mark.parametrize("model", ["34465A", "DMM6500"])


@pytest.mark.parametrize(
    ("model", "volts"),
    [
        ("34465A", (0.05, 0.12, 0.13, 1.2, -11.9, 13, 1000)),  # with its over-range
        ("DMM6500", (0.05, 0.1, 0.11, 1.0, -9.9, 11, 1000)),
    ],
)
def test_it_takes_the_next_range_up(model: str, volts: tuple[float, ...]) -> None:
    with meter(model) as (_, driver):
        ranges = [0.1, 0.1, 1.0, 1.0, 10.0, 100.0, 1000.0]
        assert [driver.configure(volt, 1) for volt in volts] == ranges


@pytest.mark.parametrize(
    ("model", "largest_V", "nplc", "states"),
    [
        ("34465A", 1001.0, 10, "its highest one ends at 1000 V; lower the largest voltage"),
        ("DMM6500", 1001.0, 10, "its highest one ends at 1000 V; lower the largest voltage"),
        ("34465A", 1.0, 3, "it can do 0.001, 0.002, 0.006, 0.02, 0.06, 0.2, 1, 10, 100; write one"),
        ("DMM6500", 1.0, 100, r"it can do 0\.0005, 0\.001, .* 10, 12; write one of these"),
    ],
)
def test_what_the_meter_cannot_do_is_refused(
    model: str, largest_V: float, nplc: float, states: str
) -> None:
    with meter(model) as (_, driver), pytest.raises(InstrumentError, match=states):
        driver.configure(largest_V, nplc)


@both
def test_a_burst_is_started_polled_and_fetched(model: str) -> None:
    with meter(model) as (fixture, driver):
        assert driver.configure(0.8, 10) == 1.0
        before_s = fixture.clock.now()
        driver.start(5)
        assert driver.fetch() is None
        assert fixture.clock.now() - before_s < 0.5
        block = burst(fixture, driver, 5)
        assert list(block.columns) == list(driver.columns)
        assert block.columns["reading"].tolist() == [0, 1, 2, 3, 4]
        assert block.columns["voltage_V"].tolist() == [0.5] * 5
        assert not block.columns["overload"].any()
        assert fixture.newest("voltage") == 0.5
        with pytest.raises(InstrumentError, match="none was begun since the last one"):
            driver.fetch()


@both
@pytest.mark.parametrize(("volts", "reading"), [(1.3, 9.9e37), (-1.3, -9.9e37)])
def test_overloads_are_kept_and_marked_and_the_error_names_the_next_range(
    model: str, volts: float, reading: float
) -> None:
    with meter(model, volts=volts) as (fixture, driver):
        driver.configure(1.0, 1)
        block = burst(fixture, driver, 2)
        assert block.columns["voltage_V"].tolist() == [reading] * 2
        assert block.columns["overload"].tolist() == [1, 1]
        assert fixture.newest("voltage") is None
        states = r"range of 1 V: .9\.9E\+37, an overload: beyond 1(\.2)? V; .* higher range, 10 V"
        with pytest.raises(InstrumentError, match=states):
            driver.read_quantity("voltage")


@both
def test_an_interlock_reads_between_bursts_and_does_not_disturb_one(model: str) -> None:
    with meter(model) as (fixture, driver):
        assert driver.read_quantity("voltage") is None
        driver.configure(1.0, 10)
        assert driver.read_quantity("voltage") == 0.5
        driver.start(5)
        assert driver.read_quantity("voltage") is None
        fixture.clock.sleep(1.0)
        assert driver.read_quantity("voltage") == 0.5
        fixture.clock.sleep(5.0)
        assert len(driver.fetch()) == 5


@both
def test_other_mains_than_the_bench_file_states_are_refused(model: str) -> None:
    states = "it measured 50 Hz, the bench file states 60 Hz"
    with (
        meter(model, line_frequency="60 Hz") as (_, driver),
        pytest.raises(InstrumentError, match=states),
    ):
        driver.configure(1.0, 10)


@both
def test_a_burst_that_somebody_else_ended_is_reported(model: str) -> None:
    with meter(model) as (fixture, driver):
        driver.configure(1.0, 10)
        driver.start(10)
        fixture.clock.sleep(1.0)
        fixture.at_its_front_panel("ABOR")
        with pytest.raises(InstrumentError, match="it ended with 2 in its memory"):
            driver.fetch()


LOST = [({"fault": "no-reply"}, "no answer"), ({"fault": "nan", "text": "9.91E+37"}, "9.91E")]


@pytest.mark.parametrize(("model", "command"), [("34465A", "FETC"), ("DMM6500", "TRAC:DATA")])
@pytest.mark.parametrize(("fault", "states"), LOST)
def test_a_burst_whose_answer_was_lost_is_still_in_its_memory(
    model: str, command: str, fault: Any, states: str
) -> None:
    with meter(model, {**fault, "command": command}) as (fixture, driver):
        driver.configure(1.0, 1)
        driver.start(3)
        fixture.clock.sleep(1.0)
        with pytest.raises(InstrumentError, match=states):
            driver.fetch()
        assert driver.fetch().columns["voltage_V"].tolist() == [0.5] * 3
