"""A Newport ESP301 as other programs use it: waits, blanks, queries without a question mark."""

from __future__ import annotations

import math

import pytest
from stage_bench import RawStage, stage_bench


def test_the_rest_of_a_line_waits_for_the_movement() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        line.tell("1MO")
        began_s = bench.clock.now()
        (answer,) = line.lines("1PA6;1WS;1TP?")
        assert float(answer) == pytest.approx(6.0, abs=1e-3)
        took_s = bench.clock.now() - began_s
        braking = 2.0 * math.sqrt(6.0 / 80.0)
        assert took_s == pytest.approx(braking + 0.3, abs=0.01), "the movement, and settling"
        assert line.lines("1PA0;1MD?") == ["0"], "nothing waits by itself"
        assert line.lines("1WS500;1MD?") == ["1"]


def test_lines_behind_a_wait_wait_too_and_are_carried_out_in_order() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        line.tell("1MO;1PA6;1WS250")
        line.tell("1PA-6;1WS")
        (answer,) = line.lines("1TP?")
        assert float(answer) == pytest.approx(-6.0, abs=1e-3)
        began_s = bench.clock.now()
        assert line.lines("1MD?;1WT750;TE?") == ["1"]
        assert line.more() == ["0"]
        assert bench.clock.now() - began_s == pytest.approx(0.75, abs=0.05)
        assert line.lines("WT10;1WT;1WS-1;TE?") == ["38"] and line.code() == 101


def test_blanks_lower_case_zeros_and_a_missing_question_mark_are_no_errors() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        line.tell("1mo; 01 pa 5 ;01ws")
        assert line.value(" 1 tp ") == pytest.approx(5.0, abs=1e-3)
        assert line.value("1MD") == 1 and line.value("1TP") == pytest.approx(5.0, abs=1e-3)
        assert line.lines("01id") == ["URS100BPP, SNB1234"]
        assert line.code() == 0


def test_a_stop_of_an_axis_without_a_stage_is_no_error() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        for text, code in (("2ST", 0), ("3ST", 0), ("4ST", 9), ("2PA1", 208), ("2TP?", 208)):
            line.tell(text)
            assert line.code() == code, text


def test_a_line_of_81_characters_moves_nothing_though_it_begins_with_a_wait() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        line.tell("1MO;1WS;1PA0.".ljust(80, "0"))
        assert line.code() == 0
        line.tell("1MO;1WS;1PA5.".ljust(81, "0"))
        assert line.lines("TE?;1DP?") == ["7", "0.000000"]


def test_what_is_set_up_of_a_stage_is_kept() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        line.tell("1ZB1FH;1ZH24H;1SU0.001;1FR0.1;1QS50;SM;LC1")
        asked = "1ZB?;1ZH?;1SU?;1FR?;1QS?;PH;1ID?"
        shown = ["1FH", "24H", "0.001000000", "0.100000000", "50", "0H, 0H", "URS100BPP, SNB1234"]
        assert line.lines(asked) == shown
        for wrong, code in (("1ZB", 38), ("1ZHXH", 7), ("1QS251", 101), ("1SU0", 101)):
            line.tell(wrong)
            assert line.code() == code, wrong
        line.tell("ZB?")
        assert line.code() == 37


def test_settings_of_trajectory_servo_and_motor_are_kept_within_their_ranges() -> None:
    with stage_bench() as bench, RawStage(bench) as line:
        kept = {"JK": 320, "JH": 4, "JW": 0.5, "VB": 0.25, "FE": 2, "QI": 1.5, "QV": 24, "AE": 500}
        kept |= {"KP": 12.5, "KI": 3, "KD": 4, "KS": 0.5, "AF": 6, "VF": 7}
        for name, value in kept.items():
            line.tell(f"1{name}{value}")
            assert line.code() == 0 and line.value(f"1{name}?") == pytest.approx(value), name
        line.tell("1QM3;1TJ1;1FP6;1UF")
        assert line.lines("1QM?;1TJ?;1FP?;1DH?") == ["3", "1", "6", "0.000000"]
        for wrong, code in (
            ("1TJ7", 101),
            ("1TJ1.5", 101),
            ("1QM5", 101),
            ("1FP8", 101),
            ("1KP-1", 101),
            ("1KS1.1", 101),
            ("1JH1E6", 110),
            ("1JW5", 101),
            ("1VB1E6", 101),
            ("1JK", 38),
            ("JK1", 37),
            ("2JK1", 208),
        ):
            line.tell(wrong)
            assert line.code() == code, wrong
        assert line.lines("1QM?;1TJ?;1FP?") == ["3", "1", "6"]


def braking_deg(end: str) -> float:
    """Return how far the stage turns after an end of its movement at full rate."""
    with stage_bench() as bench, RawStage(bench) as line:
        line.tell("1MO;1AG10;1AE10000;1PA200")
        bench.clock.sleep(5.0)
        assert line.value("1TV?") > 1.0
        began, _ = line.lines(f"1TP?;{end};1MD?")
        bench.clock.sleep(20.0)
        return line.value("1TP?") - float(began)


def test_an_abort_brakes_harder_than_a_stop() -> None:
    assert 0.0 < 20.0 * braking_deg("AB") < braking_deg("1ST")
