"""What the drivers publish, and what they say when an interlock asks."""

from __future__ import annotations

import pytest
from interlock_helpers import BOARD, GAUSSMETER, SUPPLY, bench_with, watched
from sim_bench import Line

from station.errors import InputError


def test_a_supply_publishes_what_it_measures_and_whether_it_is_on() -> None:
    with watched(bench_with([]), SUPPLY) as fixture:
        supply, readings = fixture.instruments[SUPPLY], fixture.readings
        assert supply.read_quantity("output") == "off"
        fixture.energise(2.0)
        assert readings.newest(SUPPLY, "output").value == "on"
        fixture.clock.sleep(2.5)
        current_A = supply.current_A()
        assert abs(current_A) == pytest.approx(2.0, abs=0.1)
        assert readings.newest(SUPPLY, "current").value == current_A
        voltage_V = supply.read_quantity("voltage")
        assert voltage_V == pytest.approx(1.2 * current_A, abs=0.1)
        assert readings.newest(SUPPLY, "voltage").unit == "V"
        supply.stop()
        assert readings.newest(SUPPLY, "output").value == "off"
        assert abs(readings.newest(SUPPLY, "current").value) < 0.02
        with pytest.raises(InputError, match="does not read 'temperature'"):
            supply.read_quantity("temperature")


def test_a_gaussmeter_publishes_the_newest_field_it_recorded() -> None:
    with watched(bench_with([]), SUPPLY, GAUSSMETER) as fixture:
        meter = fixture.instruments[GAUSSMETER]
        meter.start(1.5)
        fixture.energise(3.0)
        fixture.clock.sleep(5.0)
        columns = meter.drain().columns
        last_mT = 1e3 * sum(columns[name][-1] ** 2 for name in ("x_T", "y_T", "z_T")) ** 0.5
        newest = fixture.readings.newest(GAUSSMETER, "field")
        assert (newest.value, newest.unit) == (pytest.approx(last_mT), "mT")


def test_a_field_is_in_millitesla_however_somebody_left_the_gaussmeter() -> None:
    with watched(bench_with([]), GAUSSMETER) as fixture:
        with Line(fixture.simulation, GAUSSMETER, fixture.clock) as hand:
            assert hand.ask("UNIT:FIELD GAUSS;:SENS:MODE AC;:SYST:ERR:ALL?") == '0,"No error"'
        field_mT = fixture.instruments[GAUSSMETER].read_quantity("field")
    assert field_mT == pytest.approx(0.05, abs=0.01)  # the ambient field


def test_a_board_publishes_the_gyros_temperature_and_asking_takes_no_sample() -> None:
    with watched(bench_with([]), BOARD) as fixture:
        board = fixture.instruments[BOARD]
        assert board.read_quantity("temperature") is None
        board.start(0.1, 1)
        assert board.read_quantity("temperature") is None
        fixture.clock.sleep(10.0)
        assert board.read_quantity("temperature") == pytest.approx(22.0, abs=1.0)
        block = board.drain()
        assert len(block) == pytest.approx(100, abs=2)
        newest = fixture.readings.newest(BOARD, "temperature")
        assert newest.value == block.columns["temperature_degC"][-1]
        assert board.read_quantity("temperature") == newest.value
        board.stop()
        assert board.read_quantity("temperature") is None


def test_a_supply_that_drives_too_much_comes_to_rest_without_driving_more() -> None:
    overdrive = {"instrument": SUPPLY, "fault": "overdrive", "at": "5 s", "factor": "2 1"}
    with watched(bench_with([], [overdrive]), SUPPLY) as fixture:
        supply = fixture.instruments[SUPPLY]
        supply.programme_limits()
        supply.switch_on()
        supply.ramp_to(3.0)
        fixture.clock.sleep_until(6.0)
        assert supply.current_A() == pytest.approx(6.0, abs=0.1)
        supply.make_safe(fixture.clock.now() + 30.0)
        assert supply.read_safety().safe
        coil = fixture.simulation.simulation_report()["coils"]["x"]
    assert coil["largest_current_A"] < 6.1
