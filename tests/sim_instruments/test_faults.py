"""Each fault on the wire as a raw client of the instrument sees it, and how one is asked for."""

from __future__ import annotations

import json
import socket
import struct
from typing import Any

import pytest
from sim_bench import BOARD, START, STOP, SUPPLY, RawLine, board_with, counts, faulty, line_with

from sim_instruments.faults.catalogue import applicable_faults
from sim_instruments.kepco.bop import KepcoBop
from sim_instruments.truth import SimulationError


def test_a_reply_is_lost_after_its_command_was_carried_out() -> None:
    with line_with(SUPPLY, fault="no-reply", command="CURR 1") as (line, _):
        line.ask("FUNC:MODE CURR;*OPC?")
        assert line.bytes_of("CURR 1;CURR?") is None
        assert float(line.ask("CURR?")) == pytest.approx(1.0, abs=1e-3)


def test_a_command_is_lost_before_it_is_carried_out() -> None:
    with line_with(SUPPLY, fault="lost-command", command="CURR 1") as (line, _):
        line.ask("FUNC:MODE CURR;*OPC?")
        assert line.bytes_of("CURR 1;CURR?") is None
        assert float(line.ask("CURR?")) == 0.0


def test_the_nth_message_is_met_as_often_as_the_entry_says() -> None:
    entry = {"fault": "no-reply", "command": "meas:curr?", "nth": 2, "count": 2}
    with line_with(SUPPLY, **entry) as (line, bench):
        came = [line.bytes_of("MEAS:CURR?") is not None for _ in range(5)]
        assert line.bytes_of("*IDN?") is not None
        (fault,) = bench.simulation_report()["faults"]
    assert came == [True, False, False, True, True]
    assert fault["struck"] == 2


def test_a_time_decides_which_messages_are_met() -> None:
    with line_with(SUPPLY, fault="no-reply", **{"at": "10 s", "for": "2 s"}) as (line, _):
        clock = line._clock
        came = {}
        for time_s in (9.0, 10.5, 11.5, 12.5):
            clock.sleep_until(time_s)
            came[time_s] = line.bytes_of("*IDN?", within_s=0.1) is not None
    assert came == {9.0: True, 10.5: False, 11.5: False, 12.5: True}


def test_a_late_reply_comes_after_its_delay_and_the_next_one_behind_it() -> None:
    with line_with(SUPPLY, fault="late", command="*IDN?", delay="2 s") as (line, _):
        clock = line._clock
        assert line.bytes_of("*IDN?", within_s=1.0) is None
        assert line.bytes_of("OUTP?", within_s=0.5) is None
        both = line.what_comes(5.0)
        assert clock.now() == pytest.approx(2.0 + KepcoBop.command_s)
        both = (both or b"") + ((line.what_comes(0.1) or b"") if both.count(b"\n") < 2 else b"")
    assert both.startswith(b"KEPCO") and both.endswith(b"\n0\n")


def test_a_late_reply_never_reaches_a_new_connection() -> None:
    with faulty({"instrument": SUPPLY, "fault": "late", "command": "*IDN?"}) as (clock, bench):
        with RawLine(bench, SUPPLY, clock) as first:
            assert first.bytes_of("*IDN?", within_s=0.5) is None
        with RawLine(bench, SUPPLY, clock) as second:
            clock.sleep(5.0)
            assert second.ask("OUTP?") == "0"


@pytest.mark.parametrize(
    ("fault", "seen"),
    [
        ("partial", b'0,"No '),
        ("wrong-terminator", b'0,"No error"\r'),
        ("previous-reply", b"KEPCO,BIT 802E 36-12,H148202,1.15-1.80\n"),
    ],
)
def test_a_reply_is_changed_on_the_wire(fault: str, seen: bytes) -> None:
    with line_with(SUPPLY, fault=fault, command="SYST:ERR?") as (line, _):
        line.ask("*IDN?")
        assert line.bytes_of("SYST:ERR?") == seen
        assert line.ask("SYST:ERR?") == '0,"No error"'


def test_the_first_reply_of_all_has_none_before_it() -> None:
    with line_with(SUPPLY, fault="previous-reply") as (line, _):
        assert line.bytes_of("*IDN?") is None


def test_garbled_bytes_are_no_text_and_the_same_in_every_execution() -> None:
    seen = []
    for _ in range(2):
        with line_with(SUPPLY, fault="garbled") as (line, _bench):
            seen.append(line.bytes_of("*IDN?"))
    assert seen[0] == seen[1]
    assert seen[0] is not None and seen[0].endswith(b"\n") and not seen[0].isascii()


@pytest.mark.parametrize(
    ("text", "option"), [("NaN", {}), ("9.91E37", {"text": "9.91E37"})], ids=["nan", "scpi"]
)
def test_a_measured_value_is_no_number_and_other_replies_stay(
    text: str, option: dict[str, str]
) -> None:
    with line_with(SUPPLY, fault="nan", **option) as (line, _):
        assert line.ask("OUTP?") == "0"
        assert line.ask("MEAS:CURR?") == text
        assert float(line.ask("MEAS:CURR?")) == pytest.approx(0.0, abs=0.01)


def test_a_dropped_connection_ends_and_a_new_one_is_served() -> None:
    entry = {"instrument": SUPPLY, "fault": "dropped-connection", "command": "MEAS"}
    with faulty(entry) as (clock, bench):
        with RawLine(bench, SUPPLY, clock) as line:
            assert line.bytes_of("MEAS:CURR?") == b""
            # Time goes on although nobody answers on a line that is gone.
            assert line.bytes_of("*IDN?") == b""
        with RawLine(bench, SUPPLY, clock) as line:
            assert line.ask("OUTP?") == "0"


def test_a_port_is_gone_for_a_while() -> None:
    entry = {"instrument": SUPPLY, "fault": "port-gone", "at": "5 s", "for": "3 s"}
    with faulty(entry) as (clock, bench):
        address = (bench.instruments[SUPPLY]["host"], bench.instruments[SUPPLY]["port"])
        with RawLine(bench, SUPPLY, clock) as line:
            clock.sleep_until(5.5)
            assert line.bytes_of("*IDN?") == b""
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(address)
        with pytest.raises(OSError, match="in use"), socket.socket() as another:
            another.bind(address)
            another.listen()
        clock.sleep_until(8.5)
        with RawLine(bench, SUPPLY, clock) as line:
            assert line.ask("OUTP?") == "0"


def test_a_lost_frame_leaves_a_gap_in_the_sequence() -> None:
    entry = {"fault": "lost-frame", "command": 0x121, "nth": 10, "count": 3}
    with board_with(**entry) as (clock, bench, board):
        board.command(START, mask=1, interval_ms=10)
        clock.sleep(1.0)
        sequence = counts(board, bench)[:, 0]
    assert [int(n) for n in sequence[8:10]] == [9, 13]


def test_a_lost_command_frame_is_never_acknowledged() -> None:
    with board_with(fault="lost-frame", command="0x100") as (_, _bench, board):
        with pytest.raises(AssertionError, match="no acknowledgement"):
            board.command(STOP)
        assert board.command(STOP) == 0


def test_a_command_frame_can_be_carried_out_without_a_reply() -> None:
    with board_with(fault="no-reply", command=0x100) as (clock, _bench, board):
        with pytest.raises(AssertionError, match="no acknowledgement"):
            board.command(START, mask=1, interval_ms=10)
        clock.sleep(1.0)
        assert len(board.of(0x121)) > 100


def test_frames_come_late_short_or_garbled() -> None:
    frame = struct.pack("<BBIH", STOP, 0, 0, 7)
    with board_with(fault="late", command=0x101, delay="2 s") as (clock, _bench, board):
        board.send(0x100, frame)
        clock.sleep(1.9)
        assert board.of(0x101) == []
        clock.sleep(0.2)
        (whole,) = board.of(0x101)
    for fault in ("partial", "garbled"):
        with board_with(fault=fault, command=0x101) as (clock, _bench, board):
            board.send(0x100, frame)
            clock.sleep(0.1)
            (seen,) = board.of(0x101)
        assert seen == whole[:4] if fault == "partial" else seen != whole


def test_a_fault_is_injected_while_the_bench_serves_and_reported() -> None:
    with faulty() as (clock, bench), RawLine(bench, SUPPLY, clock) as line:
        assert line.ask("OUTP?") == "0"
        said = bench.answer('{"instrument": "coil_supply.y", "fault": "no-reply"}')
        assert said.startswith("coil_supply.y: no-reply injected at ")
        assert line.bytes_of("OUTP?") is None
        told = json.loads(bench.answer("report"))
        assert [fault["struck"] for fault in told["faults"]] == [1]
        assert "has no key 'dealy'" in bench.answer(
            "{instrument: gaussmeter, fault: late, dealy: 2 s}"
        )
        assert bench.answer("{instrument").startswith("not injected: ")
        assert bench.answer("now").startswith("not injected: ")
        assert "report" in bench.answer("help")
        assert "{instrument: coil_supply.x, fault:" in bench.answer("help")
        assert len(bench.answer("[" + 5000 * "x")) < 400


WRONG = [
    ({"fault": "late"}, "'instrument' is missing"),
    ({"instrument": "gausmeter", "fault": "late"}, "no simulated instrument 'gausmeter'"),
    ({"instrument": "dut_power", "fault": "late"}, "no simulated instrument 'dut_power'"),
    ({"instrument": SUPPLY, "fault": "lost-frame"}, "cannot have the fault 'lost-frame'"),
    ({"instrument": SUPPLY, "fault": "overload"}, "cannot have the fault 'overload'"),
    ({"instrument": SUPPLY, "fault": "late", "delay": 2}, "a number with its unit was expected"),
    ({"instrument": SUPPLY, "fault": "late", "delay": "2 V"}, "delay"),
    ({"instrument": SUPPLY, "fault": "late", "delay": "-2 s"}, "must be positive"),
    ({"instrument": SUPPLY, "fault": "frozen", "count": 2}, "has no key 'count'"),
    ({"instrument": SUPPLY, "fault": "late", "at": "-1 s"}, "bench time begins at 0 s"),
    ({"instrument": SUPPLY, "fault": "late", "for": "0 s"}, "must be positive"),
    ({"instrument": SUPPLY, "fault": "late", "nth": 0}, "at least 1"),
    ({"instrument": BOARD, "fault": "late", "command": "START"}, "a CAN identifier"),
    ("late", "a mapping was expected"),
]


@pytest.mark.parametrize(("entry", "sentence"), WRONG, ids=[what for _, what in WRONG])
def test_a_wrong_fault_is_one_sentence_that_says_where(entry: Any, sentence: str) -> None:
    with pytest.raises(SimulationError) as raised, faulty(entry):
        pass
    assert sentence in str(raised.value)
    assert str(raised.value).startswith("simulation.faults[1]")
    assert "\n" not in str(raised.value)


def test_a_campaign_can_ask_which_faults_an_instrument_can_have() -> None:
    supply = applicable_faults("scpi", "kepco-bop-36-12")
    board = applicable_faults("socketcand", "can-pulse-board")
    assert {"no-reply", "wrong-terminator", "port-gone", "compliance", "list-refused"} <= set(
        supply
    )
    assert {"lost-frame", "port-gone", "silent", "dark"} <= set(board)
    assert not {"wrong-terminator", "nan", "compliance"} & set(board)
    assert "overload" in applicable_faults("scpi", "lakeshore-f71")
    assert applicable_faults("scpi", "operator-power") == []
    # Each can be injected with nothing but its name.
    with faulty() as (_, bench):
        for kind in supply:
            bench.inject({"instrument": SUPPLY, "fault": kind, "at": "1000 h"})
        for kind in board:
            bench.inject({"instrument": BOARD, "fault": kind, "command": 0x100, "nth": 99})
