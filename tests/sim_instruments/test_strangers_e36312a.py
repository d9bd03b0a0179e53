"""What other programs send a Keysight E36312A every day, and what the supply answers."""

from __future__ import annotations

from contextlib import AbstractContextManager

import pytest
from fixture import EmptyRoom, Fixture, standing

from sim_instruments.keysight.supply_e36312a import KeysightE36312A

TRUTH = {
    "feeds": "2",
    "resistance": "48 ohm",
    "readback_gain_error": "0 %",
    "readback_offset": "0 A",
}
NO_ERROR = '0,"No error"'


def supply() -> AbstractContextManager[Fixture]:
    return standing("dut_power", KeysightE36312A, TRUTH, EmptyRoom(), serial="MY59002391")


def numbers(answer: str) -> list[float]:
    return [float(text) for text in answer.replace('"', "").replace(";", ",").split(",")]


def test_a_session_of_every_day() -> None:
    with supply() as here, here.line() as line:
        line.write("VOLT 12, (@2)")
        line.write("CURR 0.5, (@2)")
        line.write("OUTPut 1, (@2)")
        assert numbers(line.ask("VOLT? (@2)")) == [12.0]
        assert numbers(line.ask("MEASure:VOLTage? (@2);:MEAS:CURRent? (@2)")) == [12.0, 0.25]
        assert line.ask("OUTPut? (@2);:SYST:ERR?") == f"1;{NO_ERROR}"


@pytest.mark.parametrize(("name", "number"), [("CH1", 1), ("P6V", 1), ("CH2", 2), ("P25V", 2)])
def test_apply_sets_both_levels_and_is_answered_in_quotes(name: str, number: int) -> None:
    with supply() as here, here.line() as line:
        line.write(f"APPL {name},5,0.5")
        assert numbers(line.ask(f"VOLT? (@{number});:CURR? (@{number})")) == [5.0, 0.5]
        answer = line.ask(f"APPL? {name}")
        assert answer.startswith('"') and numbers(answer) == [5.0, 0.5]
        line.write(f"APPL {name},MAX")
        assert numbers(line.ask(f"APPL? CH{number}")) == [6.0 if number == 1 else 25.0, 0.5]
        assert line.ask("APPL CH3,30,1;:SYST:ERR?").startswith("-222")
        assert numbers(line.ask("APPL? CH3"))[0] == 0.0


def test_bounds_are_asked_for_by_output() -> None:
    with supply() as here, here.line() as line:
        assert numbers(line.ask("VOLT? MAX,(@1);:VOLT? MAX,(@2);:CURR? MAX,(@1)")) == [6, 25, 5]
        assert numbers(line.ask("VOLT? MIN,(@1,2);:CURR? MAX,(@1:3)")) == [0, 0, 5, 1, 1]
        assert numbers(line.ask("VOLT:PROT? MAX,(@1)")) == [pytest.approx(6.6)]
        assert line.ask("VOLT? MOST,(@1);:SYST:ERR?").startswith("-108")


@pytest.mark.parametrize(
    ("command", "query", "answer"),
    [
        ("OUTP:PAIR PAR", "OUTP:PAIR?", "PAR"), ("OUTP:PAIR SER", "OUTP:PAIR?", "SER"),
        ("SENS:DLOG:FUNC:CURR ON, (@1:3)", "SENS:DLOG:FUNC:CURR? (@1,2,3)", "1,1,1"),
        ("SENS:DLOG:FUNC:VOLT 0,(@2)", "SENS:DLOG:FUNC:VOLT? (@2)", "0"),
        ("TRIG:DLOG:SOUR BUS", "TRIG:DLOG:SOUR?", "BUS"),
        ("VOLT:PROT:STAT OFF,(@1)", "VOLT:PROT:STAT? (@1)", "0"),
        ("INST:SEL CH2", "INST:NSEL?", "2"), ("INST:NSEL 3", "INST:SEL?", "CH3"),
        ("TRIG:SOUR BUS", "TRIG:SOUR?", "BUS"), ('DISP:TEXT "RUN"', "DISP:TEXT?", '"RUN"'),
    ],
)  # fmt: skip
def test_words_are_kept_until_a_reset(command: str, query: str, answer: str) -> None:
    with supply() as here, here.line() as line:
        before = line.ask(query)
        assert before != answer
        assert line.ask(f"{command};:SYST:ERR?") == NO_ERROR
        assert line.ask(query) == answer
        line.write("*RST")
        assert line.ask(query) == (answer if command.startswith("DISP") else before)


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ("APPL CH4,1,1", -224), ("APPL", -109), ("APPL CH1,1,1,1", -108),
        ("OUTP:PAIR TRAC", -224), ("SENS:DLOG:PER 0.1", -222), ("*TRG", -211),
        ("VOLT:TRIG 30,(@2)", -222), ("INST:NSEL 4", -222), ("ABOR (@4)", -222),
        ("INIT:DLOG log", -151), ("LIST:VOLT 1,2,(@1)", -113),
    ],
)  # fmt: skip
def test_what_the_supply_cannot_do_is_its_error(wrong: str, code: int) -> None:
    with supply() as here, here.line() as line:
        assert line.ask(f"{wrong};:SYST:ERR?").startswith(f"{code},")
        assert line.ask("SYST:ERR?") == NO_ERROR


def test_a_trip_is_cleared_by_its_own_command() -> None:
    with supply() as here, here.line() as line:
        line.write("APPL CH2,24,0.1;:CURR:PROT:STAT 1,(@2);:CURR:PROT:DEL 0,(@2);:OUTP 1,(@2)")
        here.clock.sleep(0.1)
        assert line.ask("CURR:PROT:TRIP? (@2);:OUTP? (@2)") == "1;0"
        line.write("VOLT:PROT:CLE (@2)")
        assert line.ask("CURR:PROT:TRIP? (@2)") == "1"
        line.write("CURR:PROT:CLE (@2);:CURR 1,(@2);:OUTP 1,(@2)")
        assert line.ask("CURR:PROT:TRIP? (@2);:OUTP? (@2)") == "0;1"


def test_without_its_protection_an_output_goes_beyond_the_level() -> None:
    with supply() as here, here.line() as line:
        line.write("VOLT:PROT 5,(@1);:VOLT:PROT:STAT OFF,(@1);:VOLT 6,(@1);:OUTP 1,(@1)")
        assert line.ask("OUTP? (@1);:VOLT:PROT:TRIP? (@1)") == "1;0"
        line.write("VOLT:PROT:STAT ON,(@1)")
        assert line.ask("OUTP? (@1);:VOLT:PROT:TRIP? (@1)") == "0;1"


def test_levels_wait_for_their_trigger_and_abort_ends_the_wait() -> None:
    with supply() as here, here.line() as line:
        line.write("TRIG:SOUR BUS;:VOLT:TRIG 3,(@1);:INIT (@1)")
        assert numbers(line.ask("VOLT? (@1);:VOLT:TRIG? (@1)")) == [0.0, 3.0]
        line.write("*TRG")
        assert numbers(line.ask("VOLT? (@1)")) == [3.0]
        line.write("INIT (@1);:ABOR (@1);*TRG")
        assert line.ask("SYST:ERR?").startswith("-211")


def test_the_selected_output_is_meant_where_none_is_listed() -> None:
    with supply() as here, here.line() as line:
        line.write("INST:SEL P25V;:VOLT 24;:CURR 1;:OUTP ON")
        assert numbers(line.ask("VOLT? (@2);:MEAS:CURR?")) == [24.0, 0.5]
        assert line.ask("STAT:QUES:INST:ISUM2:COND?;:STAT:QUES:INST:ISUM1:COND?") == "2;0"
        line.write("CURR 0.1")
        assert line.ask("STAT:QUES:INST:ISUM2:COND?") == "1"
