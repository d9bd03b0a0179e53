"""A Red Pitaya and a Thorlabs SC10: what other programs send them, and what they answer."""

from __future__ import annotations

import struct

import pytest
from variants import variant

PROCEDURE = "serf-nonorthogonality"


def test_a_board_answers_who_it_is_and_how_it_is_set() -> None:
    with variant("digitizer", PROCEDURE) as here, here.line() as line:
        assert line.ask("SYST:VERS?") == "1999.0"
        assert line.ask("SYST:BRD:ID?") == "0" and "125-14" in line.ask("SYST:BRD:Name?")
        line.write("ACQ:RST")
        line.write("ACQ:DEC 8;:ACQ:TRIG:LEV 0.25;:ACQ:TRIG:DLY:NS 6400")
        assert line.ask("ACQ:TRIG:LEV?") == "0.25"
        assert line.ask("ACQ:TRIG:DLY?") == "100" and line.ask("ACQ:TRIG:DLY:NS?") == "6400"
        assert line.ask("ACQ:DATA:FORMAT?") == "ASCII"


def test_values_are_read_by_place_from_the_oldest_and_up_to_the_latest() -> None:
    with variant("digitizer", PROCEDURE) as here, here.line() as line:
        line.write("ACQ:RST")
        line.write("ACQ:DEC 1024")
        line.write("ACQ:START")
        here.clock.sleep(0.5)
        line.write("ACQ:TRIG NOW")
        here.clock.sleep(0.5)
        assert line.ask("ACQ:TRIG:FILL?") == "1"
        pointer = int(line.ask("ACQ:WPOS?"))

        def values(question: str) -> list[float]:
            return [float(one) for one in line.ask(f"ACQ:SOUR1:{question}")[1:-1].split(",")]

        every = values("DATA?")
        assert len(every) == 16384
        assert values("DATA:OLD:N? 5") == every[:5] and values("DATA:LAT:N? 5") == every[-5:]
        first = (pointer + 1) % 16384
        assert values(f"DATA:STA:N? {first},4") == every[:4]
        assert values(f"DATA:STArt:END? {first},{(first + 3) % 16384}") == every[:4]
        line.write("ACQ:DATA:UNITS RAW")
        raw = values("DATA:OLD:N? 5")
        line.write("ACQ:DATA:FORMAT BIN")
        block = line.raw_ask(b"ACQ:SOUR1:DATA:OLD:N? 5\r\n")
        assert block[:4] == b"#210" and list(struct.unpack(">5h", block[4:14])) == raw
        line.write("ACQ:DATA:UNITS VOLTS")
        block = line.raw_ask(b"ACQ:SOUR1:DATA:OLD:N? 5\r\n")
        assert block[:4] == b"#220" and block[24:] == b"\r\n"
        assert list(struct.unpack(">5f", block[4:24])) == pytest.approx(every[:5], abs=1e-6)
        assert all(one == int(one) for one in raw)
        assert raw == pytest.approx([8192 * one for one in every[:5]], abs=0.6)


def test_a_level_that_never_comes_is_waited_for() -> None:
    with variant("digitizer", PROCEDURE) as here, here.line() as line:
        line.write("ACQ:RST")
        line.write("ACQ:DEC 1024")
        line.write("ACQ:TRIG:LEV 5")
        line.write("ACQ:START")
        line.write("ACQ:TRIG CH1_PE")
        here.clock.sleep(0.5)
        assert line.ask("ACQ:TRIG:STAT?") == "WAIT"
        line.write("ACQ:TRIG:LEV -5;:ACQ:TRIG CH1_NE")
        assert line.ask("ACQ:TRIG:STAT?") == "WAIT"


@pytest.mark.parametrize(("form", "before"), [("worded", "Command error "), ("bare", "")])
def test_the_shutter_refuses_what_it_does_not_know_and_capitals(form: str, before: str) -> None:
    with variant("pump_laser", PROCEDURE, errors=form) as here, here.line() as line:

        def ask(text: str) -> list[str]:
            return line.raw_ask(text.encode() + b"\r").decode().split("\r")

        assert ask("nonsense") == ["nonsense", f"{before}CMD_NOT_DEFINED", "> "]
        assert ask("ID?") == ["ID?", f"{before}CMD_NOT_DEFINED", "> "]
        assert ask("rep=100") == ["rep=100", f"{before}CMD_ARG_INVALID", "> "]
        assert "interlock?" in ask("?") and ask("interlock?")[1] == "0"
        ask("rep=7")
        ask("savp")
        ask("rep=9")
        ask("resp")
        assert ask("rep?")[1] == "7"
        assert ask("open=999999") == ["open=999999", "> "] and ask("xto=1") == ["xto=1", "> "]
