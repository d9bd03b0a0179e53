"""The supply of the device under test behind a digital output of an F4T."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from fixture import error_of
from watlow_fixture import Fixture, Room, controller

from drivers.watlow.output_power import WatlowOutputPower


@contextmanager
def power(*faults: Any, room: Any = None, **settings: Any) -> Iterator[tuple[Fixture, Any]]:
    with controller("f4t", *faults, room=room) as fixture:
        driver = WatlowOutputPower(fixture.place(**{"output": "2.1", **settings}))
        yield fixture, driver
        driver.close()


def test_the_output_switches_the_device_of_the_world_and_says_so() -> None:
    with power() as (fixture, driver):
        driver.switch_on()
        assert fixture.room.acts == ["dut-power-on"]
        assert driver.read_quantity("output") == "on"
        driver.switch_off()
        assert fixture.room.acts == ["dut-power-on", "dut-power-off"]
        assert fixture.newest("output") == "off"


def test_a_world_with_a_supply_line_gets_the_switch_with_its_time() -> None:
    room: Any = Room()
    switched: list[tuple[float, bool]] = []
    room.power = lambda time_s, on: switched.append((time_s, on))
    with power(room=room) as (fixture, driver):
        fixture.clock.sleep(5.0)
        driver.switch_on()
        assert switched == [(5.0, True)]
        assert room.acts == []


def test_an_event_of_the_controller_may_switch_the_output() -> None:
    with power(output="2.3", event=1) as (_, driver):
        driver.switch_on()
        assert driver.read_quantity("output") == "on"
        assert driver._registers.line.read(16594) == [63]
    with power(event=1) as (_, driver):
        text = error_of(driver.switch_on)
        assert "switch output 2.1 on: its state still reads 62 after 1 s" in text
        assert "settings.event" in text


def test_the_output_of_the_chambers_own_controller_is_switched_over_its_line() -> None:
    with controller("f4t") as fixture:
        chamber = fixture.driver()
        place = replace(fixture.place(output="2.1"), shared={"thermal_chamber": chamber})
        driver = WatlowOutputPower(place)
        driver.switch_on()
        driver.close()
        assert fixture.room.acts == ["dut-power-on"]
        assert chamber.identify() == driver.identify(), "the chamber's line is still open"
        assert [data for direction, data in fixture.heard if direction == "-"] == [b"opened"]
        chamber.close()
    with controller("f4") as fixture:
        place = replace(fixture.place(output="2.1"), shared={"thermal_chamber": fixture.driver()})
        assert "thermal_chamber is no Watlow F4T" in error_of(lambda: WatlowOutputPower(place))


def test_an_output_that_is_not_there_is_told_in_words() -> None:
    with power(output="3.1") as (_, driver):
        text = error_of(driver.switch_on)
        assert "use output 3.1: the controller has no such output (exception 4)" in text
        assert "correct settings.output" in text
    with power(output="2.2") as (_, driver):
        assert "it does not take this value" in error_of(driver.switch_on)
