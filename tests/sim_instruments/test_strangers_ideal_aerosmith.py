"""What the public clients of an Ideal Aerosmith table send, and what it answers them."""

from __future__ import annotations

import math
import re

import pytest
from aerosmith_bench import THREE, Bench, RawTable, aerosmith_bench


def lines(answer: bytes) -> list[bytes]:
    """Return an answer as a client reads it that ends a line with each CR."""
    return [line.strip() for line in answer.split(b"\r")[:-1]]


def on(bench: Bench, line: RawTable) -> None:
    """Switch the motor on."""
    assert line.says(b"SRV1\r") == b"\r\n>\r\n"
    bench.clock.sleep(1.0)


def test_the_test_suite_of_an_imu_homes_and_polls_the_position() -> None:
    """It ends commands with CR, reads to the prompt, and takes `?` for a refusal."""
    with aerosmith_bench({"complete": "0"}) as bench, RawTable(bench) as line:
        on(bench, line)
        for command in (b"STO", b"HOM"):
            answer = line.says(command + b"\r")
            assert b">" in answer
            assert b"?" not in answer
        bench.clock.sleep(0.1)
        assert line.says(b"MCO5\r") == b"1\r\n>\r\n"
        bench.clock.sleep(10.0)
        assert line.says(b"MCO5\r") == b"0\r\n>\r\n"
        for command in (b"PZR", b"AMP20", b"FRQ0.3", b"CYC54", b"SGO", b"P0"):
            assert b"?" not in line.says(command + b"\r")
        assert b"?" in line.says(b"SOS-1\r")
        text = line.says(b"PPO\r").decode().replace(">", "").strip()
        assert math.remainder(float(text), 360.0) == pytest.approx(0.0, abs=1e-3)


def test_the_rate_sweep_of_an_incoming_inspection_turns_either_way() -> None:
    """It ends commands with CR LF, reads a line and a prompt, and JOG answers nothing."""
    with (
        aerosmith_bench({"acknowledges": "no-motion", "rate_noise": "0 deg/s"}) as bench,
        RawTable(bench) as line,
    ):
        on(bench, line)
        for rate in (-100, 100):
            line._send(b"JOG%d\r\n" % rate)
            bench.clock.sleep(20.0)
            assert lines(line.says(b"STA\r\n"))[1] == b">"
            value, prompt = lines(line.says(b"PVE\r\n"))
            assert (float(value), prompt) == (pytest.approx(rate, rel=1e-4), b">")
        line._send(b"STO")  # as it is sent there, without the end of a line
        bench.clock.sleep(20.0)
        assert not bench.table.energised()
        for command in (b"ACL20", b"DIR1", b"HOF0.500000", b"VEL30", b"SAV", b"ZER0"):
            assert lines(line.says(command + b"\r\n"))[-2:] == [b"", b">"]
        line.says(b"MOV10\r\n")
        assert lines(line.says(b"MCO1\r\n"))[0] == b"0"
        bench.clock.sleep(10.0)
        assert lines(line.says(b"MCO1\r\n"))[0] == b"1"
        line.says(b"RMO-20\r\n")
        bench.clock.sleep(10.0)
        value, prompt = lines(line.says(b"PPO\r\n"))
        assert float(value) == pytest.approx(350.0, abs=1e-3)


def test_sto_may_stand_before_another_command_without_an_end_between() -> None:
    with aerosmith_bench() as bench, RawTable(bench) as line:
        on(bench, line)
        line.says(b"JOG30\r\n")
        bench.clock.sleep(2.0)
        assert line.says(b"STOPPO\r\n").count(b">") == 2
        bench.clock.sleep(2.0)
        assert not bench.table.energised()


def test_the_control_panel_of_a_1270vs_gets_the_end_that_it_waits_for() -> None:
    """It compares a command's whole answer with CR LF `>` CR LF, and asks by `?`."""
    with aerosmith_bench() as bench, RawTable(bench) as line:
        on(bench, line)
        for command in (b"JOG60", b"JOG-60", b"ACL50.0", b"CLU3", b"CAL1", b"STO", b"HOM"):
            assert line.says(command + b"\r") == b"\r\n>\r\n"
        assert line.says(b"SRV?\r") == b"1\r\n>\r\n"
        assert line.says(b"ACL?\r").endswith(b"\r\n>\r\n")
        assert line.says(b"JOG361\r") == b"?\r\n>\r\n"


@pytest.mark.parametrize("command", [b"4PPO", b"PPO1", b"JOG", b"JOGx", b"SRV2", b"VEL0", b"XYZ"])
def test_what_it_does_not_know_is_refused(command: bytes) -> None:
    with aerosmith_bench(THREE) as bench, RawTable(bench) as line:
        assert line.says(command + b"\r") == b"?\r\n>\r\n"


def test_a_digit_names_the_axis_of_a_table_that_has_several() -> None:
    with aerosmith_bench(THREE) as bench, RawTable(bench) as line:
        line.says(b"3SRV1\r")
        assert [line.says(b"%dSRV?\r" % n)[:1] for n in (1, 2, 3)] == [b"0", b"0", b"0"]
        bench.clock.sleep(1.0)
        assert [line.says(b"%dSRV?\r" % n)[:1] for n in (1, 2, 3)] == [b"0", b"0", b"1"]
        assert line.says(b"SRV?\r")[:1] == b"0"
    with aerosmith_bench() as bench, RawTable(bench) as line:
        assert line.says(b"1PPO\r") == b"?\r\n>\r\n"


def test_echoes_and_whole_rates() -> None:
    truth = {"echoes": True, "whole_rates": True}
    with aerosmith_bench(truth) as bench, RawTable(bench) as line:
        line.says(b"SRV1\r")
        bench.clock.sleep(1.0)
        assert re.fullmatch(rb"PPO\r[\d.]+\r\n>\r\n", line.says(b"PPO\r"))
        assert b"?" in line.says(b"JOG0.5\r")
        assert line.says(b"JOG5\r") == b"JOG5\r\r\n>\r\n"
