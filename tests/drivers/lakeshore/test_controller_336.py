"""The cell's heater behind a Lake Shore 336: driver and simulator, over the wire between them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from fixture import EmptyRoom, Fixture, error_of, standing

from drivers.lakeshore.controller_336 import Lakeshore336
from sim_instruments.lakeshore.controller_336 import Lakeshore336 as Controller
from station.roles import Identity

NAME = "cell_heater"
TRUTH = {"full_power": "50 W", "sensor_error": "0 K", "noise": "0 K"}
LIMITS = {"temperature_high": 200.0, "temperature_slew": 20.0}
ROOM_DEGC = 22.5
OPEN = {"fault": "sensor-open"}
BROKEN = {"fault": "heater-broken"}


@contextmanager
def controller(*faults: dict[str, Any], **truth: Any) -> Iterator[Fixture]:
    with standing(
        NAME, Controller, {**TRUTH, **truth}, EmptyRoom(), *faults, serial="LSA1"
    ) as fixture:
        yield fixture


@contextmanager
def opened(
    *faults: dict[str, Any], settings: dict[str, Any] | None = None, **truth: Any
) -> Iterator[tuple[Fixture, Lakeshore336]]:
    with controller(*faults, **truth) as fixture:
        driver = Lakeshore336(fixture.place(LIMITS, **(settings or {})))
        yield fixture, driver
        driver.close()


def settles(fixture: Fixture, driver: Lakeshore336, degC: float, within_s: float) -> None:
    until_s = fixture.clock.now() + within_s
    while abs(driver.temperature_degC() - degC) > 0.05:
        assert fixture.clock.now() < until_s, driver.temperature_degC()
        fixture.clock.sleep(5.0)


# The simulator, by a raw client.


def test_what_the_makers_client_sends_is_answered_in_its_forms() -> None:
    with controller() as fixture, fixture.line() as line:
        assert line.raw_ask(b"*IDN?\n") == b"LSCI,MODEL336,LSA1/#######,2.9\r\n"
        assert line.ask("*ESR?").strip() == "128"
        said = line.ask("KRDG? A;*ESR?").strip().split(";")
        assert (float(said[0]), said[1]) == (pytest.approx(ROOM_DEGC + 273.15, abs=1e-3), "000")
        assert line.ask("CRDG? 0").strip() == "+22.500,+0.000,+0.000,+0.000"
        assert line.ask("RDGST? A;:RDGST? B").strip() == "000;128"
        assert (
            line.ask("OUTMODE? 1;:HTRSET? 1;:INTYPE? A").strip() == "1,1,0;1,2,+1.414,2;2,1,0,1,2"
        )
        assert line.ask("RAMP 1,1,10.5;RAMP? 1;*ESR?").strip() == "1,+10.5;000"
        assert line.ask("TLIMIT A,470.0;TLIMIT? A;*ESR?").strip() == "+0470.0;000"
        assert line.ask("PID 1,60,30,0;PID? 1;HTRST? 1;*ESR?").strip() == "60,30,0;0;000"


@pytest.mark.parametrize(
    ("message", "event"),
    [
        ("NONSENSE 1", 32),
        ("FOO?", 32),
        ("RANGE 1,7", 16),
        ("RANGE 5,1", 16),
        ("RAMP 1,1,200", 16),
        ("SETP 1,warm", 16),
        ("OUTMODE 1,1", 16),
        ("CRDG? E", 16),
    ],
)
def test_what_is_refused_shows_in_the_event_register_once(message: str, event: int) -> None:
    with controller() as fixture, fixture.line() as line:
        line.ask("*ESR?")
        assert int(line.ask(f"{message};*ESR?")) == event
        assert int(line.ask("*ESR?")) == 0


def test_the_loop_holds_its_set_point_and_a_ramp_goes_at_its_rate() -> None:
    with controller() as fixture, fixture.line() as line:
        line.ask("RAMP 1,0,0.1;SETP 1,22.5;RAMP 1,1,10;RANGE 1,3;SETP 1,60;*ESR?")
        fixture.clock.sleep(60.0)
        assert float(line.ask("SETP? 1")) == pytest.approx(32.5, abs=0.2)
        assert line.ask("RAMPST? 1").strip() == "1"
        fixture.clock.sleep(600.0)
        assert line.ask("RAMPST? 1").strip() == "0"
        assert float(line.ask("CRDG? A")) == pytest.approx(60.0, abs=0.02)
        # 8 K/W of the oven: 37.5 K need 4.7 W of 50 W.
        assert float(line.ask("HTR? 1")) == pytest.approx(100 * 37.5 / 8 / 50, abs=0.3)


def test_beyond_its_temperature_limit_it_switches_itself_off() -> None:
    with controller() as fixture, fixture.line() as line:
        line.ask("TLIMIT A,320;RAMP 1,0,0.1;SETP 1,80;RANGE 1,3;*ESR?")
        fixture.clock.sleep(300.0)
        assert line.ask("RANGE? 1").strip() == "0" and float(line.ask("HTR? 1")) == 0.0
        assert not fixture.simulator.energised()


# The driver.


def test_it_says_who_it_is() -> None:
    with opened() as (_, driver):
        assert driver.identify() == Identity("LSCI", "MODEL336", "LSA1", "2.9")


@pytest.mark.parametrize("unit", ["celsius", "kelvin"])
def test_the_cell_is_brought_to_a_temperature_in_whatever_unit_the_loop_is(unit: str) -> None:
    with opened(unit=unit) as (fixture, driver):
        driver.programme_limits()
        driver.switch_on()
        assert driver.set_point_degC() == pytest.approx(ROOM_DEGC, abs=0.01)
        driver.ramp_to(100.0, 20.0)
        assert driver.is_ramping()
        settles(fixture, driver, 100.0, 600.0)
        assert driver.set_point_degC() == pytest.approx(100.0, abs=0.01)
        assert not driver.is_ramping() and 0.0 < driver.power_percent() < 100.0
        assert fixture.newest("temperature") == pytest.approx(100.0, abs=0.1)
        assert fixture.newest("output") == "on"
        assert not driver.read_safety().safe
        driver.make_safe(fixture.clock.now() + 5.0)
        reading = driver.read_safety()
        assert reading.safe and reading.read_back.startswith("range off, output 0.0 %, cell at 1")


def test_its_limit_goes_into_the_controller() -> None:
    with opened() as (fixture, driver):
        driver.programme_limits()
        assert b"TLIMIT A,479;*ESR?\n" in fixture.sent()  # 200 degC, and 5 K


@pytest.mark.parametrize(
    ("set_up", "settings", "says"),
    [
        ("OUTMODE 1,3,1,0", {}, "its mode is 3 on input 1"),
        ("OUTMODE 1,1,2,0", {}, "its mode is 1 on input 2"),
        ("OUTMODE 1,1,1,1", {}, "power up enable"),
        ("INTYPE A,2,1,0,1,3", {}, "neither kelvin nor Celsius"),
        ("OUTMODE 2,1,1,0", {"output": 2, "input": "B"}, "where closed loop is 1 and B is 2"),
    ],
)
def test_a_loop_that_is_set_up_otherwise_is_refused(
    set_up: str, settings: dict[str, Any], says: str
) -> None:
    with controller() as fixture:
        fixture.simulator._line(set_up.encode())
        driver = Lakeshore336(fixture.place(LIMITS, **settings))
        error = error_of(driver.programme_limits)
        assert says in error
        assert not fixture.simulator.energised()
        driver.close()


def test_an_open_sensor_and_a_heater_without_a_load_are_errors_and_the_way_to_rest_is_free() -> (
    None
):
    late = {"at": "60 s", "for": "1 h"}
    for fault, says in ((OPEN, "open sensor"), (BROKEN, "the heater is open")):
        with opened(fault | late) as (fixture, driver):
            driver.switch_on()
            driver.ramp_to(60.0, 10.0)
            fixture.clock.sleep(70.0)
            ask = driver.temperature_degC if fault is OPEN else driver.is_ramping
            assert says in error_of(ask)
            driver.make_safe(fixture.clock.now() + 5.0)
            assert driver.read_safety().safe
        with opened(fault) as (fixture, driver):
            assert says in error_of(driver.switch_on)
            assert not fixture.simulator.energised()


def test_a_heater_that_its_own_limit_switched_off_is_told() -> None:
    with opened() as (fixture, driver):
        driver.switch_on()
        fixture.simulator._line(b"TLIMIT A,300")
        driver.ramp_to(60.0, 20.0)
        fixture.clock.sleep(120.0)
        assert "temperature limit" in error_of(driver.is_ramping)
        assert fixture.newest("output") == "off"


def test_what_it_refuses_is_an_error_of_the_command() -> None:
    with opened() as (fixture, driver):
        fixture.simulator._line(b"NONSENSE")
        driver.programme_limits()  # what another was refused before is not its own
        error = error_of(lambda: driver._line.command("RANGE 1,7"))
        assert "it refused with 016" in error


def test_what_another_was_refused_does_not_keep_it_from_rest() -> None:
    with opened() as (fixture, driver):
        driver.switch_on()
        fixture.simulator._line(b"NONSENSE")
        driver.make_safe(fixture.clock.now() + 5.0)
        assert driver.read_safety().safe
