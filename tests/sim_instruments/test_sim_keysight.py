"""The simulated 34465A on its socket: functions, ranges, bursts, overloads, refusals."""

from __future__ import annotations

import select
import socket
from collections.abc import Iterator

import numpy as np
import pytest
from fixture import EmptyRoom, Fixture
from keysight_fixture import standing
from sim_bench import Line

from station.clock import RealClock

CLEAN = '+0,"No error"'


@pytest.fixture
def fixture() -> Iterator[Fixture]:
    with standing() as fixture:
        yield fixture


@pytest.fixture
def line(fixture: Fixture) -> Iterator[Line]:
    with fixture.line() as line:
        yield line


def numbers(reply: str) -> list[float]:
    return [float(text) for text in reply.split(",")]


def test_it_says_who_it_is_and_what_it_has(line: Line) -> None:
    maker, model, serial, firmware = line.ask("*IDN?").split(",")
    assert (maker, model, serial) == ("Keysight Technologies", "34465A", "MY54500001")
    assert firmware[:4] >= "A.03"
    assert line.ask("*OPT?") == "DIG,MEM"
    assert line.ask("SYST:LIC:CAT?") == '"DIG","MEM"'
    assert int(line.ask("SYST:LFR?")) == 50


def test_functions_have_quotes_and_ranges_go_up(line: Line) -> None:
    assert line.ask("FUNC?") == '"VOLT"'
    assert line.ask('SENS:FUNC "FRES";:SENS:FUNC?') == '"FRES"'
    assert line.ask('FUNC "VOLTage:DC";:FUNC?') == '"VOLT"'
    assert float(line.ask("VOLT:DC:RANG 2.5;:VOLT:RANG?")) == 10.0
    assert line.ask("VOLT:RANG:AUTO?") == "0"
    assert float(line.ask("VOLT:RANG? MAX")) == 1000.0
    assert float(line.ask("SENSe:VOLTage:DC:NPLC 0.060000;:VOLT:NPLC?")) == 0.06
    assert float(line.ask("VOLT:DC:RES?")) == pytest.approx(1.5e-5)
    assert float(line.ask("VOLT:DC:RES 3e-6;:VOLT:NPLC?")) == 1.0
    assert float(line.ask("VOLT:APER 0.05;:VOLT:APER?")) == 0.05
    assert line.ask("VOLT:APER:ENAB?") == "1"
    assert line.ask("SYST:ERR?") == CLEAN


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ("VOLT:NONSENSE 1", '-113,"Undefined header"'),
        ("VOLT:RANG 2000", '-222,"Data out of range"'),
        ("VOLT:NPLC 3", '-224,"Illegal parameter value"'),
        ("FUNC VOLT", '-151,"Invalid string data"'),
        ("SAMP:COUN 2000000000", '-222,"Data out of range"'),
        ("*TRG", '-211,"Trigger ignored"'),
        ("FETC?", '-230,"Data stale"'),
        ("TRIG:SOUR BUS;:READ?", '-214,"Trigger deadlock"'),
        ("INIT;:INIT", '-213,"Init ignored"'),
    ],
)
def test_what_does_not_fit_is_refused(line: Line, message: str, error: str) -> None:
    assert line.ask(f"{message};:SYST:ERR?") == error
    assert line.ask("SYST:ERR?") == CLEAN


def test_the_error_queue_holds_twenty(line: Line) -> None:
    line.ask(";:".join(["NONSENSE"] * 25) + ";*OPC?")
    errors = [line.ask("SYST:ERR?") for _ in range(21)]
    assert errors[0] == '-113,"Undefined header"'
    assert errors[19:] == ['-350,"Queue overflow"', CLEAN]


def test_a_burst_takes_its_time_and_is_kept(fixture: Fixture, line: Line) -> None:
    line.ask("VOLT:RANG 1;:VOLT:NPLC 10;:SAMP:COUN 5;:INIT;:SYST:ERR?")
    began_s = fixture.clock.now()
    assert int(line.ask("STAT:OPER:COND?")) & 16
    fixture.clock.sleep(1.0)
    assert int(line.ask("DATA:POIN?")) == 2
    assert line.ask("DATA:LAST?") == "+5.00000000E-01 VDC"
    assert numbers(line.ask("FETC?")) == [0.5] * 5
    # Ten cycles of 50 Hz and the zero after it, five times.
    assert fixture.clock.now() - began_s == pytest.approx(5 * 0.4, abs=0.02)
    assert line.ask("FETC?") == line.ask("FETC?")
    assert not int(line.ask("STAT:OPER:COND?")) & 16
    line.ask("INIT;*OPC?")
    assert line.ask("R? 3").startswith("#247+5.0")
    assert int(line.ask("DATA:POIN?")) == 2
    assert len(numbers(line.ask("DATA:REM? 2"))) == 2
    assert line.ask("FETC?;:SYST:ERR?").startswith("-230")


def test_without_auto_zero_it_is_twice_as_fast_and_drifts(fixture: Fixture, line: Line) -> None:
    line.ask("VOLT:RANG 1;:VOLT:NPLC 10;:VOLT:ZERO:AUTO OFF;:SAMP:COUN 5;*OPC?")
    began_s = fixture.clock.now()
    assert numbers(line.ask("READ?"))[0] == pytest.approx(0.5, abs=1e-7)
    assert fixture.clock.now() - began_s == pytest.approx(5 * 0.2, abs=0.02)
    fixture.clock.sleep(3600.0)
    assert numbers(line.ask("READ?"))[0] - 0.5 == pytest.approx(36e-6, abs=1e-7)
    line.ask("VOLT:ZERO:AUTO ONCE;*OPC?")
    assert numbers(line.ask("READ?"))[0] - 0.5 == pytest.approx(0.0, abs=1e-7)


def test_a_reading_is_the_mean_over_its_integration() -> None:
    with standing(volts=0.0, slope=0.1) as fixture, fixture.line() as line:
        line.ask("VOLT:RANG 1;:VOLT:NPLC 10;:SAMP:COUN 3;*OPC?")
        began_s = fixture.clock.now()
        values = np.array(numbers(line.ask("READ?")))
        # The zero after each reading is no part of it.
        assert values[0] == pytest.approx(0.1 * (began_s + 0.1), abs=5e-4)
        assert np.diff(values) == pytest.approx(0.1 * 0.4, rel=5e-3)


def test_a_trigger_over_the_line_and_a_timer_pace_the_readings(
    fixture: Fixture, line: Line
) -> None:
    line.ask("VOLT:NPLC 1;:TRIG:SOUR BUS;COUN 2;:SAMP:COUN 4;SOUR TIM;TIM 0.1;*OPC?")
    line.ask("INIT;:SYST:ERR?")
    assert int(line.ask("STAT:OPER:COND?")) & 32
    fixture.clock.sleep(1.0)
    assert int(line.ask("DATA:POIN?")) == 0
    line.ask("*TRG;:SYST:ERR?")
    fixture.clock.sleep(0.25)
    assert int(line.ask("DATA:POIN?")) == 3
    fixture.clock.sleep(0.25)
    assert int(line.ask("STAT:OPER:COND?")) & 32
    assert len(numbers(line.ask("*TRG;:FETC?"))) == 8


def test_an_overload_reads_as_one_and_is_told_once_for_a_burst() -> None:
    with standing(volts=-1.3) as fixture, fixture.line() as line:
        line.ask("VOLT:RANG 1;:SAMP:COUN 2;*OPC?")
        assert line.ask("READ?") == "-9.90000000E+37,-9.90000000E+37"
        assert line.ask("STAT:QUES:COND?") == "0"
        assert line.ask("STAT:QUES?") == "1"
        assert line.ask("STAT:QUES?") == "0"
        line.ask("VOLT:RANG 10;*OPC?")
        assert numbers(line.ask("READ?")) == [-1.3, -1.3]
        line.ask("VOLT:RANG:AUTO ON;:VOLT:RANG 1;:VOLT:RANG:AUTO ON;*OPC?")
        assert numbers(line.ask("READ?")) == [-1.3, -1.3]
        assert float(line.ask("VOLT:RANG?")) == 10.0
        assert numbers(line.ask("MEAS:VOLT:DC? 1")) == [-9.9e37]


def test_twenty_percent_beyond_the_range_can_still_be_measured() -> None:
    with standing(volts=1.19) as fixture, fixture.line() as line:
        assert numbers(line.ask("MEAS:VOLT:DC? 1")) == [1.19]


def test_noise_grows_with_the_range_and_falls_with_the_integration() -> None:
    with standing(noise="0.3 ppm") as fixture, fixture.line() as line:
        spread = {}
        for range_V, cycles in ((1, 1), (10, 1), (10, 0.02)):
            line.ask(f"VOLT:RANG {range_V};:VOLT:NPLC {cycles};:SAMP:COUN 2000;:INIT;:SYST:ERR?")
            fixture.clock.sleep(100.0)
            spread[range_V, cycles] = float(np.std(numbers(line.ask("FETC?"))))
        assert spread[1, 1] == pytest.approx(0.3e-6, rel=0.1)
        assert spread[10, 1] == pytest.approx(3e-6, rel=0.1)
        assert spread[10, 0.02] == pytest.approx(30e-6, rel=0.1)


def test_gain_and_offset_of_the_meter_are_in_its_readings() -> None:
    with standing(volts=1.0, gain_error="10 ppm", offset="3 uV") as fixture, fixture.line() as line:
        assert numbers(line.ask("MEAS:VOLT:DC? 1"))[0] == pytest.approx(1.000013, abs=1e-8)


def test_an_open_input_wanders_and_open_ohms_are_an_overload() -> None:
    with standing(room=EmptyRoom()) as fixture, fixture.line() as line:
        line.ask("VOLT:NPLC 1;:SAMP:COUN 2000;:INIT;:SYST:ERR?")
        fixture.clock.sleep(100.0)
        volts = np.array(numbers(line.ask("FETC?")))
        assert np.abs(volts).max() < 20e-3
        assert 0 < volts.std() < 5e-3
        assert numbers(line.ask("MEAS:FRES?")) == [9.9e37]
        assert line.ask("STAT:QUES?") == "512"


def test_while_one_client_waits_for_a_burst_another_is_served() -> None:
    with standing(volts=0.25, clock=RealClock()) as fixture:
        entry = fixture.instruments["multimeter"]
        place = entry["host"], entry["port"]
        with (
            socket.create_connection(place, 2.0) as patient,
            socket.create_connection(place, 2.0) as other,
        ):
            patient.sendall(b"CONF:VOLT:DC 1\nSAMP:COUN 2\nREAD?\n")
            for _ in range(10_000):
                other.sendall(b"STAT:OPER:COND?\n")
                if int(other.recv(4096)) & 16:
                    break
            other.sendall(b"*IDN?\n")
            assert other.recv(4096).startswith(b"Keysight")
            assert not select.select([patient], [], [], 0)[0]
            assert patient.recv(4096) == b"+2.50000000E-01,+2.50000000E-01\n"


def test_a_plain_socket_reads_it_in_real_time() -> None:
    with standing(volts=0.25, clock=RealClock()) as fixture:
        entry = fixture.instruments["multimeter"]
        with socket.create_connection((entry["host"], entry["port"]), 2.0) as client:
            client.sendall(b"CONF:VOLT:DC 1\nVOLT:DC:NPLC 0.02\nREAD?\n")
            assert client.recv(4096) == b"+2.50000000E-01\n"
