"""The Rigol DG822 at coils, over a real socket on virtual time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from fixture import Fixture, standing
from generator_fixture import TRUTH, Room

from drivers.rigol.generator_dg800 import RigolDg800
from sim_instruments.rigol.generator_dg800 import RigolDg800 as SimulatedGenerator
from station.errors import InstrumentError
from station.instruments.scan import recognised

NAME, SERIAL = "signal_generator.xy", "DG8A262000837"
IDENTITY = f"Rigol Technologies,DG822,{SERIAL},00.02.06.00.01"


@contextmanager
def generator(
    *faults: Any, limit_V: float = 9.0, load: str = "high-impedance", **truth: Any
) -> Iterator[tuple[Fixture, Any]]:
    given = {**TRUTH, **truth}
    with standing(NAME, SimulatedGenerator, given, Room(), *faults, serial=SERIAL) as fixture:
        driver = RigolDg800(fixture.place({"voltage": limit_V}, load=load))
        yield fixture, driver
        driver.close()


def volts(fixture: Fixture, coil: str, after_s: float = 0.0) -> float:
    return float(fixture.room.volts(coil, fixture.clock.now() + after_s)[0])


def rise(fixture: Fixture) -> None:
    with fixture.room.lock:
        fixture.room.trigger.rise(fixture.clock.now())


@pytest.mark.parametrize("maker", ["Rigol Technologies", "RIGOL TECHNOLOGIES"])
def test_it_is_recognised_however_it_writes_its_maker(maker: str) -> None:
    with generator(maker=maker) as (_, driver):
        identity = driver.identify()
        assert (identity.maker, identity.model, identity.serial) == (maker, "DG822", SERIAL)
    found = recognised("TCPIP::192.0.2.1::5555::SOCKET", IDENTITY.replace("Rigol", maker[:5]))
    assert "rigol-dg800" in str(found)


def test_a_voltage_that_is_held_is_at_the_coil_and_is_switched_off() -> None:
    with generator() as (fixture, driver):
        driver.hold(1, 1.25)
        driver.hold(2, -0.5)
        assert (volts(fixture, "x"), volts(fixture, "y")) == (1.25, -0.5)
        assert driver.read_safety().read_back == "channel 1 on, channel 2 on"
        driver.switch_off(1)
        assert (volts(fixture, "x"), volts(fixture, "y")) == (0.0, -0.5)
        driver.make_safe(fixture.clock.now() + 5.0)
        assert driver.read_safety().safe and fixture.newest("output") == "off"


@pytest.mark.parametrize("step_V", [2.5, -2.5])
def test_a_step_begins_at_the_trigger_after_its_delay_and_ends_by_itself(step_V: float) -> None:
    with generator() as (fixture, driver):
        driver.hold(1, 0.3)
        driver.prepare_step(1, step_V, 0.1, 0.5)
        assert volts(fixture, "x") == pytest.approx(0.3)
        rise(fixture)
        around = [volts(fixture, "x", after_s) for after_s in (0.49, 0.51, 0.59, 0.61)]
        assert around == pytest.approx([0.3, 0.3 + step_V, 0.3 + step_V, 0.3])


def test_a_step_that_is_disarmed_never_comes() -> None:
    with generator() as (fixture, driver):
        driver.hold(1, 0.7)
        driver.prepare_step(1, 1.0, 0.1)
        driver.disarm(1)
        rise(fixture)
        assert volts(fixture, "x", 0.05) == pytest.approx(0.7)


def test_limits_and_load_are_in_the_instrument_before_an_output_is_on() -> None:
    with generator(limit_V=3.0, load="50 ohm") as (fixture, driver):
        driver.programme_limits()
        asked = "OUTP2:VOLL?;:OUTP2:VOLL:HIGH?;:OUTP2:VOLL:LOW?;:OUTP2:IMP?;:OUTP2?"
        limits = "ON;3.000000E+00;-3.000000E+00;5.000000E+01;OFF"
        assert fixture.at_its_front_panel(asked) == limits


@pytest.mark.parametrize(
    ("asked", "stated"),
    [
        (lambda one: one.hold(1, 9.1), "the bench allows 9 V"),
        (lambda one: one.prepare_step(1, -9.1, 0.1), "the bench allows 9 V"),
        (lambda one: one.prepare_step(1, 1.0, 1e6), "its pulses last"),
        (lambda one: one.prepare_step(1, 1.0, 0.1, 101.0), "it waits 0 s to 100 s"),
        (lambda one: one.prepare_step(1, 1e-3, 0.1), "its least amplitude"),
        (lambda one: one.hold(3, 1.0), "it has channels 1 and 2"),
    ],
)
def test_what_bench_and_instrument_do_not_allow_is_refused(asked: Any, stated: str) -> None:
    with generator() as (fixture, driver):
        with pytest.raises(InstrumentError, match=stated):
            asked(driver)
        assert not fixture.sent()


def test_a_level_that_the_instrument_refuses_switches_the_channel_off() -> None:
    with generator() as (fixture, driver):
        driver.hold(1, 1.0)
        fixture.at_its_front_panel("OUTP1:VOLL:HIGH 2")
        with pytest.raises(
            InstrumentError, match=r"refused with -221.*the channel was switched off"
        ):
            driver.hold(1, 5.0)
        assert volts(fixture, "x") == 0.0 and driver.read_safety().safe


def test_a_load_that_somebody_resets_is_noticed() -> None:
    with generator({"fault": "load-reset", "at": "10 s"}) as (fixture, driver):
        driver.hold(1, 1.0)
        fixture.clock.sleep(12.0)
        with pytest.raises(InstrumentError, match="OUTP1:LOAD"):
            driver.hold(1, 1.0)
        assert volts(fixture, "x") == 0.0


def test_a_strangers_session_on_the_wire() -> None:
    with generator() as (fixture, _), fixture.line() as line:
        assert line.ask("*IDN?") == IDENTITY
        for command in (
            ":SOUR1:FUNC:SHAP PULS",
            ":SOUR1:FUNC:PULS:PER 1E-3",
            ":SOUR1:VOLT:UNIT Vpp",
            ":SOUR1:VOLT 0.2",
            ":SOURCE1:VOLTAGE:OFFSET 0.1",
            ":SOUR1:BURS ON",
            ":SOUR1:BURS:MODE TRIG",
            ":SOUR1:BURS:NCYC 1",
            ":SOUR1:BURS:TRIG:SOUR MAN",
            ":SOUR1:BURS:TDEL 0",
            ":OUTP1 ON",
            ":SOUR1:BURS:TRIG",
        ):
            assert line.ask(f"{command};:SYST:ERR?") == '0,"No error"', command
        assert line.ask(":OUTP1?") == "ON"
        assert line.ask(":OUTP1:IMP?") == "5.000000E+01"
        assert line.ask(":SOUR1:BURS:TRIG:SOUR?;:SOUR1:BURS:IDLE?") == "MAN;FPT"
        for wrong, code in (
            (":NOSUCH 1", -113),
            (":SOUR1:BURS:TDEL 101", -222),
            (":SOUR1:VOLT:OFFS 100", -222),
            (":SOUR1:FUNC NOSUCH", -224),
            (":OUTP1 MAYBE", -224),
            (":SOUR2:BURS:TRIG", -211),
        ):
            assert line.ask(f"{wrong};:SYST:ERR?").startswith(f"{code},"), wrong
            line.write("*CLS")
