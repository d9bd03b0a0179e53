"""The driver of a Watlow F4 with the controllers of several makers' chambers."""

from __future__ import annotations

from typing import Any

import pytest
from variants import variant
from watlow_fixture import opened

from station.errors import InstrumentError

CHAMBER = ("thermal_chamber", "fog-scale-factor-temperature", "sim-alternate")
OF_CHAMBER, OF_F4P = "registers of a chamber F4", "registers of an F4P"


@pytest.mark.parametrize("active", ["low", "high"])
def test_a_door_is_closed_where_its_input_has_the_level_at_which_it_is_active(active: str) -> None:
    fault = {"fault": "door-open", "at": "10 s"}
    wired: dict[str, Any] = {"door_input": 2, "door_active": active}
    with opened("f4", fault, settings={"door": 2}, **wired) as (fixture, driver):
        assert driver.read_quantity("door") == "closed"
        assert driver._line.read(213) == [int(active == "high")]
        fixture.clock.sleep_until(20.0)
        assert driver.read_quantity("door") == "open"
        assert driver.open_contacts() == ("door",)


@pytest.mark.parametrize("active", ["low", "high"])
def test_the_active_level_is_noted(active: str) -> None:
    with variant(*CHAMBER, door_active=active) as here:
        assert here.driver().read_quantity("door") == "closed"
        assert here.met() == [f"the door's input is active at {active} level"]


@pytest.mark.parametrize(("registers", "met"), [("chamber", OF_CHAMBER), ("f4p", OF_F4P)])
def test_both_maps_are_driven_and_noted(registers: str, met: str) -> None:
    with variant(*CHAMBER, map=registers) as here:
        chamber = here.driver()
        chamber.switch_on()
        chamber.set_temperature(30.0)
        here.clock.sleep(5.0)
        assert chamber.is_ramping()
        chamber.make_safe(here.clock.now() + 10.0)
        assert chamber.read_safety().safe
        assert here.met() == [met]


def test_an_f4p_in_manual_control_is_an_error_and_has_no_profile_to_terminate() -> None:
    with variant(*CHAMBER, map="f4p", manual=True) as here:
        chamber = here.driver()
        with pytest.raises(InstrumentError, match="it is in manual control"):
            chamber.switch_on()
        chamber.make_safe(here.clock.now() + 10.0)
        assert chamber.read_safety().safe


def test_cooling_is_negative_in_the_controller_and_its_magnitude_is_what_cools() -> None:
    with opened("f4") as (fixture, driver):
        driver.switch_on()
        driver._jump(-40.0)
        fixture.clock.sleep(60.0)
        (cools,) = driver._line.read(107)
        assert cools & 0x8000 and cools - 0x10000 < -1000
        assert driver._line.read(103) == [0]
        _, percent = driver._output(driver._line)
        assert percent == pytest.approx((cools - 0x10000) / 100, abs=1.0)


@pytest.mark.parametrize("wrong", [{"map": "f5"}, {"door_active": "up"}])
def test_a_form_that_is_none_is_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(Exception, match=f"{next(iter(wrong))}: write"), opened("f4", **wrong):
        raise AssertionError("it is served")
