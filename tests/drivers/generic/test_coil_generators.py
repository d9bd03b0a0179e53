"""What both models of signal generator do at coils, over real sockets on virtual time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from generator_fixture import generator

from station.errors import InstrumentError

both = pytest.mark.parametrize("model", ["33522B", "DG822"])


@both
def test_a_voltage_that_is_held_is_at_the_coil_and_is_switched_off(model: str) -> None:
    with generator(model) as (fixture, driver):
        driver.hold(1, 1.25)
        driver.hold(2, -0.5)
        assert fixture.volts("x") + fixture.volts("y") == [1.25, -0.5]
        assert fixture.newest("output") == "on"
        assert driver.read_safety().read_back == "channel 1 on, channel 2 on"
        fixture.heard.clear()
        driver.hold(1, -8.9)
        assert not [data for data in fixture.sent() if b"OUTP1 O" in data], "there is a gap"
        assert fixture.volts("x") + fixture.volts("y") == [-8.9, -0.5]
        driver.switch_off(1)
        assert fixture.volts("x") + fixture.volts("y") == [0.0, -0.5]
        assert driver.read_quantity("output") == "on"
        driver.make_safe(fixture.clock.now() + 5.0)
        assert fixture.volts("x") + fixture.volts("y") == [0.0, 0.0]
        assert driver.read_safety().read_back == "channel 1 off, channel 2 off"
        assert fixture.newest("output") == "off"


@both
@pytest.mark.parametrize("step_V", [2.5, -2.5])
def test_a_step_begins_at_the_trigger_after_its_delay_and_ends_by_itself(
    model: str, step_V: float
) -> None:
    with generator(model) as (fixture, driver):
        driver.hold(1, 0.3)
        driver.hold(2, -0.2)
        driver.prepare_step(1, step_V, 0.1)
        driver.prepare_step(2, -step_V, 0.1, 0.5)
        assert fixture.volts("x") + fixture.volts("y") == pytest.approx([0.3, -0.2])
        fixture.clock.sleep(1.0)
        fixture.rise()
        high, low = 0.3 + step_V, -0.2 - step_V
        around = fixture.volts("x", 0.0, 1e-6, 0.0999, 0.1001, 10.0)
        assert around == pytest.approx([0.3, high, high, 0.3, 0.3])
        around = fixture.volts("y", 0.49, 0.51, 0.59, 0.61)
        assert around == pytest.approx([-0.2, low, low, -0.2])


@both
def test_a_step_of_several_cycles_is_a_square_wave_from_the_trigger_on(model: str) -> None:
    with generator(model) as (fixture, driver):
        driver.hold(1, 0.3)
        driver.prepare_step(1, 0.04, 0.0625, cycles=3)
        fixture.clock.sleep(1.0)
        fixture.rise()
        middles = [0.0625 * (k + 0.5) for k in range(8)]
        high, low = 0.34, 0.3
        expected = [high, low, high, low, high, low, low, low]
        assert fixture.volts("x", *middles) == pytest.approx(expected)


@both
def test_a_step_that_is_disarmed_never_comes(model: str) -> None:
    with generator(model) as (fixture, driver):
        driver.hold(1, 0.7)
        driver.prepare_step(1, 1.0, 0.1)
        driver.disarm(1)
        driver.disarm(2)
        fixture.clock.sleep(1.0)
        fixture.rise()
        assert fixture.volts("x", 0.05) == pytest.approx([0.7])


@both
@pytest.mark.parametrize(
    ("ask", "states"),
    [
        (lambda one: one.hold(1, 9.1), "the bench allows 9 V"),
        (lambda one: one.hold(1, float("nan")), "the bench allows 9 V"),
        (lambda one: one.prepare_step(1, 1.5, 0.1), "the bench allows 9 V"),
        (lambda one: one.prepare_step(1, -17.5, 0.1), "the bench allows 9 V"),
        (lambda one: one.prepare_step(1, -1.0, 1e7), "its pulses last"),
        (lambda one: one.prepare_step(1, -1.0, 0.1, 2000.0), "after a trigger"),
        (lambda one: one.prepare_step(1, 1e-4, 0.1), "its least amplitude"),
        (lambda one: one.prepare_step(1, -1.0, 0.1, cycles=0), "1 to 1000 cycles"),
        (lambda one: one.prepare_step(1, -1.0, 0.1, cycles=1001), "1 to 1000 cycles"),
        (lambda one: one.hold(3, 1.0), "it has channels 1 and 2"),
    ],
)
def test_what_bench_and_instrument_do_not_allow_is_not_tried(
    model: str, ask: Callable[[Any], object], states: str
) -> None:
    with generator(model) as (fixture, driver):
        driver.hold(1, 8.0)
        fixture.heard.clear()
        with pytest.raises(InstrumentError, match=states):
            ask(driver)
        assert not fixture.sent()
        assert fixture.volts("x") == [8.0]


@pytest.mark.parametrize(
    ("model", "limit"), [("33522B", "SOUR1:VOLT:LIM:HIGH 2"), ("DG822", "OUTP1:VOLL:HIGH 2")]
)
def test_a_level_that_the_instrument_refuses_switches_the_channel_off(
    model: str, limit: str
) -> None:
    with generator(model) as (fixture, driver):
        driver.hold(1, 1.0)
        fixture.at_its_front_panel(limit)
        states = "refused with -221.*and the channel was switched off; "
        with pytest.raises(InstrumentError, match=states):
            driver.hold(1, 5.0)
        assert fixture.volts("x") == [0.0] and driver.read_safety().safe
        assert fixture.newest("output") == "off"
        driver.hold(1, 1.0)  # the fault of one request is no fault of the next
        assert fixture.volts("x") == [1.0]


@both
def test_a_load_that_somebody_resets_is_noticed(model: str) -> None:
    with generator(model, {"fault": "load-reset", "at": "10 s"}) as (fixture, driver):
        driver.hold(1, 1.0)
        fixture.clock.sleep(11.0)
        with pytest.raises(InstrumentError, match="OUTP1:LOAD"):
            driver.hold(1, 1.0)
        assert fixture.volts("x") == [0.0]


@both
@pytest.mark.parametrize("fault", ["no-reply", "nan"])
@pytest.mark.parametrize("verb", [("hold", 1, 1.0), ("prepare_step", 1, 1.0, 0.1)])
def test_a_fault_on_the_wire_switches_the_channel_off(
    model: str, fault: str, verb: tuple[Any, ...]
) -> None:
    with generator(model, {"fault": fault, "command": "FUNC?"}) as (_, driver):
        name, *values = verb
        with pytest.raises(InstrumentError, match=", and the channel was switched off; "):
            getattr(driver, name)(*values)
        assert driver.read_safety().safe
