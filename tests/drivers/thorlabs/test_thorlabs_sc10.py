"""The pump light's shutter: its driver and its simulator, over the wire between them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from fixture import EmptyRoom, Fixture, error_of, standing
from sim_bench import Line
from trigger_fixture import Room

from drivers.thorlabs.sc10 import ThorlabsSc10
from sim_instruments.thorlabs.sc10 import ThorlabsSc10 as Controller

NAME = "pump_laser"
TRUTH = {"opening_time": "12 ms", "closing_time": "9 ms", "gate_inverter": True}


@contextmanager
def controller(*faults: dict[str, Any], room: Any = None, **truth: Any) -> Iterator[Fixture]:
    lit = room or Room(lambda after_s: after_s)
    with standing(NAME, Controller, {**TRUTH, **truth}, lit, *faults) as fixture:
        yield fixture


@contextmanager
def opened(
    *faults: dict[str, Any], room: Any = None, settings: dict[str, Any] | None = None, **truth: Any
) -> Iterator[tuple[Fixture, ThorlabsSc10]]:
    with controller(*faults, room=room, **truth) as fixture:
        driver = ThorlabsSc10(fixture.place(**(settings or {})))
        yield fixture, driver
        driver.close()


def ask(line: Line, text: str) -> str:
    """Send a command and return the answer without its prompt."""
    answer = line.raw_ask(text.encode("ascii") + b"\r").decode("ascii")
    assert answer.endswith("> ")
    return answer.removesuffix("> ")


def dark_at(fixture: Fixture) -> bool:
    """Return whether the light is blocked now, as the world knows it."""
    past = [on for time_s, on in fixture.room.light if time_s <= fixture.clock.now()]
    return not (past and past[-1])


# The simulator, by a raw client.


def test_an_answer_is_an_echo_a_value_and_a_prompt() -> None:
    with controller() as fixture, fixture.line() as line:
        assert ask(line, "id?") == "id?\rTHORLABS SC10 VERSION 1.07\r"
        assert ask(line, "mode=5") == "mode=5\r"
        assert ask(line, "mode?") == "mode?\r5\r"
        assert ask(line, "mode=6") == "mode=6\rCommand error CMD_ARG_INVALID\r"
        assert ask(line, "open=x") == "open=x\rCommand error CMD_ARG_INVALID\r"
        assert ask(line, "ENS") == "ENS\rCommand error CMD_NOT_DEFINED\r"
        assert ask(line, "") == "\r"


def test_enable_toggles_and_the_blade_takes_its_time() -> None:
    with controller() as fixture, fixture.line() as line:
        assert ask(line, "ens") == "ens\r"
        assert ask(line, "ens?") == "ens?\r1\r"
        assert ask(line, "closed?") == "closed?\r1\r"
        fixture.clock.sleep(0.012)
        assert ask(line, "closed?") == "closed?\r0\r"
        ask(line, "ens")
        assert ask(line, "closed?") == "closed?\r0\r"
        fixture.clock.sleep(0.009)
        assert ask(line, "closed?") == "closed?\r1\r"
        assert fixture.room.light == [(pytest.approx(0.012), True), (pytest.approx(0.021), False)]


def test_a_blade_that_is_turned_on_its_way_comes_back_later() -> None:
    with controller() as fixture, fixture.line() as line:
        ask(line, "ens")
        fixture.clock.sleep(0.005)
        ask(line, "ens")
        assert fixture.room.light == [(pytest.approx(0.012), True), (pytest.approx(0.021), False)]


@pytest.mark.parametrize("inverter", [True, False])
def test_in_the_gate_mode_the_light_follows_the_trigger(inverter: bool) -> None:
    with controller(gate_inverter=inverter) as fixture, fixture.line() as line:
        ask(line, "mode=5")
        ask(line, "ens")
        fixture.clock.sleep(0.1)
        assert dark_at(fixture) is not inverter
        fixture.room.trigger.rise(fixture.clock.now())
        fixture.clock.sleep(0.02)
        assert dark_at(fixture) is inverter
        fixture.room.trigger.fall(fixture.clock.now())
        fixture.clock.sleep(0.02)
        assert dark_at(fixture) is not inverter


# The driver.


def test_an_act_is_done_when_it_returns() -> None:
    with opened() as (fixture, driver):
        assert not driver.is_open()
        driver.open_shutter()
        assert not dark_at(fixture)
        assert fixture.newest("output") == "on"
        driver.close_shutter()
        assert dark_at(fixture)
        assert fixture.newest("output") == "off"
        assert fixture.clock.now() < 0.1


@pytest.mark.parametrize("enabled", [True, False])
def test_what_somebody_left_enabled_is_not_toggled_the_wrong_way(enabled: bool) -> None:
    for act, is_open in (("open_shutter", True), ("close_shutter", False)):
        with controller() as fixture:
            with fixture.line() as line:
                if enabled:
                    ask(line, "ens")
                    fixture.clock.sleep(0.1)
            driver = ThorlabsSc10(fixture.place())
            getattr(driver, act)()
            assert driver.is_open() is is_open
            driver.close()


def test_the_light_goes_off_at_the_trigger_and_comes_back_after_it() -> None:
    with opened(settings={"trigger_to_dark": "9 ms"}) as (fixture, driver):
        driver.follow_trigger()
        assert driver.is_open()
        began_s = fixture.clock.now()
        fixture.room.trigger.rise(began_s)
        fixture.clock.sleep(0.05)
        assert not driver.is_open()
        assert fixture.room.light[-1] == (pytest.approx(began_s + driver.trigger_to_dark_s), False)
        fixture.room.trigger.fall(fixture.clock.now())
        fixture.clock.sleep(0.05)
        assert driver.is_open()


def test_a_gate_without_an_inverter_is_noticed() -> None:
    with opened(gate_inverter=False) as (_, driver):
        text = error_of(driver.follow_trigger)
        assert "its sensor still reads closed after 0.1 s, and the controller is enabled" in text
        assert "put an inverter between the trigger and the gate" in text


def test_a_delay_that_nobody_measured_is_unknown() -> None:
    with opened() as (_, driver):
        assert driver.trigger_to_dark_s is None


def test_it_works_in_a_world_without_light_and_trigger() -> None:
    with opened(room=EmptyRoom()) as (_, driver):
        driver.follow_trigger()
        assert driver.is_open()
        driver.close_shutter()
        assert not driver.is_open()


def test_a_shutter_that_does_not_close_is_an_error_that_says_so() -> None:
    with opened({"fault": "stuck-open", "at": "1 s", "for": "10 s"}) as (fixture, driver):
        driver.follow_trigger()
        fixture.clock.sleep_until(2.0)
        text = error_of(lambda: driver.make_safe(fixture.clock.now() + 5.0))
        assert text.startswith("pump_laser: close the shutter: its sensor still reads open")
        assert "THE LIGHT STILL PASSES: switch the pump laser off by hand" in text
        reading = driver.read_safety()
        assert not reading.safe
        assert reading.read_back.startswith("shutter OPEN, disabled")
        assert driver.read_quantity("output") == "on"
        fixture.clock.sleep_until(12.0)
        driver.make_safe(fixture.clock.now() + 5.0)
        assert driver.read_safety().safe


def test_an_open_interlock_closes_the_shutter_and_is_named() -> None:
    with opened({"fault": "interlock-open", "at": "1 s", "for": "10 s"}) as (fixture, driver):
        driver.open_shutter()
        fixture.clock.sleep_until(2.0)
        driver.is_open()
        fixture.clock.sleep(0.1)
        assert not driver.is_open()
        for act in (driver.open_shutter, driver.follow_trigger):
            assert "its interlock is open (interlock? reads 1); make sure" in error_of(act)
        driver.make_safe(fixture.clock.now() + 5.0)
        assert driver.read_safety().safe
        fixture.clock.sleep_until(12.0)
        driver.open_shutter()
        assert driver.is_open()


@pytest.mark.parametrize("fault", ["no-reply", "lost-command", "garbled", "dropped-connection"])
@pytest.mark.parametrize("command", ["ens", "ens?", "closed?", "mode=1"])
def test_one_lost_exchange_does_not_leave_the_light_on(fault: str, command: str) -> None:
    with opened({"fault": fault, "command": command, "at": "1 s"}) as (fixture, driver):
        driver.follow_trigger()
        fixture.clock.sleep_until(1.0)
        driver.make_safe(fixture.clock.now() + 5.0)
        assert driver.read_safety().safe
        assert dark_at(fixture)
        assert fixture.clock.now() < 3.0


def test_an_interlock_can_ask_whether_the_light_passes() -> None:
    with opened() as (_, driver):
        assert driver.read_quantity("output") == "off"
        driver.open_shutter()
        assert driver.read_quantity("output") == "on"
