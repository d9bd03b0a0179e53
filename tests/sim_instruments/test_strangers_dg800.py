"""What other programs send a Rigol DG800 every day, and what the unit answers."""

from __future__ import annotations

import struct

import pytest
from generator_fixture import standing

NO_ERROR = '0,"No error"'


def test_apply_takes_a_phase_and_is_answered_in_five_parts() -> None:
    with standing(model="DG822") as here, here.line() as line:
        line.write(":SOUR1:APPL:SIN 1000.000000,2.000000,0.500000,90.000000")
        assert line.ask(":SOUR1:APPL?") == (
            '"SIN,1.000000E+03,2.000000E+00,5.000000E-01,9.000000E+01"'
        )
        assert line.ask(":SOUR1:PHAS?;:OUTP1?") == "9.000000E+01;OFF"
        line.write(":SOUR2:APPL:DC 1,1,1.5;:OUTP2 ON")
        assert line.ask(":SOUR2:FUNC?;:SOUR2:VOLT:OFFS?") == "DC;1.500000E+00"
        assert here.volts("y") == [pytest.approx(3.0)]
        line.write(":SOUR1:APPL:NOIS 1.000000,0.100000")
        assert line.ask(":SOUR1:APPL?").startswith('"NOISE,')
        line.write(":SOUR1:APPL:PULS 1e3")
        assert line.ask(":SOUR1:APPL?").startswith('"PULSE,1.000000E+03,5.000000E+00,')
        line.write(":SOUR1:FUNC:SQU:DCYC 20;:SOUR1:BURS ON;:SOUR1:APPL:SQU 1e3,1,0,0")
        assert line.ask(":SOUR1:FUNC:SQU:DCYC?;:SOUR1:BURS?") == "5.000000E+01;OFF"
        assert line.ask("SYST:ERR?") == NO_ERROR
        assert line.ask(":APPL:SIN 1,1,1,1,1;:SYST:ERR?").startswith("-108")


def test_an_open_end_and_the_bounds_of_a_load() -> None:
    with standing(model="DG822") as here, here.line() as line:
        line.write(":OUTP1:IMP INF")
        assert line.ask(":OUTP1:IMP?;:OUTP1:LOAD?") == "9.900000E+37;9.900000E+37"
        assert line.ask(":OUTP1:LOAD? MAX;LOAD? MIN") == "1.000000E+04;1.000000E+00"


def test_a_number_that_is_left_out_is_the_first_channel() -> None:
    with standing(model="DG822") as here, here.line() as line:
        line.write("FREQ 2000;:SOUR:VOLT 0.5;:OUTP ON")
        assert line.ask(":SOUR1:FREQ?;:SOUR1:VOLT?;:OUTP1?;:OUTP2?") == (
            "2.000000E+03;5.000000E-01;ON;OFF"
        )


@pytest.mark.parametrize(
    ("header", "value"),
    [
        ("COUN:COUP", "DC"), ("COUN:GATE", "USER2"), ("COUN:LEVE", "1.500000E+00"),
        ("COUN:SENS", "HIG"), ("COUN:HF", "ON"), ("COUP1:FREQ:MODE", "OFFS"),
        ("COUP1:FREQ:DEV", "5.000000E+01"), ("SOUR1:FREQ:COUP:MODE", "OFFS"),
        ("OUTP1:SYNC", "OFF"), ("OUTP2:SYNC:POL", "NEG"), ("SOUR1:BURS:GATE:POL", "INV"),
        ("SOUR1:BURS:INT:PER", "1.000000E-01"), ("SOUR1:BURS:TRIG:TRIGO", "POS"),
        ("SOUR1:BURS:PHAS", "3.000000E+01"), ("SOUR1:BURS:MODE", "INF"),
        ("SOUR1:FREQ:CENT", "6.000000E+02"), ("SOUR1:FUNC:SQU:PER", "2.000000E-03"),
        ("SOUR1:FUNC:SQU:DCYC", "2.000000E+01"), ("SOUR1:HARM:ORDE", "5"),
        ("SOUR1:HARM:TYP", "USER"), ("SOUR1:HARM:USER", "X0010001"), ("SOUR1:HARM", "ON"),
        ("SOUR1:PULS:DCYC", "4.500000E+01"), ("SOUR2:PULS:WIDT", "2.000000E-04"),
        ("SOUR2:PHAS", "4.500000E+01"), ("OUTP1:GAT:POL", "NEG"),
    ],
)  # fmt: skip
def test_what_is_set_is_answered_until_a_reset(header: str, value: str) -> None:
    with standing(model="DG822") as here, here.line() as line:
        before = line.ask(f":{header}?")
        assert line.ask(f":{header} {value};:SYST:ERR?") == NO_ERROR
        assert line.ask(f":{header}?") == value != before
        line.write("*RST")
        assert line.ask(f":{header}?") == before


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (":COUN:LEVE 3", -222), (":COUN RUN", -221), (":COUN:GATE USER7", -224),
        (":SOUR1:HARM:ORDE 9", -222), (":SOUR1:HARM:AMPL 1,1", -222),
        (":SOUR1:HARM:AMPL 2,50", -222), (":SOUR1:HARM:USER X002", -224),
        (":SOUR1:BURS:INT:PER 501", -222), (":SOUR1:PHAS 361", -222),
        (":SOUR1:PULS:DCYC 100", -222), (":SOUR1:FREQ:SPAN 2e3", -222),
        (":SOUR3:FREQ 1", -113), (":SOUR1:DATA:DAC16 VOLATILE,END", -109),
        (":SOUR1:AM:STAT ON", -113),
    ],
)  # fmt: skip
def test_what_the_unit_cannot_do_is_its_error(wrong: str, code: int) -> None:
    with standing(model="DG822") as here, here.line() as line:
        assert line.ask(f"{wrong};:SYST:ERR?").startswith(f"{code},")
        assert line.ask("SYST:ERR?") == NO_ERROR


def test_the_counter_has_nothing_at_its_input() -> None:
    with standing(model="DG822") as here, here.line() as line:
        line.write(":COUN ON;:COUN:AUTO")
        assert line.ask(":COUN?") == "RUN"
        assert {float(v) for v in line.ask(":COUN:MEAS?").split(",")} == {0.0}


def test_coupled_frequencies_follow_one_another() -> None:
    with standing(model="DG822") as here, here.line() as line:
        line.write(":COUP1:FREQ:MODE OFFS;DEV 100;STAT ON;:SOUR1:FREQ 1e3")
        assert line.ask(":SOUR2:FREQ?") == "1.100000E+03"
        line.write(":SOUR2:FREQ 500")
        assert line.ask(":SOUR1:FREQ?") == "4.000000E+02"
        assert line.ask(":COUP1:FREQ:DEV 5;:SYST:ERR?").startswith("-221")


def test_start_stop_centre_and_span_are_two_numbers() -> None:
    with standing(model="DG822") as here, here.line() as line:
        line.write(":SOUR1:FREQ:CENT 1000;SPAN 200")
        assert line.ask(":SOUR1:FREQ:STAR?;STOP?") == "9.000000E+02;1.100000E+03"


def test_a_burst_period_grows_with_its_cycles() -> None:
    with standing(model="DG822") as here, here.line() as line:
        line.write(":SOUR1:FREQ 100;:SOUR1:BURS:NCYC 5")
        assert float(line.ask(":SOUR1:BURS:INT:PER?")) == pytest.approx(0.050002)


def test_harmonics_are_kept_by_their_order() -> None:
    with standing(model="DG822") as here, here.line() as line:
        line.write(":SOUR1:HARM:AMPL 5,1;:SOUR1:HARM:PHAS 5,30")
        assert line.ask(":SOUR1:HARM:AMPL? 5;PHAS? 5;AMPL? 2") == (
            "1.000000E+00;3.000000E+01;1.264700E+00"
        )


def test_points_that_arrive_in_blocks_reach_the_coil() -> None:
    with standing(model="DG822") as here, here.line() as line:
        line.write(":SOUR1:VOLT 2;:OUTP1 ON")
        low, high = (struct.pack("<8H", *[value] * 8) for value in (0x0A0A, 0x3FFF))
        line._send(b":SOUR1:DATA:DAC16 VOLATILE,CON,#216" + low + b"\n")
        line._send(b":SOUR1:DATA:DAC16 VOLATILE,END,#216" + high + b"\n")
        assert line.ask(":SOUR1:FUNC?;:SYST:ERR?") == f"USER;{NO_ERROR}"
        mean = (0x0A0A / 0x3FFF * 2 - 1 + 1) / 2
        assert here.volts("x") == [pytest.approx(2 * mean)]
        line._send(b":SOUR1:DATA:DAC16 VOLATILE,END,#14" + low[:4] + b"\n")
        assert line.ask("SYST:ERR?").startswith("-161")
