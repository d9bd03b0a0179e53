"""What a meter owes: bursts that are started, polled and fetched, each reading once and marked."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from station.conformance.fixture import Fixture
from station.errors import InstrumentError
from station.roles.multimeter import DEVICE, place_columns, places_in

LARGEST_V = 1.0
CYCLES = 1.0
READINGS = 5
POLL_S = 0.1
BURST_WITHIN_S = 60.0
AT_ONCE_S = 3.0
"""A few exchanges of at most half a second."""
BEYOND_ANY_RANGE_V = 1e9
OVERLOAD = 1e30
COLDEST_DEGC, HOTTEST_DEGC = -273.15, 1000.0


def burst(fixture: Fixture, meter: Any, readings: int) -> Any:
    """Start a burst and return its block."""
    until_s = fixture.clock.now() + BURST_WITHIN_S
    meter.start(readings)
    while True:
        began_s = fixture.clock.now()
        block = meter.fetch()
        assert fixture.clock.now() - began_s <= AT_ONCE_S, "fetch waits instead of saying None"
        if block is not None:
            return block
        assert fixture.clock.now() < until_s, f"no burst of {readings} after {BURST_WITHIN_S:g} s"
        fixture.clock.sleep(POLL_S)


def check_columns(fixture: Fixture, meter: Any, block: Any, readings: int) -> None:
    """Names, units and lengths agree, and nothing arrives in the future."""
    assert list(block.columns) == list(meter.columns)
    assert len(block) == readings
    for name, values in block.columns.items():
        assert meter.columns[name].strip(), f"{name}: unit and meaning are missing"
        assert values.shape == (readings,), name
        assert values.dtype.kind in "iuf", f"{name} holds no numbers"
        assert np.isfinite(values).all(), name
    assert (block.arrival_time_s <= fixture.clock.now()).all()


def test_the_range_holds_what_was_asked_for(multimeter: Any) -> None:
    """The range that comes back is one that the largest voltage fits into."""
    ranges = [multimeter.configure(volts, CYCLES) for volts in (0.05, LARGEST_V, 10.0)]
    assert ranges == sorted(ranges)
    # Instruments measure a little beyond the name of a range.
    assert all(
        1.5 * range_V >= volts for range_V, volts in zip(ranges, (0.05, 1.0, 10.0), strict=True)
    )


def test_a_voltage_beyond_every_range_is_refused(multimeter: Any) -> None:
    """No range is chosen for what none can hold."""
    with pytest.raises(InstrumentError):
        multimeter.configure(BEYOND_ANY_RANGE_V, CYCLES)


def test_a_burst_of_volts_comes_once_and_whole(fixture: Fixture, multimeter: Any) -> None:
    """Start returns at once; the burst has every reading, and marks those beyond the range."""
    multimeter.configure(LARGEST_V, CYCLES)
    began_s = fixture.clock.now()
    multimeter.start(READINGS)
    assert fixture.clock.now() - began_s <= AT_ONCE_S, "start waits for the burst"
    block = burst(fixture, multimeter, READINGS)
    check_columns(fixture, multimeter, block, READINGS)
    assert block.columns["reading"].tolist() == list(range(READINGS))
    beyond = np.abs(block.columns["voltage_V"]) > OVERLOAD
    assert (block.columns["overload"] == beyond).all()


def test_another_burst_forgets_the_one_before(fixture: Fixture, multimeter: Any) -> None:
    """What was started and never fetched is no part of what is started next."""
    multimeter.configure(LARGEST_V, CYCLES)
    multimeter.start(10 * READINGS)
    assert len(burst(fixture, multimeter, READINGS)) == READINGS
    assert len(burst(fixture, multimeter, 1)) == 1


def test_a_burst_of_degrees_comes_once_and_whole(fixture: Fixture, thermometer: Any) -> None:
    """The device's temperature is one, its resistance belongs to it, and bursts do not mix."""
    for readings in (READINGS, 1):
        block = burst(fixture, thermometer, readings)
        check_columns(fixture, thermometer, block, readings)
        temperature_degC = block.columns["temperature_degC"]
        assert (temperature_degC > COLDEST_DEGC).all()
        assert (temperature_degC < HOTTEST_DEGC).all()
        assert (block.columns["resistance_ohm"] > 0).all()


def test_a_thermometer_with_places_reads_all_of_them(fixture: Fixture, thermometer: Any) -> None:
    """The device is among its places; each has a resistance and a temperature in each reading."""
    places = places_in(thermometer.columns)
    assert DEVICE in places
    if len(places) == 1:
        pytest.skip("it reads one place")
    assert list(thermometer.columns) == [name for place in places for name in place_columns(place)]
    columns = burst(fixture, thermometer, READINGS).columns
    for place in places:
        resistance_ohm, degC = (columns[name] for name in place_columns(place))
        assert (resistance_ohm > 0).all(), place
        assert ((degC > COLDEST_DEGC) & (degC < HOTTEST_DEGC)).all(), place
