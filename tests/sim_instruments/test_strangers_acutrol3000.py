"""What other programs send an ACUTROL3000 every day, and what the controller answers."""

from __future__ import annotations

import struct

import pytest
from table_bench import LIMITED, RawTable, table_bench


@pytest.mark.parametrize(
    ("message", "answer"),
    [
        (":L:A P,1,20.0;:L:A? P,1;:Limit:Acceleration? pos,1", "20.000000;20.000000"),
        (":LIM:H P,1,90.0;L P,1,-90.0;R P,1,9.0;A P,1,50.0;H? P,1;R? P,1", "90.000000;9.000000"),
        (":L:R P,1,30;:L:R? P,1", "30.000000"),
        (":LIM:VTR R,1,100.0;:LIM:VTRip? R,1;:LIM:VTR? P,1", "100.000000;240.000000"),
        (":LIM:HPOS P,1,79.0;:LIM:LPOS S,1,-79.0;:LIM:HPOS? P,1", "79.000000"),
        (":L:V 1,50;:L:V? 1;:L:V? P,1", "50.000000;50.000000"),
        (":L:H 1,80;:L:H? 1;:L:L 1,-80;:L:L? 1", "80.000000;-80.000000"),
        (":D:P 1,10.5;R 1,2;A 1,3;P? 1;R? 1;A? 1", "10.500000;2.000000;3.000000"),
        (":D:O 1,10,2.5,90;:dem:osc? 1", "10.000000;2.500000;90.000000"),
        (":dem:svec 1,5,6;:dem:svec? 1", "5.000000;6.000000"),
        (":dem:del? 1;:dem:del 1,12;:DEM:DEL? 1", "0.000000;12.000000"),
        (
            ":con:osc 1,Enable,2.0000,0.1000,Pos,Lin;:con:osc? 1",
            "Enable;2.000000;0.100000;Position;Linear",
        ),
        (":U:L ON", "OK"),
        (":interlock? 1;:I:O 1;:interlock? 1", "Open;Open"),
        ("*CLS;*ESR?", "0"),
    ],
)  # fmt: skip
def test_letters_and_abbreviations_are_taken(message: str, answer: str) -> None:
    with table_bench({"axis_1": LIMITED}) as bench, RawTable(bench) as line:
        assert line.says(message) == answer


def test_a_stranger_s_session_from_the_interlock_to_rest() -> None:
    """As the clients of a single axis do, by abbreviations."""
    with table_bench({"rate_noise": "0 deg/s"}) as bench, RawTable(bench) as line:
        line.says(":int:reset 1")
        line.says(":I:C 1")
        bench.clock.sleep(1.0)
        assert line.says(":interlock? 1") == "Close"
        line.says(":L:R R,1,40;A R,1,10")
        line.says(":dem:rate 1,20")
        line.says(":mode:rate 1")
        bench.clock.sleep(1.0)
        assert float(line.says("read:acc? 1")) == pytest.approx(10.0, rel=1e-3)
        bench.clock.sleep(5.0)
        position, rate = map(float, line.says(":read:svec? 1").split(";"))
        assert rate == pytest.approx(20.0)
        assert position == pytest.approx(float(line.says(":R:P? 1")), abs=0.2)
        assert int(line.says(":status:esr? A1Dyn,2")) & 1 << 9
        line.says(":dem:pos 1,0")
        line.says(":M:P 1")
        bench.clock.sleep(30.0)
        line.says(":dem:delta 1,90")
        bench.clock.sleep(30.0)
        assert float(line.says(":R:P? 1")) == pytest.approx(90.0, abs=1e-3)
        line.says(":mode all,off")


def test_a_position_beyond_a_turn_wraps_and_query_has_no_commands() -> None:
    with table_bench() as bench, RawTable(bench) as line:
        assert line.says(":D:P 2,400;P? 2;P 2,-370;P? 2") == "40.000000;350.000000"
        assert line.framed(":Query:Error? 5")[1] == "UNKNOWN COMMAND"


def test_a_state_vector_has_two_values() -> None:
    with table_bench() as bench, RawTable(bench) as line:
        assert line.framed(":dem:svec 1,5,6,7")[1] == "SYNTAX ERROR"
        assert line.framed(":dem:svec 1,5")[1] == "MISSING PARAMETER"


def test_errors_are_counted_asked_and_cleared() -> None:
    with table_bench() as bench, RawTable(bench) as line:
        for _ in range(3):
            assert line.framed(":nonsense 1")[0] > 0
        line.framed(":Demand:Rate 7,1")
        assert line.says("*ESR?;*ESR?") == "48;0"
        assert line.says(":Status:STB?;:Status:STB?;*STB?") == "128;128;128"
        assert line.says(":Status:MSG? QERROR,2") == "1:UNKNOWN COMMAND;1:UNKNOWN COMMAND"
        assert line.says(":Status:MSG? QERROR,ALL").endswith("5:PARAMETER OUT OF RANGE")
        line.framed(":nonsense 1")
        line.says(":Status:MSGCLR QERROR")
        assert line.says(":Status:MSG? QERROR;:Status:STB?") == ";0"
        line.framed(":nonsense 1")
        line.says("*CLS")
        assert line.says(":Status:MSG? QERROR;:Status:STB?") == ";0"


def test_a_line_beyond_32768_characters_ends_in_an_error_and_the_next_one_counts() -> None:
    with table_bench() as bench, RawTable(bench) as line:
        command = ":Utility:Lockout ON;"
        assert line.says(command * (32000 // len(command))) == "OK"
        code, text = line.framed(command * (33000 // len(command)))
        assert (code > 0, text) == (True, "MESSAGE TOO LONG")
        assert line.says(":Status:MSG? QERROR") == f"{code}:MESSAGE TOO LONG"
        assert line.says(":Mode? 1") == "Off"


@pytest.mark.parametrize(("prefix", "order"), [("high-byte-first", ">"), ("low-byte-first", "<")])
def test_error_code_and_length_are_words_in_either_order(prefix: str, order: str) -> None:
    with table_bench({"prefix": prefix}) as bench, RawTable(bench) as line:
        for message, code, text in (
            (":Mode? 1", 0, "Off"),
            (":Utility:Lockout ON", 0, "OK"),
            (":Demand:Rate 7,1", 5, "PARAMETER OUT OF RANGE"),
        ):
            answer = line.raw_ask(message.encode("ascii") + b"\r\n")
            assert struct.unpack(f"{order}II", answer[:8]) == (code, len(text))
            assert answer[8:].decode("ascii") == text


def test_a_command_without_an_answer_may_be_answered_by_the_end_of_a_line() -> None:
    with table_bench({"commands_answer": "line-end"}) as bench, RawTable(bench) as line:
        assert line.raw_ask(b":Utility:Lockout ON\r\n") == b"00000002\r\n"
    plain = {"framing": "line", "commands_answer": "line-end"}
    with table_bench(plain) as bench, RawTable(bench) as line:
        assert line.raw_ask(b":Utility:Lockout ON\r\n") == b"\r\n"


def test_numbers_are_rounded_in_and_out() -> None:
    with table_bench({"decimals": 2}) as bench, RawTable(bench) as line:
        assert line.says(":Demand:Rate 1,1.23678;Rate? 1") == "1.24"
        assert bench.simulation._served["turntable"].axes[1].demands.rate == 1.24


def test_positions_are_limited_on_axes_with_end_stops_alone() -> None:
    with table_bench({"axis_1": LIMITED}) as bench, RawTable(bench) as line:
        for axis in (1, 2):
            line.says(f":LIM:HPOS P,{axis},20.0;:LIM:LPOS P,{axis},-20.0")
        assert line.framed(":D:P 1,25")[1] == "PARAMETER OUT OF RANGE"
        assert line.says(":D:P 2,25;P? 2") == "25.000000"
        assert line.framed(":LIM:HPOS P,1,101.0")[1] == "PARAMETER OUT OF RANGE"
