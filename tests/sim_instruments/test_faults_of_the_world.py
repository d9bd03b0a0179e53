"""Faults that last: another instrument or another world for a while, and the world's own report."""

from __future__ import annotations

import numpy as np
import pytest
from sim_bench import GAUSSMETER, START, SUPPLY, Line, board_with, counts, faulty, line_with

from sim_instruments.kepco.bop import KepcoBop


def test_a_frozen_supply_shows_the_last_current_for_ever() -> None:
    with line_with(SUPPLY, fault="frozen", **{"at": "5 s", "for": "5 s"}) as (line, _):
        clock = line._clock
        line.ask("FUNC:MODE CURR;:VOLT 30;:OUTP ON;*OPC?")
        before = line.ask("MEAS:CURR?")
        clock.sleep_until(6.0)
        line.ask("CURR 2;*OPC?")
        clock.sleep(1.0)
        assert line.ask("MEAS:CURR?") == before
        clock.sleep_until(11.0)
        assert float(line.ask("MEAS:CURR?")) == pytest.approx(2.0, abs=0.01)


def test_a_supply_in_compliance_clips_a_running_list_and_recovers() -> None:
    entry = {"fault": "compliance", "voltage": "1.2 V", "at": "5 s", "for": "5 s"}
    with line_with(SUPPLY, **entry) as (line, bench):
        line.ask("FUNC:MODE CURR;:VOLT 30;:LIST:CLE;CURR 2,-2;DWEL 0.5;:OUTP ON;*OPC?")
        line.ask("LIST:COUN 0;:CURR:MODE LIST;*OPC?")
        line._clock.sleep_until(15.0)
        line.ask("STAT:OPER:COND?")
        coil = bench._world.coil("y")
        largest = [
            float(np.abs(coil.current(np.arange(first, first + 4.0, 0.01))).max())
            for first in (0.5, 5.5, 10.5)
        ]
        # The list goes on as if nothing had happened: the same half period before and after.
        later = coil.current(np.array([4.25, 12.25]))
    assert largest == pytest.approx([2.0, 1.0, 2.0], abs=0.02)
    assert later[0] == pytest.approx(later[1], abs=1e-6)


def test_a_list_is_refused_with_a_settings_conflict() -> None:
    with line_with(SUPPLY, fault="list-refused", command="CURR:MODE LIST") as (line, _):
        line.ask("FUNC:MODE CURR;:LIST:CLE;CURR 0;DWEL 0.5;*OPC?")
        assert line.ask("CURR:MODE LIST;:SYST:ERR?").startswith("-221")
        assert line.ask("CURR:MODE?") == "FIX"


def readings(line: Line) -> np.ndarray:
    records = line.ask("FETC:BUFF:DC?").strip('"').split(";")[:-1]
    return np.array([[float(text) for text in record.split(",")[2:]] for record in records])


def test_an_overloaded_gaussmeter_says_so_in_value_and_state() -> None:
    with line_with(GAUSSMETER, fault="overload", **{"at": "2 s", "for": "1 s"}) as (line, _):
        line.ask("SENS:AVER:COUN 10;:FETC:BUFF:DC?")
        line._clock.sleep_until(5.0)
        rows = readings(line)
    overloaded = (rows[:, :3] == 9.9e37).all(axis=1)
    assert 9 <= overloaded.sum() <= 11
    assert (rows[overloaded, 3] != 0).all() and (rows[~overloaded, 3] == 0).all()


def test_a_frozen_gaussmeter_repeats_one_reading_with_new_stamps() -> None:
    with line_with(GAUSSMETER, fault="frozen", at="2 s") as (line, _):
        line.ask("SENS:AVER:COUN 10;:FETC:BUFF:DC?")
        line._clock.sleep_until(5.0)
        rows = readings(line)
    assert len(np.unique(rows[:15, 0])) == 15
    assert len(np.unique(rows[-25:, 0])) == 1


def test_a_silent_board_counts_on_without_sending() -> None:
    with board_with(fault="silent", **{"at": "2 s", "for": "1 s"}) as (clock, bench, board):
        board.command(START, mask=1, interval_ms=100)
        clock.sleep(5.0)
        sequence = counts(board, bench)[:, 0]
    missing = np.diff(sequence).max() - 1
    assert 9 <= missing <= 11 and sequence[-1] >= 48


def test_a_frozen_counter_goes_on_numbering() -> None:
    with board_with(fault="frozen", command=0x121, nth=10) as (clock, bench, board):
        board.command(START, mask=1, interval_ms=100)
        clock.sleep(5.0)
        rows = counts(board, bench)
    assert (np.diff(rows[:, 0]) == 1).all()
    assert len(np.unique(rows[12:, 1])) == 1


def test_a_dark_gyro_counts_nothing_and_its_lamp_is_out_until_it_comes_back() -> None:
    with board_with(fault="dark", **{"at": "5 s", "for": "5 s"}) as (clock, bench, board):
        board.command(START, mask=1, interval_ms=100)
        clock.sleep_until(15.0)
        rows = counts(board, bench)
        lit = [data[6] >> 4 & 1 for data in board.of(0x110)]
        assert bench.simulation_report()["gyro_powered"]
    assert len(np.unique(rows[55:95, 1])) <= 2
    assert lit[2] == 1 and lit[7] == 0 and lit[-1] == 1


def test_the_report_tells_what_the_world_has_been_through() -> None:
    with faulty() as (clock, bench), Line(bench, SUPPLY, clock) as line:
        line.ask("FUNC:MODE CURR;:VOLT 30;:OUTP ON;:CURR 3;*OPC?")
        clock.sleep(1.0)
        running = bench.simulation_report()
        line.ask("OUTP OFF;*OPC?")
        off_s = clock.now()
        clock.sleep(1.0)
        ended = bench.simulation_report()
    assert running["outputs"][SUPPLY] and not ended["outputs"][SUPPLY]
    assert running["coils"]["y"]["at_zero_since_s"] is None
    coil = ended["coils"]["y"]
    assert coil["driven_A"] == 0.0 and abs(coil["current_A"]) < 1e-9
    assert coil["at_zero_since_s"] == pytest.approx(off_s - KepcoBop.command_s)
    assert coil["largest_current_A"] == pytest.approx(3.0, abs=0.01)
    step_A = coil["largest_slew_A_per_s"] * coil["time_constant_s"]
    assert step_A == pytest.approx(3.0, abs=0.01)
