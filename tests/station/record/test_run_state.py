"""The state of a run as one fold of its log."""

from __future__ import annotations

from typing import Any

import pytest

from station.record.events import Event, rest_in_words
from station.record.run_state import RunState

STEP = {"step": "S4", "title": "Record", "expected_s": 80.0}
UNITS = [f"axis {number}" for number in range(8)]
PLANNED = {
    "speed": 1.0,
    "steps": [STEP],
    "units": UNITS,
    "units_expected": dict.fromkeys(UNITS, 10.0),
}


def log(*entries: tuple[float, str] | tuple[float, str, dict[str, Any]]) -> list[Event]:
    return [Event(time_s, kind, *(rest or [{}])) for time_s, kind, *rest in entries]


def test_the_time_of_a_pause_is_no_progress() -> None:
    paused = log((1.0, "step-started", STEP), (3.0, "paused"))
    assert RunState(paused).state(held=True) == "paused"
    assert RunState(paused).process.paused_s(1.0, 10.0) == 7.0
    went_on = [*paused, *log((5.0, "went-on"), (6.0, "paused"), (8.0, "failed", {"message": "x"}))]
    process = RunState(went_on).process
    assert RunState(went_on).state(held=True) == "running"
    assert process.paused_s(0.0, 20.0) == 4.0
    assert process.paused_s(4.0, 20.0) == 3.0
    assert process.paused_s(0.0, 4.0) == 1.0


def test_a_long_pause_between_two_units_does_not_slow_the_pace() -> None:
    finished = [(10.0 * n, "unit-finished", {"unit": UNITS[n - 1]}) for n in range(1, 4)]
    later = [(60.0 * 60 + 40.0, "unit-finished", {"unit": UNITS[3]})]
    begins = log((0.0, "run-started", PLANNED), (0.0, "step-started", STEP))
    pause = log((30.0, "paused"), (60.0 * 60 + 30.0, "went-on"))
    run = RunState([*begins, *log(*finished), *pause, *log(*later)])
    assert run.remaining_s(60.0 * 60 + 40.0) == pytest.approx(40.0)


def test_what_a_driver_notes_of_its_line_is_no_message_to_a_person() -> None:
    begun = log((0.0, "run-started", PLANNED), (1.0, "step-started", {**STEP, "title": "Record"}))
    note = {"instrument": "interlock_chain", "noted_s": 1.5, "took_s": 0.2}
    assert RunState([*begun, *log((2.0, "answer-time", note))]).message() == "S4 began: Record"


def test_what_a_resumed_run_left_unfinished_is_of_the_process_before() -> None:
    before = log(
        (0.0, "run-started", PLANNED),
        (1.0, "step-started", STEP),
        (2.0, "unit-finished", {"unit": UNITS[0]}),
        (3.0, "prompt-shown", {"id": "mount", "text": "Mount it."}),
        (4.0, "failed", {"message": "the supply is silent"}),
        (5.0, "run-ended", {"complete": False}),
    )
    run = RunState(before)
    assert (run.state(held=False), run.message()) == ("failed", "the supply is silent")
    assert run.open_prompt is None
    resumed = RunState([*before, *log((6.0, "resumed", {"units_finished": UNITS[:1]}))])
    assert (resumed.state(held=True), resumed.state(held=False)) == ("running", "interrupted")
    assert resumed.process.failed is None
    assert list(resumed.units) == UNITS[:1]
    (step,) = resumed.steps()
    assert step == {
        "number": "S4",
        "title": "Record",
        "state": "waits",
        "began_s": None,
        "took_s": None,
        "expected_s": 80.0,
    }


def test_a_log_that_grows_folds_to_what_the_whole_log_does() -> None:
    events = log(
        (0.0, "run-started", PLANNED),
        (1.0, "identified", {"instrument": "coil_supply.x"}),
        (1.0, "step-started", STEP),
        (2.0, "prompt-shown", {"id": "mount", "text": "Mount it."}),
        (3.0, "prompt", {"id": "mount", "text": "Mount it.", "answer": "done"}),
        (9.0, "unit-finished", {"unit": UNITS[0]}),
        (9.5, "paused"),
        (20.0, "safe-state", {"outcomes": [{"instrument": "coil_supply.x", "verified": True}]}),
        (21.0, "run-ended", {"complete": True}),
    )
    growing = RunState()
    for count, event in enumerate(events, start=1):
        growing.add(event)
        whole = RunState(events[:count])
        assert vars(growing) == vars(whole)
        assert growing.remaining_s(event.time_s) == whole.remaining_s(event.time_s)
    assert growing.state(held=False) == "finished"
    assert growing.safe_state() == [{"instrument": "coil_supply.x", "verified": True}]


def test_a_bench_is_called_safe_in_one_sentence_only_where_all_was_read_back() -> None:
    off = {"instrument": "coil_supply.x", "verified": True}
    on = {"instrument": "coil_supply.y", "verified": False}
    table = {"instrument": "turntable", "why": "it was not opened"}
    assert rest_in_words([off], []) == (
        True,
        "the bench is safe, read back from every instrument that can harm",
    )
    assert rest_in_words([off, on], [table]) == (False, "NOT VERIFIED as safe: coil_supply.y")
    verified, sentence = rest_in_words([off], [table])
    assert verified and sentence.startswith("NOT KNOWN to be safe: turntable (it was not opened)")
