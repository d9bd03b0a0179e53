"""The Keithley DMM6500 in the role of the multimeter, over the real transport."""

from __future__ import annotations

import numpy as np
import pytest
from keysight_fixture import burst, meter

from drivers.keithley.multimeter_dmm6500 import PIECE, same
from sim_instruments.keithley.multimeter_dmm6500 import KeithleyDmm6500 as SimulatedMeter
from sim_instruments.keithley.multimeter_dmm6500_loop import SimpleLoop
from station.errors import InstrumentError

IDENTITY = "KEITHLEY INSTRUMENTS,MODEL DMM6500,04592428,1.7.12b"
NO_ERROR = '0,"No error;0;0 0"'


def test_a_long_burst_is_read_in_pieces_and_in_order() -> None:
    with meter("DMM6500", slope=1e-2) as (fixture, driver):
        driver.configure(1.0, 0.01)
        volts = burst(fixture, driver, 2 * PIECE + 1).columns["voltage_V"]
        assert len(volts) == 2 * PIECE + 1 and (np.diff(volts) >= 0).all()
        asked = [line for line in fixture.sent() if line.startswith(b"TRAC:DATA?")]
        assert [line.split(b",")[1] for line in asked] == [b"1000", b"2000", b"2001"]


def test_settings_are_put_back_as_they_were_met() -> None:
    asked = (
        "SENS:FUNC?;:VOLT:RANG:AUTO?;:VOLT:RANG?;:VOLT:NPLC?;:VOLT:AZER?;:VOLT:INP?;:VOLT:AVER?;"
        ":VOLT:REL:STAT?;:CALC:VOLT:MATH:STAT?"
    )
    with meter("DMM6500", auto_zero=False) as (fixture, driver):
        fixture.at_its_front_panel('FUNC "FRES";:VOLT:NPLC 5;:VOLT:AVER ON;:VOLT:REL:STAT ON')
        fixture.at_its_front_panel("CALC:VOLT:MATH:STAT ON")
        met = fixture.at_its_front_panel(asked)
        driver.configure(0.5, 1)
        driver.configure(5.0, 2)
        assert fixture.at_its_front_panel(asked) == "VOLT:DC;0;10;2;0;AUTO;0;0;0"
        driver.start(100)
        driver.kept.put_back()
        assert fixture.at_its_front_panel(asked) == met == "FRES;1;1000;5;1;MOHM10;1;1;1"
        assert fixture.at_its_front_panel("SYST:ERR?") == NO_ERROR


@pytest.mark.parametrize("language", ["TSP", "SCPI2000", "SCPI34401"])
def test_another_command_set_is_stated_and_nothing_is_set(language: str) -> None:
    with meter("DMM6500", truth={"command_set": language}) as (fixture, driver):
        assert driver.identify().model == "MODEL DMM6500"
        with pytest.raises(InstrumentError, match=f"it is '{language}', and nothing was set"):
            driver.configure(1.0, 1)
        assert fixture.sent()[-1] == b"*LANG?\n"


def test_a_setting_that_does_not_stay_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SimulatedMeter, "_set", lambda *_: None)
    stated = "set VOLT:DC:RANG:AUTO to 0: it reads back 1"
    with meter("DMM6500") as (_, driver), pytest.raises(InstrumentError, match=stated):
        driver.configure(1.0, 10)


def test_a_strange_state_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SimpleLoop, "state", "DREAMING;IDLE;1")
    with meter("DMM6500") as (_, driver):
        driver.configure(1.0, 1)
        driver.start(3)
        with pytest.raises(InstrumentError, match="DREAMING"):
            driver.fetch()


def test_words_and_numbers_read_back_as_they_were_set() -> None:
    assert same("10", "1.0E+01") and same("AUTO", "auto")
    assert not same("10", "1") and not same("AUTO", "MOHM10")


def test_a_strangers_session_on_the_wire() -> None:
    with meter("DMM6500") as (fixture, _), fixture.line() as line:
        assert line.ask("*IDN?") == IDENTITY
        line.write("*LANG SCPI")
        assert line.ask("*LANG?") == "SCPI"
        line.write("*RST")
        line.write(":SENS:FUNC 'VOLT:DC'")
        assert line.ask(":SENS:FUNC?") == "VOLT:DC"
        line.write("VOLT:DC:RANG:AUTO 0;UPP 1.0")
        assert line.ask("VOLT:DC:RANG?") == "1"
        line.write(":SENSE:VOLTAGE:DC:NPLCYCLES 0.0005")
        assert line.ask(":SENS:VOLT:NPLC?") == "0.0005"
        assert line.ask(":SYST:LFR?;:ROUT:TERM?;:TRIG:STAT?") == "50;FRON;EMPTY;EMPTY;0"
        line.write('TRAC:CLE "defbuffer1"')
        line.write('TRIG:LOAD "SimpleLoop",10,0.05')
        line.write("INIT")
        assert line.ask("TRIG:STAT?").startswith("RUNNING;RUNNING;")
        assert line.ask("*OPC?") == "1"
        assert line.ask('TRAC:ACT? "defbuffer1"') == "10"
        assert line.ask('TRAC:DATA? 9,10,"defbuffer1",READ') == "5.000000E-01,5.000000E-01"
        assert line.ask(":READ?") == "5.000000E-01"
        for wrong, code in (
            ("NOSUCH 1", -113),
            ("VOLT:NPLC 13", -222),
            ("VOLT:RANG 2000", -222),
            ('FUNC "VOLTS"', -224),
            ("FUNC VOLT", -151),
            ('TRIG:LOAD "SimpleLoop"', -109),
            ('TRIG:LOAD "NoLoop",1', -224),
            ('TRAC:CLE "mine"', -224),
            ('TRIG:LOAD "Empty";:INIT', -221),
            ('TRIG:LOAD "SimpleLoop",9;:INIT;:INIT', -213),
            ("VOLT:RANG 1", -221),
        ):
            line.write(wrong)
            answer = line.ask("SYST:ERR?")
            assert answer.startswith(f"{code},"), wrong
            assert answer.count(";") == 2, "text, severity and time"
        assert line.ask("SYST:ERR?") == NO_ERROR
