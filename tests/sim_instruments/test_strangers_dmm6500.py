"""What other programs send a Keithley DMM6500 every day, and what the meter answers."""

from __future__ import annotations

import pytest
from keysight_fixture import OHMS, Room, meter

OVERLOAD = 9.9e37
NO_ERROR = '0,"No error;0;0 0"'


def quiet(line: object) -> None:
    assert line.ask("SYST:ERR?") == NO_ERROR  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "answered", "reading"),
    [
        ("VOLT:DC", "VOLT:DC", 0.5), ("VOLT:AC", "VOLT:AC", 0.0), ("CURR:DC", "CURR:DC", 0.0),
        ("CURR:AC", "CURR:AC", 0.0), ("RES", "RES", OVERLOAD), ("FRES", "FRES", OVERLOAD),
        ("DIOD", "DIOD", OVERLOAD), ("CAP", "CAP", 0.0), ("TEMP", "TEMP", OVERLOAD),
        ("CONT", "CONT", OVERLOAD), ("PER:VOLT", "PER:VOLT", 0.0),
        ("FREQ:VOLT", "FREQ:VOLT", 0.0), ("FREQ", "FREQ:VOLT", 0.0),
        ("VOLT:DC:RAT", "VOLT:DC:RAT", OVERLOAD), ("VOLTage", "VOLT:DC", 0.5),
    ],
)  # fmt: skip
def test_every_function_is_chosen_and_reads_what_is_there(
    name: str, answered: str, reading: float
) -> None:
    with meter("DMM6500") as (fixture, _), fixture.line() as line:
        line.write(f':SENS:FUNC "{name}"')
        assert line.ask(":SENS:FUNC?") == answered
        assert float(line.ask(":READ?")) == pytest.approx(reading)
        quiet(line)


@pytest.mark.parametrize(
    ("header", "value", "default"),
    [
        (":DISP:VOLT:DIG", "4", "6"), (":DISP:FREQ:DIG", "3", "6"), ("VOLT:DC:REL", "0.5", "0"),
        (":SENS:CAP:REL", "1E-09", "0"), (":SENS:VOLT:AC:DET:BAND", "30", "3"),
        (":SENS:CURR:AC:DET:BAND", "300", "3"), (":SENS:FREQ:THR:RANG", "1", "10"),
        (":SENS:PER:THR:RANG:AUTO", "0", "1"), (":SENS:FREQ:APER", "0.01", "0.2"),
        (":SENS:TEMP:NPLC", "2", "1"), (":SENS:DIOD:BIAS:LEV", "0.0001", "0.001"),
        (":SENS:VOLT:AVER:COUN", "20", "10"), ("VOLT:AVER:TCON", "MOV", "REP"),
        ("VOLT:DC:APER", "0.1", "0.02"), (":SENS:FRES:RANG", "1", "1E+08"),
        (":SENS:CAP:RANG", "1E-06", "0.001"), ("TRIG:TIM1:DEL", "0.5", "1E-05"),
        ("TRIG:TIM4:STAR:STIM", "NOT1", "NONE"), ("SENS:COUN", "5", "1"),
        (":CALC:VOLT:MATH:FORM", "MXB", "PERC"), ("ROUT:SCAN:INT", "2", "0"),
        (":SENSe:VOLT:DC:DELay:USER2", "0.3", "0"), (":DIG:VOLT:SRAT", "10000", "1000000"),
        ("TRAC:POIN", "20", "100000"), ("CALC1:RES:MATH:MBF", "-2", "0"),
    ],
)  # fmt: skip
def test_what_is_set_is_answered_until_a_reset(header: str, value: str, default: str) -> None:
    with meter("DMM6500") as (fixture, _), fixture.line() as line:
        assert line.ask(f"{header}?") == default
        line.write(f"{header} {value}")
        assert line.ask(f"{header}?") == value
        line.write("*RST")
        assert line.ask(f"{header}?") == default
        quiet(line)


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (":DISP:VOLT:DIG 7", -222), ("VOLT:AVER:COUN 101", -222), ("VOLT:AVER:TCON HYBR", -224),
        ("VOLT:REL 1001", -222), (":SENS:VOLT:AC:DET:BAND 20", -224), ("CAP:NPLC 1", -113),
        ("FREQ:AVER 1", -113), ("CAP:INP AUTO", -113), ("FREQ:APER 0.3", -222),
        (":SENS:DIOD:BIAS:LEV 0.002", -224), ("SENS:COUN 0", -222), ("TRIG:TIM1:DEL 0", -222),
        ("TRIG:TIM5:DEL 1", -113), ("FUNC \"DIG:VOLT\"", -224), ("VOLT:DEL:USER1 1E-9", -222),
        ("DISP:SCR NOSUCH", -224), ("SYST:BEEP 10,1", -222), ("SYST:BEEP", -109),
        ("SYST:TIME 2026,13,1,0,0,0", -222), ('TRAC:MAKE "a"', -109), ('TRAC:MAKE "a",9', -222),
        ('TRAC:MAKE "defbuffer1",90', 1115), ('TRAC:DEL "defbuffer1"', -224),
        ('TRAC:CLE "none"', -224), ("FORM REAL", -224), ("RES:REL:ACQ", -221),
    ],
)  # fmt: skip
def test_what_the_meter_cannot_do_is_its_error(wrong: str, code: int) -> None:
    with meter("DMM6500") as (fixture, _), fixture.line() as line:
        line.write(wrong)
        assert line.ask("SYST:ERR?").startswith(f'{code},"')
        quiet(line)


def test_bounds_are_asked_for() -> None:
    with meter("DMM6500") as (fixture, _), fixture.line() as line:
        assert line.ask("VOLT:RANG? MIN;RANG? MAX;NPLC? MIN;NPLC? MAX;NPLC? DEF") == (
            "0.1;1000;0.0005;12;1"
        )
        line.write("VOLT:NPLC MAX")
        assert line.ask("VOLT:APER?") == "0.24"


def test_offset_then_math_are_put_on_readings_and_left_off_overloads() -> None:
    with meter("DMM6500", slope=0.0) as (fixture, _), fixture.line() as line:
        line.write(":SENS:VOLT:REL:ACQ")
        assert line.ask(":SENS:VOLT:REL?") == "0.5"
        line.write(":SENS:VOLT:REL 0.2;REL:STAT 1")
        assert line.ask("READ?") == "3.000000E-01"
        line.write("CALC:VOLT:MATH:FORM MXB;MMF 10;MBF 1;STAT ON")
        assert line.ask("READ?") == "4.000000E+00"
        line.write("CALC:VOLT:MATH:FORM REC")
        assert float(line.ask("READ?")) == pytest.approx(1 / 0.3, rel=1e-6)
        line.write("CALC:VOLT:MATH:FORM PERC;PERC 0.6")
        assert float(line.ask("READ?")) == pytest.approx(-50.0)
        line.write("VOLT:RANG 0.1")
        assert line.ask("READ?") == "9.900000E+37"
        line.write("VOLT:REL:ACQ")
        assert line.ask("SYST:ERR?").startswith("-222")
        quiet(line)


def test_a_repeating_filter_takes_its_time_and_the_noise_down() -> None:
    with meter("DMM6500", truth={"noise": "100 ppm"}) as (fixture, _), fixture.line() as line:
        line.write('VOLT:RANG 1;AZER 0;:TRIG:LOAD "SimpleLoop",200,0')

        def burst() -> tuple[float, float]:
            before_s = fixture.clock.now()
            line.write("TRAC:CLE;:INIT")
            while line.ask("TRIG:STAT?").startswith("RUNNING"):
                fixture.clock.sleep(0.05)
            took_s = fixture.clock.now() - before_s
            return took_s, float(line.ask("TRAC:STAT:STDD?"))

        plain_s, plain_V = burst()
        line.write("VOLT:AVER:COUN 16;TCON REP;STAT 1")
        filtered_s, filtered_V = burst()
        assert filtered_s / plain_s == pytest.approx(16, rel=0.02)
        assert plain_V / filtered_V == pytest.approx(4.0, rel=0.25)
        line.write("VOLT:AVER:TCON MOV")
        moving_s, moving_V = burst()
        assert moving_s / plain_s == pytest.approx(1.0, rel=0.02)
        assert moving_V < plain_V / 2


def test_a_named_buffer_fills_once_and_is_read_by_its_elements() -> None:
    with meter("DMM6500", slope=1e-2) as (fixture, _), fixture.line() as line:
        line.write("TRAC:MAKE 'mine', 10, ")
        assert line.ask('TRAC:POIN? "mine";FILL:MODE? "mine";:TRAC:FILL:MODE?') == "10;ONCE;CONT"
        line.write("SENS:COUN 6")
        newest = line.ask('READ? "mine"')
        assert line.ask(':TRAC:ACT? "mine";ACT:STAR? "mine";END? "mine";:TRAC:ACT?') == "6;1;6;0"
        assert line.ask('FETC? "mine"') == newest
        values = [float(v) for v in line.ask('TRAC:DATA? 1,6,"mine"').split(",")]
        mean = float(line.ask('TRAC:STAT:AVER? "mine"'))
        assert mean == pytest.approx(sum(values) / 6, rel=1e-6)
        extremes = line.ask('TRAC:STAT:MIN? "mine";MAX? "mine";PK2P? "mine"').split(";")
        assert [float(v) for v in extremes[:2]] == [min(values), max(values)]
        pairs = line.ask('TRAC:DATA? 1,2,"mine",READ,REL').split(",")
        assert pairs[1] == "0.000000" and float(pairs[3]) > 0.0
        assert line.ask('TRAC:DATA? 1,1,"mine",DATE') == "01/01/2026"
        line.write('READ? "mine"')
        assert line.ask("") is not None
        assert line.ask("SYST:ERR?").startswith('4915,"Attempting to store past capacity')
        assert line.ask('TRAC:ACT? "mine"') == "10"
        line.write('TRAC:DEL "mine";:TRAC:ACT? "mine"')
        assert line.ask("SYST:ERR?").startswith("-224")


def test_statistics_remember_what_was_overwritten_and_indices_move_on() -> None:
    with meter("DMM6500") as (fixture, _), fixture.line() as line:
        line.write('TRAC:POIN 10;:TRIG:LOAD "SimpleLoop",25,0;:INIT')
        assert line.ask("*OPC?;:TRAC:ACT?;:TRAC:ACT:STAR?;:TRAC:ACT:END?") == "1;10;16;25"
        assert line.ask("TRAC:DATA? 16,16") == "5.000000E-01"
        line.write("TRAC:DATA? 15,16")
        assert line.ask("SYST:ERR?").startswith("-222")
        line.write("TRAC:STAT:CLE;:TRAC:STAT:AVER?")
        assert line.ask("SYST:ERR?").startswith("-230")


def test_measure_chooses_the_function_and_answers_its_newest_reading() -> None:
    with meter("DMM6500") as (fixture, _), fixture.line() as line:
        line.write('FUNC "RES"')
        assert line.ask("MEAS:VOLT:DC?") == "5.000000E-01"
        assert line.ask("SENS:FUNC?") == "VOLT:DC"
        assert line.ask("MEAS?;:TRAC:ACT?") == "5.000000E-01;2"


def test_digitizing_keeps_its_rate_and_hides_the_other_functions() -> None:
    with meter("DMM6500") as (fixture, _), fixture.line() as line:
        line.write(":DIG:FUNC 'VOLT';:DIG:VOLT:SRAT 1000;:DIG:VOLT:RANG 1;:DIG:COUN 500")
        assert line.ask("DIG:FUNC?;:SENS:FUNC?;:DIG:VOLT:APER?") == "VOLT;NONE;AUTO"
        before_s = fixture.clock.now()
        assert line.ask("READ:DIG?;:TRAC:ACT?") == "5.000000E-01;500"
        assert fixture.clock.now() - before_s == pytest.approx(0.5, rel=0.01)
        line.write('FUNC "VOLT"')
        assert line.ask("DIG:FUNC?;:SENS:FUNC?") == "NONE;VOLT:DC"
        quiet(line)


def test_a_duration_is_a_loop_too() -> None:
    with meter("DMM6500") as (fixture, _), fixture.line() as line:
        line.write('VOLT:AZER 0;:TRIG:LOAD "DurationLoop",2,0.08;:INIT')
        assert line.ask("*OPC?;:TRIG:STAT?") == "1;IDLE;IDLE;4"
        assert float(line.ask("TRAC:ACT?")) == pytest.approx(20, abs=1)


def test_time_and_display_are_set() -> None:
    with meter("DMM6500") as (fixture, _), fixture.line() as line:
        line.write(":SYST:TIME 2026, 09, 21, 09, 06, 41")
        assert line.ask(":SYST:TIME? 1").startswith("Mon Sep 21 09:06:41")
        line.write("SYST:TIME 10,0,0")
        assert line.ask("SYST:TIME? 1").startswith("Mon Sep 21 10:00:00")
        seconds = line.ask("SYST:TIME?")
        line.write(f"SYST:TIME {seconds}")
        line.write(':DISP:CLE;:DISP:SCR SWIPE_USER;:DISP:USER1:TEXT "Hello"')
        line.write("DISP:LIGH:STAT ON100;:SYST:BEEP 1000, 0.01;:AZER:ONCE")
        assert line.ask("DISP:LIGH:STAT?") == "ON100"
        quiet(line)
        line.write("NOSUCH;:SYST:CLE")
        assert line.ask("SYST:EVEN:COUN? ALL;:SYST:EVEN:NEXT?") == f"0;{NO_ERROR}"


def test_a_resistance_thermometer_is_the_worlds_pt100() -> None:
    with meter("DMM6500", truth=OHMS) as (fixture, _), fixture.line() as line:
        assert isinstance(fixture.room, Room)
        line.write('FUNC "TEMP";:TEMP:TRAN FRTD')
        assert float(line.ask("READ?")) == pytest.approx(0.0, abs=1e-6)
        line.write("TEMP:UNIT KELV")
        assert float(line.ask("READ?")) == pytest.approx(273.15, abs=1e-3)
