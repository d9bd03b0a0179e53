"""Faults under a whole run: what the operator is told, and that the simulated world ends safe.

The oracle is the world itself, which asks no driver (`SimulatedBench.simulation_report`).
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest
from faulted_runs import Entry, is_safe, run_with
from tiers import quick

from station.record.folder import RunFolder

SUPPLY, GAUSSMETER, BOARD = "coil_supply.y", "gaussmeter", "gyro_acquisition"
COUNTS, COMMAND = 0x121, 0x100


def entry(instrument: str, fault: str, **when: Any) -> Entry:
    return {"instrument": instrument, "fault": fault, **when}


WHILE_RECORDING: Entry = {"at": "120 s"}
ENDS_WITH_A_SENTENCE = [
    (entry(SUPPLY, "no-reply", command="*IDN?"), "coil_supply.y: sent '*IDN?': no answer came"),
    (entry(SUPPLY, "late", command="LIST:CURR ", nth=5), "coil_supply.y: sent 'LIST:CURR "),
    (entry(SUPPLY, "garbled", command="STAT:OPER"), "which is no text"),
    (entry(SUPPLY, "partial", command="OUTP ON"), "without the end of an answer"),
    (entry(SUPPLY, "lost-command", command="CURR:MODE LIST"), "coil_supply.y: sent 'CURR:MODE"),
    (entry(SUPPLY, "nan", command="MEAS:CURR?", count=99), "'NaN' came back where a number"),
    (entry(SUPPLY, "list-refused", at="0 s"), "'CURR:MODE LIST': it refused with -221"),
    (
        entry(SUPPLY, "dropped-connection", command="OUTP ON"),
        "'OUTP ON;:SYST:ERR?': the line broke (the other side closed the connection); check",
    ),
    (
        entry(BOARD, "dropped-connection", command=COMMAND),
        "used the CAN bus: the line broke (the other side closed the connection)",
    ),
    (
        entry(GAUSSMETER, "wrong-terminator", command="SENS:RANG 0"),
        "gaussmeter: sent 'SENS:RANG",
    ),
    (entry(GAUSSMETER, "previous-reply", **WHILE_RECORDING), "its time stamps run backwards"),
    (entry(GAUSSMETER, "nan", **WHILE_RECORDING), "gaussmeter: read its buffer: '2026-"),
    (
        entry(GAUSSMETER, "port-gone", **WHILE_RECORDING),
        "'FETC:BUFF:DC?': the line broke (the other",
    ),
    (entry(BOARD, "lost-frame", command=COMMAND), "no acknowledgement came within 0.5 s"),
    (entry(BOARD, "partial", command=COUNTS, **WHILE_RECORDING), "is none of its messages"),
    (entry(BOARD, "silent", at="123 s"), "gyro_acquisition: record NA: no sample came"),
    (entry(BOARD, "dark", at="0 s"), "gyro_acquisition: start channel 1: the board sees no lit"),
    (entry(BOARD, "port-gone", **WHILE_RECORDING), "gyro_acquisition: "),
]


@pytest.mark.parametrize(
    ("fault", "sentence"),
    ENDS_WITH_A_SENTENCE,
    ids=[f"{one['instrument']} {one['fault']}" for one, _ in ENDS_WITH_A_SENTENCE],
)
def test_a_fault_ends_the_run_with_one_sentence_and_a_safe_world(
    fault: Entry, sentence: str, tmp_path: Path
) -> None:
    before = set(threading.enumerate())
    outcome, world = run_with(tmp_path, fault)
    assert [one["struck"] > 0 for one in world["faults"]] == [True]
    assert outcome.exit_code == 3
    assert outcome.error is not None and sentence in outcome.error
    assert fault["instrument"] in outcome.error
    assert "Traceback" not in outcome.error
    assert is_safe(world), world
    RunFolder(outcome.folder).finished_units()  # the folder opens
    left = set(threading.enumerate()) - before
    for thread in left:
        thread.join(10)
    assert not [thread.name for thread in left if thread.is_alive()]


@pytest.mark.parametrize(
    "fault", quick(["no-reply", "late", "garbled", "partial", "nan"], "no-reply", "garbled")
)
def test_one_bad_answer_on_the_way_to_rest_cuts_no_coil(fault: str, tmp_path: Path) -> None:
    outcome, world = run_with(tmp_path, entry(SUPPLY, fault, command="MEAS:CURR?", nth=2))
    assert world["faults"][0]["struck"] == 1
    assert outcome.exit_code == 0, outcome.error
    assert is_safe(world)
    coil = world["coils"]["y"]
    largest_step_A = coil["largest_slew_A_per_s"] * coil["time_constant_s"]
    assert largest_step_A < 0.25  # a ramp's step is 0.1 A; cut at full current it were 2.5 A


def test_an_overloaded_gaussmeter_is_flagged(tmp_path: Path) -> None:
    fault = entry(GAUSSMETER, "overload", **{"at": "120 s", "for": "5 s"})
    outcome, _ = run_with(tmp_path, fault)
    assert outcome.document is not None
    flags = {flag.code: flag for flag in outcome.document.flags}
    assert flags["overload"].details["count"] >= 40


def test_a_gyro_that_goes_dark_ends_the_record(tmp_path: Path) -> None:
    outcome, world = run_with(tmp_path, entry(BOARD, "dark", **WHILE_RECORDING))
    assert outcome.exit_code == 3
    assert outcome.error is not None
    assert "the board sees no lit gyro" in outcome.error
    assert is_safe(world)


def test_a_supply_that_is_gone_is_named_and_nobody_claims_that_it_is_safe(tmp_path: Path) -> None:
    fault = entry(SUPPLY, "port-gone", **WHILE_RECORDING)
    outcome, world = run_with(tmp_path, fault)
    assert outcome.exit_code == 3
    assert [(one.instrument, one.verified) for one in outcome.unsafe] == [(SUPPLY, False)]
    # What software cannot promise: nobody reaches the supply any more.
    assert not is_safe(world)


@pytest.mark.parametrize(
    "fault", quick(["no-reply", "late", "garbled", "dropped-connection"], "dropped-connection")
)
def test_a_supply_that_no_longer_answers_is_switched_off_and_named(
    fault: str, tmp_path: Path
) -> None:
    outcome, world = run_with(tmp_path, entry(SUPPLY, fault, **{"at": "120 s", "for": "10 h"}))
    assert outcome.exit_code == 3
    assert [(one.instrument, one.verified) for one in outcome.unsafe] == [(SUPPLY, False)]
    assert is_safe(world)


@pytest.mark.parametrize("since", quick(["60 s", "120 s"], "60 s"))
def test_a_read_back_that_stands_still_is_not_believed(since: str, tmp_path: Path) -> None:
    outcome, world = run_with(tmp_path, entry(SUPPLY, "frozen", at=since))
    assert outcome.exit_code == 3
    assert [(one.instrument, one.verified) for one in outcome.unsafe] == [(SUPPLY, False)]
    assert "stood still while the list ran" in outcome.unsafe[0].read_back
    # What flowed was not shown; the list was left at a zero that was reckoned from its start.
    assert is_safe(world)
    coil = world["coils"]["y"]
    assert coil["largest_slew_A_per_s"] * coil["time_constant_s"] < 0.25


def test_a_short_gap_in_the_counts_is_flagged_and_the_run_goes_on(tmp_path: Path) -> None:
    fault = entry(BOARD, "silent", **{"at": "120 s", "for": "3 s"})
    outcome, world = run_with(tmp_path, fault)
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    assert "gap" in {flag.code for flag in outcome.document.flags}
    assert is_safe(world)


def test_a_supply_in_compliance_shows_in_the_measured_field(tmp_path: Path) -> None:
    outcome, world = run_with(tmp_path, entry(SUPPLY, "compliance", command="CURR:MODE LIST"))
    assert outcome.document is not None
    flags = {flag.code for flag in outcome.document.flags}
    assert "field-differs-from-commanded" in flags
    assert is_safe(world)


def test_the_same_fault_twice_gives_the_same_world(tmp_path: Path) -> None:
    fault = entry(SUPPLY, "garbled", command="MEAS:CURR?", nth=3)
    worlds = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        outcome, world = run_with(tmp_path / name, fault)
        worlds.append((outcome.error, world["faults"], world["coils"]["y"]["largest_slew_A_per_s"]))
    assert worlds[0] == worlds[1]
