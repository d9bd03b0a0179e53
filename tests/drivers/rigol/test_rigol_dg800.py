"""The Rigol DG822 at coils, over a real socket on virtual time."""

from __future__ import annotations

import pytest
from generator_fixture import generator

from station.instruments.scan import recognised

NAME, SERIAL = "signal_generator.xy", "DG8A262000837"
IDENTITY = f"Rigol Technologies,DG822,{SERIAL},00.02.06.00.01"


@pytest.mark.parametrize("maker", ["Rigol Technologies", "RIGOL TECHNOLOGIES"])
def test_it_is_recognised_however_it_writes_its_maker(maker: str) -> None:
    with generator("DG822", maker=maker) as (_, driver):
        identity = driver.identify()
        assert (identity.maker, identity.model, identity.serial) == (maker, "DG822", SERIAL)
    found = recognised("TCPIP::192.0.2.1::5555::SOCKET", IDENTITY.replace("Rigol", maker[:5]))
    assert "rigol-dg800" in str(found)


def test_limits_and_load_are_in_the_instrument_before_an_output_is_on() -> None:
    with generator("DG822", limit_V=3.0, load="50 ohm") as (fixture, driver):
        driver.programme_limits()
        asked = "OUTP2:VOLL?;:OUTP2:VOLL:HIGH?;:OUTP2:VOLL:LOW?;:OUTP2:IMP?;:OUTP2?"
        limits = "ON;3.000000E+00;-3.000000E+00;5.000000E+01;OFF"
        assert fixture.at_its_front_panel(asked) == limits


def test_a_strangers_session_on_the_wire() -> None:
    with generator("DG822") as (fixture, _), fixture.line() as line:
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
