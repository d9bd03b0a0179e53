"""A thermal chamber behind a Watlow F4T or F4: driver and simulator, over the wire between them."""

from __future__ import annotations

import time
from typing import Any

import pytest
from fixture import error_of
from variants import variant
from watlow_fixture import LIMITS, Room, controller, opened

from drivers.watlow.chamber import Steps
from sim_instruments.bench import SimulatedBench
from sim_instruments.truth import SimulationError
from sim_instruments.wire.modbus import Parameter
from station.clock import VirtualClock
from station.control.requests import ask_devices
from station.errors import InstrumentError
from station.files.lookup import BENCHES, find
from station.instruments.bench import read_bench

MODELS = pytest.mark.parametrize("model", ["f4t", "f4"])


def follow(fixture: Any, driver: Any, every_s: float = 10.0) -> float:
    """Look at a ramp until it ends; return how long it took."""
    began_s = fixture.clock.now()
    while driver.is_ramping():
        fixture.clock.sleep(every_s)
        assert fixture.clock.now() < began_s + 24 * 3600.0
    return float(fixture.clock.now() - began_s)


# Who is there, and what is in the controller.


@pytest.mark.parametrize("has", ["low-first", "high-first"])
@pytest.mark.parametrize("said", ["low-first", "high-first"])
def test_the_order_of_words_is_proven_before_any_number_is_believed(has: str, said: str) -> None:
    with opened("f4t", word_order=has, settings={"word_order": said}) as (fixture, driver):
        if has == said:
            assert driver.identify().serial == "10423177"
            driver.programme_limits()
            assert driver.temperature_degC() == pytest.approx(fixture.air_degC() + 0.08, abs=0.05)
        else:
            assert "correct settings.word_order" in error_of(driver.identify)
            assert "correct settings.word_order" in error_of(driver.switch_on)


@MODELS
def test_the_limits_are_in_the_controller_and_are_never_made_wider(model: str) -> None:
    with opened(model) as (_, driver):
        driver.programme_limits()
        driver.programme_limits()
        assert driver._limits_found() == (-45.0, 70.0)
    wide = {"temperature_low": -45.0, "temperature_high": 200.0}
    with opened(model, limits=wide) as (_, driver):
        text = error_of(driver.programme_limits)
        assert "the controller's own limits are -70 degC and 180 degC; narrow limits" in text
    with opened(model, limits={"temperature_low": -45.0}) as (_, driver):
        assert "it gives no limits.temperature_high" in error_of(driver.switch_on)


def test_a_controller_that_speaks_fahrenheit_is_refused() -> None:
    with controller("f4t") as fixture:
        fixture.simulator._registers.add(6730, Parameter(lambda: (30,)))
        assert "30 came back where degC is 15" in error_of(fixture.driver().programme_limits)
    with controller("f4") as fixture:
        fixture.simulator._registers.add(901, Parameter(lambda: (0,)))
        assert "set the controller to degC" in error_of(fixture.driver().programme_limits)


# Ramps.


@MODELS
def test_it_is_switched_on_where_it_stands_and_ramps_evenly(model: str) -> None:
    with opened(model) as (fixture, driver):
        driver.switch_on()
        start_degC = driver.set_point_degC()
        assert start_degC == pytest.approx(fixture.air_degC() + 0.08, abs=0.1)
        fixture.clock.sleep(600.0)
        driver.ramp_to(start_degC - 5.0, 0.2)
        for minutes in range(1, 26):
            fixture.clock.sleep(60.0)
            driver.is_ramping()
            assert driver.set_point_degC() == pytest.approx(start_degC - 0.2 * minutes, abs=0.06)
        assert not driver.is_ramping()
        fixture.clock.sleep(1800.0)
        assert fixture.air_degC() == pytest.approx(start_degC - 5.0, abs=0.3)
        assert fixture.newest("temperature") is not None
        assert fixture.newest("output") == "on"


@MODELS
def test_the_air_lags_a_ramp_by_the_chambers_time_constant(model: str) -> None:
    with opened(model) as (fixture, driver):
        driver.switch_on()
        start_degC = driver.set_point_degC()
        driver.ramp_to(start_degC + 20.0, 0.2)
        for _ in range(360):
            fixture.clock.sleep(10.0)
            driver.is_ramping()
        # Five minutes of 0.2 K, and the swing of the control.
        assert driver.set_point_degC() - fixture.air_degC() == pytest.approx(1.0, abs=0.25)


def test_the_f4t_ramps_by_itself_while_nobody_asks() -> None:
    with opened("f4t") as (fixture, driver):
        driver.switch_on()
        driver.ramp_to(-20.0, 0.5)
        fixture.clock.sleep(3600.0)
        assert fixture.air_degC() == pytest.approx(driver.set_point_degC() + 2.5, abs=0.4)
        assert driver.set_point_degC() == pytest.approx(22.09 - 30.0, abs=0.1)


def test_an_f4_that_nobody_looks_at_waits_and_then_takes_a_kelvin_at_a_time() -> None:
    with opened("f4") as (fixture, driver):
        driver.switch_on()
        start_degC = driver.set_point_degC()
        driver.ramp_to(start_degC - 10.0, 0.5)
        fixture.clock.sleep(1200.0)
        for looks in range(1, 11):
            driver.read_quantity("temperature")
            assert driver._stands_at() == pytest.approx(start_degC - looks, abs=0.01)
        assert not driver.is_ramping()


def test_an_f4t_without_ramp_registers_is_stepped() -> None:
    with opened("f4t", settings={"ramp": "stepped"}) as (fixture, driver):
        driver.switch_on()
        driver.ramp_to(25.0, 0.5)
        sent = b"".join(data for direction, data in fixture.heard if direction == ">")
        assert (2798).to_bytes(2, "big") not in sent
        assert follow(fixture, driver) == pytest.approx((25.0 - 22.08) / 0.5 * 60, abs=15)
        assert driver.set_point_degC() == pytest.approx(25.0)


def test_a_controller_that_jumps_in_the_place_of_a_ramp_is_told_and_taken_back() -> None:
    with opened("f4t") as (fixture, driver):
        driver.switch_on()
        before_degC = driver.set_point_degC()
        told_action = [62]
        # A firmware that takes the action of a ramp and does not act on it.
        fixture.simulator._registers.add(
            2794,
            Parameter(
                lambda: tuple(told_action), lambda words: told_action.__setitem__(0, words[0])
            ),
        )
        text = error_of(lambda: driver.ramp_to(40.0, 0.5))
        assert "its set-point jumped by 17.9" in text
        assert "write ramp: stepped in the settings of the bench file" in text
        assert driver.set_point_degC() == pytest.approx(before_degC)


@MODELS
def test_a_slew_limit_makes_every_way_a_ramp_and_holds_against_a_plan(model: str) -> None:
    limits = {**LIMITS, "temperature_slew": 2.0}
    with opened(model, limits=limits) as (fixture, driver):
        driver.switch_on()
        driver.set_temperature(32.0)
        assert driver.is_ramping()
        assert follow(fixture, driver) == pytest.approx(300.0, abs=15.0)
        text = error_of(lambda: driver.ramp_to(30.0, 2.5))
        assert "the bench allows rates above 0 and up to 2 degC/min; correct the plan" in text
    with opened(model) as (fixture, driver):
        driver.switch_on()
        driver.set_temperature(32.0)
        assert not driver.is_ramping()
        assert driver.set_point_degC() == pytest.approx(32.0)


def test_a_step_is_never_larger_than_a_kelvin_and_meets_its_target() -> None:
    steps = Steps(20.0, 10.0, 0.1, 100.0, 20.0)
    assert steps.due_degC(105.0) == pytest.approx(19.5)
    assert steps.due_degC(1000.0) == 19.0
    steps.stands_at_degC = 10.4
    assert steps.due_degC(1000.0) == 10.0


# Rest, pause and what an interlock asks.


@MODELS
def test_it_is_off_at_the_wire_and_in_the_world(model: str) -> None:
    with opened(model) as (fixture, driver):
        driver.switch_on()
        driver.ramp_to(60.0, 2.0)
        for _ in range(30):
            fixture.clock.sleep(10.0)
            assert driver.is_ramping()
        assert fixture.output() > 0.1
        assert fixture.simulator.energised()
        assert driver.read_safety().read_back.startswith("control ON, output ")
        driver.make_safe(fixture.clock.now() + 10.0)
        assert driver.read_safety().safe
        assert not fixture.simulator.energised()
        assert fixture.output() == 0.0
        assert fixture.newest("output") == "off"
        fixture.clock.sleep(300.0)
        assert not driver.is_ramping()
        assert driver.read_safety().safe


@MODELS
@pytest.mark.parametrize("kind", ["no-reply", "partial", "lost-command", "late"])
def test_two_faults_on_the_wire_do_not_keep_it_on(model: str, kind: str) -> None:
    with opened(model, {"fault": kind, "at": "60 s", "count": 2}) as (fixture, driver):
        driver.switch_on()
        fixture.clock.sleep(100.0)
        driver.make_safe(fixture.clock.now() + 10.0)
        assert driver.read_safety().safe


def test_a_profile_that_somebody_started_is_terminated_on_the_way_to_rest() -> None:
    with opened("f4t") as (fixture, driver):
        done: list[int] = []
        add = fixture.simulator._registers.add
        add(16568, Parameter(lambda: (251 if done else 149,)))
        add(16566, Parameter(lambda: (61,), lambda words: done.extend(words)))
        driver.make_safe(10.0)
        assert done == [148]
        assert driver.read_safety().safe


@MODELS
def test_a_broken_sensor_keeps_nobody_from_rest(model: str) -> None:
    with opened(model) as (fixture, driver):
        driver.switch_on()
        if model == "f4t":
            broken = fixture.simulator._float(lambda: float("nan"))
            fixture.simulator._registers.add(2820, broken)
        else:
            fixture.simulator._registers.add(100, Parameter(lambda: (0x7FFF,)))
        assert "look at the controller's panel, and at the sensor" in error_of(
            driver.temperature_degC
        )
        driver.make_safe(fixture.clock.now() + 10.0)
        assert driver.read_safety().safe


@MODELS
def test_a_pause_holds_the_set_point_and_says_so(model: str) -> None:
    with opened(model) as (fixture, driver):
        assert ask_devices({"thermal_chamber": driver}).acknowledged == {
            "thermal_chamber": "control off"
        }
        driver.switch_on()
        driver.ramp_to(40.0, 1.0)
        fixture.clock.sleep(60.0)
        words = ask_devices({"thermal_chamber": driver})
        assert words.acknowledged["thermal_chamber"].startswith("holds 2")
        assert not driver.is_ramping()


def test_interlocks_may_ask_for_temperature_output_and_door() -> None:
    with opened("f4t", {"fault": "door-open", "at": "100 s"}) as (fixture, driver):
        assert driver.read_quantity("temperature") == pytest.approx(22.08, abs=0.05)
        assert driver.read_quantity("output") == "off"
        assert driver.read_quantity("door") == "closed"
        fixture.clock.sleep(200.0)
        assert driver.read_quantity("door") == "open"
        assert fixture.newest("door") == "open"


@pytest.mark.parametrize(
    ("model", "settings", "truth"),
    [("f4t", {}, {}), ("f4", {"door": 3}, {"door_input": 3})],
)
def test_door_and_alarms_are_contacts_of_the_chain(
    model: str, settings: dict[str, int], truth: dict[str, int]
) -> None:
    faults: list[dict[str, Any]] = [
        {"fault": "door-open", "at": "10 s", "for": "20 s"},
        {"fault": "chamber-alarm", "at": "20 s", "for": "20 s", "number": 2},
    ]
    seen = []
    with opened(model, *faults, settings=settings, **truth) as (fixture, driver):
        for until_s in (5.0, 15.0, 25.0, 35.0, 45.0):
            fixture.clock.sleep_until(until_s)
            seen.append([contact.split(" (")[0] for contact in driver.open_contacts()])
            assert fixture.newest("chain") == driver.read_quantity("chain")
    assert seen == [[], ["door"], ["door", "alarm 2 is on"], ["alarm 2 is on"], []]


# What may go wrong with a chamber.


@MODELS
def test_an_alarm_ends_what_the_driver_is_asked_within_a_minute(model: str) -> None:
    with opened(model, {"fault": "chamber-alarm", "at": "300 s", "number": 1}) as (fixture, driver):
        driver.switch_on()
        driver.ramp_to(40.0, 0.5)
        while fixture.clock.now() < 285.0:
            fixture.clock.sleep(10.0)
            driver.is_ramping()
        with pytest.raises(InstrumentError, match="alarm 1 is on") as raised:
            for _ in range(8):
                fixture.clock.sleep(10.0)
                driver.temperature_degC()
        assert "look at the chamber and at its controller's panel" in str(raised.value)
        assert "alarm 1 is on" in error_of(driver.is_ramping), "told once only"
        assert fixture.output() == 0.0
        driver.make_safe(fixture.clock.now() + 10.0)
        assert driver.read_safety().safe


@MODELS
def test_a_compressor_that_trips_is_an_alarm_and_nothing_cools(model: str) -> None:
    with opened(model, {"fault": "compressor-trip", "at": "1 s"}) as (fixture, driver):
        driver.switch_on()
        driver.set_temperature(0.0)
        fixture.clock.sleep(3600.0)
        assert "alarm 2 is on" in error_of(driver.temperature_degC)
        assert fixture.air_degC() > 20.0


@MODELS
def test_a_broken_heater_is_no_alarm_and_its_set_point_is_never_reached(model: str) -> None:
    with opened(model, {"fault": "heater-broken", "at": "1 s"}) as (fixture, driver):
        driver.switch_on()
        driver.set_temperature(60.0)
        fixture.clock.sleep(7200.0)
        assert driver.set_point_degC() == pytest.approx(60.0)
        assert driver.temperature_degC() < 30.0


@MODELS
def test_a_frozen_process_value_stays_while_the_air_goes_on(model: str) -> None:
    fault = {"fault": "frozen", "at": "60 s", "for": "1 h"}
    with opened(model, fault) as (fixture, driver):
        driver.switch_on()
        driver.set_temperature(40.0)
        fixture.clock.sleep(100.0)
        first_degC = driver.temperature_degC()
        fixture.clock.sleep(3000.0)
        assert driver.temperature_degC() == first_degC
        assert fixture.air_degC() == pytest.approx(40.0, abs=0.3)
        fixture.clock.sleep(3000.0)
        assert driver.temperature_degC() == pytest.approx(fixture.air_degC(), abs=0.2)


def test_a_limit_controller_and_a_control_that_somebody_switched_off_are_reported() -> None:
    with opened("f4t") as (fixture, driver):
        driver.switch_on()
        fixture.simulator._registers.add(11264 + 60 * 4, Parameter(lambda: (32,)))
        fixture.clock.sleep(61.0)
        assert "the limit controller in slot 5 has tripped" in error_of(driver.temperature_degC)
    with opened("f4t") as (fixture, driver), fixture.line() as panel:
        driver.switch_on()
        panel.put(2730, 62)
        fixture.clock.sleep(61.0)
        assert "its control is off though it was switched on" in error_of(driver.is_ramping)


def test_an_f4_whose_chamber_has_an_event_switches_that_too() -> None:
    with opened("f4", settings={"chamber_event": 2}, chamber_event=2) as (fixture, driver):
        driver.switch_on()
        driver.set_temperature(40.0)
        fixture.clock.sleep(60.0)
        assert fixture.output() > 0.1
        driver.make_safe(fixture.clock.now() + 10.0)
        assert driver.read_safety().safe
        assert driver._line.read(2010) == [0]
    with opened("f4", chamber_event=2) as (fixture, driver):
        driver.switch_on()  # the bench file does not know of the event
        driver.set_temperature(40.0)
        fixture.clock.sleep(60.0)
        assert fixture.output() == 0.0


def test_an_alarm_that_the_controller_does_not_have_is_told_as_such() -> None:
    with opened("f4t", settings={"alarms": 6}) as (_, driver):
        text = error_of(driver.switch_on)
        assert "read register 1756: it has no such register" in text


def test_a_truth_that_is_none_is_reported() -> None:
    for truth in ({"steers": "table"}, {"word_order": "any"}):
        with pytest.raises(SimulationError), controller("f4t", **truth):
            pass


# The bench, and what it costs.


def test_the_chamber_of_a_world_without_one_is_at_room_temperature() -> None:
    room = Room()
    del room.chamber
    with opened("f4t", room=room) as (fixture, driver):
        assert driver.temperature_degC() == pytest.approx(22.08, abs=0.05)
        driver.switch_on()
        driver.set_temperature(30.0)
        fixture.clock.sleep(3600.0)
        assert driver.temperature_degC() == pytest.approx(30.1, abs=0.3)


def test_the_alternate_bench_serves_in_every_world() -> None:
    from station import registry

    bench = read_bench(find(BENCHES, "sim-alternate"), registry.names(registry.DRIVERS))
    for procedure in ("rlg-magnetic-sensitivity", "accelerometer-magnetic-sensitivity"):
        clock = VirtualClock()
        simulated = SimulatedBench(bench.data, clock, procedure)
        assert simulated.instruments["thermal_chamber"]["protocol"] == "modbus-rtu"
        assert "dut_power" in simulated.instruments
        simulated.close()
        clock.stop()


def test_twenty_hours_of_looks_cost_little() -> None:
    began_s = time.process_time()
    with opened("f4t") as (fixture, driver):
        driver.switch_on()
        driver.set_temperature(-40.0)
        fixture.clock.sleep(5 * 3600.0)
        driver.ramp_to(60.0, 0.15)
        while driver.is_ramping():
            driver.temperature_degC()
            fixture.clock.sleep(60.0)
        assert fixture.clock.now() > 16 * 3600.0
        assert fixture.air_degC() == pytest.approx(59.2, abs=0.5)
    assert time.process_time() - began_s < 10.0


# An F4 in the controllers of several makers' chambers.


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
        _, percent = driver._output()
        assert percent == pytest.approx((cools - 0x10000) / 100, abs=1.0)


@pytest.mark.parametrize("wrong", [{"map": "f5"}, {"door_active": "up"}])
def test_a_form_that_is_none_is_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(Exception, match=f"{next(iter(wrong))}: one of"), opened("f4", **wrong):
        raise AssertionError("it is served")
