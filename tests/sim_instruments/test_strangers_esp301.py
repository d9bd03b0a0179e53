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
