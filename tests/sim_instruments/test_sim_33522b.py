"""The simulated 33522B keeps to its guide: terminations, limits, bursts, triggers, errors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from fixture import EmptyRoom
from generator_fixture import LATENCY_S, Fixture, Room, standing
from sim_bench import Line

from sim_instruments.truth import SimulationError
from sim_instruments.world.base import TriggerLine
from sim_instruments.world.serf_coils import VoltageHistory

CLEAN = '+0,"No error"'


@pytest.fixture
def fixture() -> Iterator[Fixture]:
    with standing() as fixture:
        yield fixture


@pytest.fixture
def line(fixture: Fixture) -> Iterator[Line]:
    with fixture.line() as line:
        yield line


def errors(line: Line) -> list[str]:
    found = []
    while (error := line.ask("SYST:ERR?")) != CLEAN:
        found.append(error)
    return found


def quiet(line: Line, message: str) -> None:
    assert line.ask(f"{message};:SYST:ERR?") == CLEAN


# The history and the trigger line.


def test_a_history_is_constant_between_its_breakpoints() -> None:
    history = VoltageHistory()
    history.set(1.0, 2.0)
    history.then(3.0, -1.0)
    assert history.voltage_V(np.array([0.5, 1.0, 2.9, 3.0, 9.0])).tolist() == [0, 2, 2, -1, -1]
    assert history.breakpoints(0.0, 9.0).tolist() == [1.0, 3.0]
    assert history.breakpoints(1.0, 3.0).tolist() == []
    history.set(2.0, 2.0)  # what was planned is gone
    assert history.voltage_V(np.array([[2.0, 9.0]])).tolist() == [[2.0, 2.0]]
    assert history.changed_s == 2.0
    history.set(2.0, 5.0)
    history.set(2.0, 6.0)
    assert history.breakpoints(0.0, 9.0).tolist() == [1.0, 2.0]
    assert history.now_V(2.0) == 6.0


def test_only_an_edge_of_the_trigger_is_told() -> None:
    told: list[tuple[str, float]] = []
    trigger = TriggerLine()
    trigger.listen(lambda time_s: told.append(("up", time_s)))
    trigger.listen(
        lambda time_s: told.append(("up too", time_s)), lambda time_s: told.append(("down", time_s))
    )
    trigger.fall(0.5)
    trigger.rise(1.0)
    trigger.rise(2.0)
    trigger.fall(3.0)
    assert told == [("up", 1.0), ("up too", 1.0), ("down", 3.0)]


# The instrument.


def test_it_says_who_it_is_and_starts_at_50_ohm_with_outputs_off(line: Line) -> None:
    assert line.ask("*IDN?").startswith("Keysight Technologies,33522B,MY59000101,")
    assert line.ask("OUTP1?;:OUTP2?;:SOUR2:FUNC?;:OUTP1:LOAD?") == "0;0;SIN;+5.0000000000000E+01"
    assert line.ask("OUTP:LOAD INF;LOAD?") == "+9.9000000000000E+37"


def test_what_is_programmed_for_50_ohm_is_doubled_at_an_open_end(
    fixture: Fixture, line: Line
) -> None:
    quiet(line, "SOUR1:FUNC DC;:SOUR1:VOLT:OFFS 1.5;:OUTP1 ON")
    quiet(line, "OUTP2:LOAD INF;:SOUR2:FUNC DC;:SOUR2:VOLT:OFFS 1.5;:OUTP2 ON")
    now_s = fixture.clock.now()
    assert fixture.room.volts("x", now_s) == [3.0]
    assert fixture.room.volts("y", now_s) == [1.5]
    # The setting changes what is shown, not what comes out.
    assert float(line.ask("OUTP1:LOAD INF;:SOUR1:VOLT:OFFS?")) == 3.0
    assert fixture.room.volts("x", fixture.clock.now()) == [3.0]
    fixture.clock.sleep(1.0)
    quiet(line, "OUTP1 OFF")
    assert fixture.room.volts("x", now_s, fixture.clock.now()) == [3.0, 0.0]


def test_each_channel_has_errors_of_its_own() -> None:
    with (
        standing(gain_error={1: "1 %", 2: "-1 %"}, offset={1: "3 mV", 2: "-1 mV"}) as fixture,
        fixture.line() as line,
    ):
        quiet(line, "OUTP1:LOAD INF;:OUTP2:LOAD INF;:SOUR1:FUNC DC;:SOUR2:FUNC DC")
        quiet(line, "SOUR1:VOLT:OFFS 2;:SOUR2:VOLT:OFFS 2;:OUTP1 ON")
        now_s = fixture.clock.now()
        assert fixture.room.volts("x", now_s) == pytest.approx([2.023])
        assert fixture.room.volts("y", now_s) == [0.0]  # off is off
        quiet(line, "OUTP2 ON")
        assert fixture.room.volts("y", fixture.clock.now()) == pytest.approx([1.979])


@pytest.mark.parametrize(
    ("message", "told", "reads"),
    [
        ("FUNC DC;:VOLT:OFFS 7", ['-222,"Data out of range;value clipped to upper limit"'], 5.0),
        ("FUNC DC;:VOLT:OFFS -7", ['-222,"Data out of range;value clipped to lower limit"'], -5.0),
        (
            "VOLT 4;:VOLT:OFFS 4",
            ['-221,"Settings conflict;amplitude changed due to offset"'],
            4.0,
        ),
        (
            "VOLT MIN;:VOLT:OFFS 4;:VOLT 6",
            ['-221,"Settings conflict;offset changed due to amplitude"'],
            2.0,
        ),
        (
            "FUNC DC;:VOLT:LIM:HIGH 1;LOW -1;STAT ON;:VOLT:OFFS 1.5",
            ['-221,"Settings conflict;level clipped due to voltage limit"'],
            1.0,
        ),
        (
            "VOLT:HIGH -1",
            ['-221,"Settings conflict;low level changed due to high level"'],
            -1.0005,
        ),
    ],
)
def test_a_value_that_does_not_fit_is_changed_and_told(
    line: Line, message: str, told: list[str], reads: float
) -> None:
    line.write(message)
    assert errors(line) == told
    assert float(line.ask("VOLT:OFFS?")) == pytest.approx(reads)


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ("NONSENSE 1", '-113,"Undefined header"'),
        ("FUNC DC;:BURS:STAT ON", '-221,"Settings conflict;not able to burst dc,'),
        ("BURS:STAT ON;:FUNC DC", '-221,"Settings conflict;not able to burst dc,'),
        ("VOLT:LIM:STAT ON;:OUTP:LOAD INF", '-221,"Settings conflict"'),
        ("VOLT:LIM:HIGH 0.01;STAT ON", '-221,"Settings conflict"'),
        ("FUNC:PULS:PER 1;WIDT 2", '-222,"Data out of range;value clipped to upper limit"'),
        ("FUNC PULS;:FUNC:PULS:WIDT 5e-4;PER 1e-4", '-221,"Settings conflict;pulse width changed'),
        ("*TRG", '-211,"Trigger ignored"'),
        ("DATA:ARB a,0,0,0", '-222,"Data out of range"'),
        ('FUNC:ARB "a"', '+785,"Specified arb waveform does not exist"'),
        ("OUTP:LOAD 0.5", '-222,"Data out of range;value clipped to lower limit"'),
    ],
)
def test_what_does_not_go_together_is_told(line: Line, message: str, error: str) -> None:
    assert line.ask(f"{message};:SYST:ERR?").startswith(error)
    assert errors(line) == []


def test_a_name_is_used_once_until_the_memory_is_cleared(line: Line) -> None:
    points = "-1,-1,0.5,0.5,0.5,0.5,1,-1"
    quiet(line, f"DATA:ARB step,{points}")
    line.write(f"DATA:ARB step,{points}")
    assert errors(line) == ['+786,"Specified arb waveform already exists"']
    quiet(line, f"DATA:VOL:CLE;:DATA:ARB step,{points};:FUNC:ARB step;:FUNC ARB")
    assert line.ask("DATA:VOL:CAT?") == '"EXP_RISE","STEP"'


def test_the_error_queue_holds_twenty(line: Line) -> None:
    line.write(";:".join(["NONSENSE"] * 25))
    assert errors(line) == ['-113,"Undefined header"'] * 19 + ['-350,"Queue overflow"']


PULSE = (
    "OUTP{0}:LOAD INF;:SOUR{0}:FUNC PULS;:SOUR{0}:VOLT:HIGH 3;LOW 1;:SOUR{0}:FUNC:PULS:PER 1;"
    "WIDT 0.2;:SOUR{0}:BURS:NCYC 1;STAT ON;:TRIG{0}:SOUR EXT;:OUTP{0} ON"
)


def test_a_burst_waits_low_and_plays_once_for_each_edge(fixture: Fixture, line: Line) -> None:
    quiet(line, PULSE.format(1))
    quiet(line, PULSE.format(2) + ";:OUTP2:POL INV")
    at_s = fixture.rise()
    assert at_s == fixture.clock.now()
    around_s = [at_s, at_s + 0.5 * LATENCY_S, at_s + 2 * LATENCY_S, at_s + 0.19, at_s + 0.21]
    assert fixture.room.volts("x", *around_s) == [1.0, 1.0, 3.0, 3.0, 1.0]
    assert fixture.room.volts("y", *around_s) == [3.0, 3.0, 1.0, 1.0, 3.0]
    edges_s = fixture.room.coils["x"].breakpoints(at_s, at_s + 10.0)
    assert edges_s - at_s == pytest.approx([LATENCY_S, 0.2 + LATENCY_S], abs=1e-12)
    fixture.clock.sleep(0.5)
    fixture.room.trigger.fall(fixture.clock.now())
    fixture.rise()  # before the period of the first one is over
    assert fixture.room.volts("x", fixture.clock.now() + 0.1) == [1.0]
    fixture.clock.sleep(1.0)
    fixture.room.trigger.fall(fixture.clock.now())
    assert fixture.room.volts("x", fixture.rise() + 0.1) == [3.0]


def test_an_output_that_is_off_is_not_switched_on_by_a_trigger(
    fixture: Fixture, line: Line
) -> None:
    quiet(line, PULSE.format(1) + ";:OUTP1 OFF")
    assert fixture.room.volts("x", fixture.rise() + 0.1) == [0.0]


def test_two_channels_start_together_by_a_bus_trigger(fixture: Fixture, line: Line) -> None:
    for channel in (1, 2):
        quiet(line, PULSE.format(channel) + f";:TRIG{channel}:SOUR BUS")
    fixture.rise()
    assert fixture.room.volts("x", fixture.clock.now() + 0.1) == [1.0]
    quiet(line, "*TRG")
    at_s = fixture.clock.now()
    assert fixture.room.volts("x", at_s + 0.1) == fixture.room.volts("y", at_s + 0.1) == [3.0]


def test_what_is_changed_in_the_middle_of_a_burst_ends_it(fixture: Fixture, line: Line) -> None:
    quiet(line, PULSE.format(1))
    at_s = fixture.rise()
    fixture.clock.sleep(0.1)
    quiet(line, "SOUR1:BURS:STAT OFF;:SOUR1:FUNC DC;:SOUR1:VOLT:OFFS 0.5")
    volts = fixture.room.volts("x", at_s + 0.05, at_s + 0.11, at_s + 0.3)
    assert volts == [3.0, 0.5, 0.5]


def test_an_arbitrary_waveform_is_played_point_by_point(fixture: Fixture, line: Line) -> None:
    quiet(line, "OUTP1:LOAD INF;:VOLT:HIGH 2;LOW -2;:DATA:ARB steps,-1,-1,-1,0,0,0.5,1,-1")
    quiet(line, "FUNC:ARB steps;:FUNC:ARB:SRAT 10;:FUNC ARB;:BURS:STAT ON;:TRIG:SOUR EXT;:OUTP ON")
    at_s = fixture.rise() + LATENCY_S
    times_s = at_s + 0.05 + 0.1 * np.arange(9)
    assert fixture.room.volts("x", *times_s) == [-2, -2, -2, 0, 0, 1, 2, -2, -2]


def test_a_waveform_that_runs_reaches_the_coil_with_its_mean(fixture: Fixture, line: Line) -> None:
    quiet(line, "OUTP1:LOAD INF;:FUNC SQU;:VOLT:HIGH 2;LOW 1;:OUTP ON")
    assert fixture.room.volts("x", fixture.clock.now()) == pytest.approx([1.5])
    quiet(line, "FUNC PULS;:FUNC:PULS:PER 1;WIDT 0.25")
    assert fixture.room.volts("x", fixture.clock.now()) == pytest.approx([1.25])


def test_a_reset_switches_off_and_forgets(fixture: Fixture, line: Line) -> None:
    quiet(line, PULSE.format(1) + ";*RST")
    assert line.ask("OUTP1?;:FUNC?;:BURS:STAT?;:TRIG1:SOUR?;:VOLT?") == (
        "0;SIN;0;IMM;+1.0000000000000E-01"
    )
    assert fixture.room.volts("x", fixture.clock.now()) == [0.0]


def test_it_serves_where_there_is_nothing_to_drive() -> None:
    with standing(room=EmptyRoom()) as fixture, fixture.line() as line:
        quiet(line, PULSE.format(1))
        assert fixture.simulator.energised()


def test_a_coil_that_no_world_has_is_told() -> None:
    told = r"simulator\.coils\.2: one of x, y, z, gradient, none was expected"
    with pytest.raises(SimulationError, match=told), standing(coils={1: "x", 2: "w"}):
        pass


def test_keys_that_came_by_json_are_numbers_still() -> None:
    keys = {key: {"1": "0 V", "2": "0 V"} for key in ("offset",)}
    keys |= {"gain_error": {"1": "0 %", "2": "0 %"}, "coils": {"1": "y", "2": "none"}}
    with standing(**keys) as fixture:
        assert list(fixture.room.coils) == ["y"]
        assert isinstance(fixture.room, Room)
