"""A supply that lies, or comes on again, is not called safe; the field beside it says so.

The oracle is the world itself, which asks no driver (`SimulatedBench.simulation_report`).
"""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from faulted_runs import Entry, is_safe, run_with
from tiers import quick

from station.clock import RealClock
from station.errors import BenchEnergised, InstrumentError, NotAcknowledged
from station.record.events import AT_REST_AGAIN, Event
from station.record.folder import RunFolder
from station.roles import GAUSSMETER as ROLE
from station.runner.evaluation import flags_of_missed_time
from station.runner.outcome import Outcome
from station.safety.acknowledgement import acknowledge, refuse_until_acknowledged
from station.safety.safe_state import Hurry
from station.safety.witness import Sighting, Witnesses, WitnessReport, judge

SUPPLY, METER = "coil_supply.y", "gaussmeter"
BEFORE_MT = (0.02, -0.004, -0.043)
CLOCK = RealClock(1000.0)


def entry(fault: str, **options: Any) -> Entry:
    return {"instrument": SUPPLY, "fault": fault, "at": "120 s", **options}


def on_again(outcome: Outcome) -> list[str]:
    events = RunFolder(outcome.folder).events_of(AT_REST_AGAIN)
    return [str(event.details["message"]) for event in events]


def test_a_supply_that_lies_about_everything_is_contradicted_by_the_field(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    outcome, world = run_with(tmp_path, entry("lies"))
    assert not is_safe(world)
    assert outcome.exit_code == 3
    (doubted,) = outcome.unsafe
    assert (doubted.instrument, doubted.doubted) == (SUPPLY, True)
    assert "output off, 0.00" in doubted.read_back
    assert "gaussmeter sees that" in doubted.read_back
    assert outcome.document is not None and outcome.document.verdict == "inconclusive"
    assert "safe-state-unverified" in [flag.code for flag in outcome.document.flags]
    assert len(on_again(outcome)) == 3  # made safe twice more, then named
    bench = tmp_path / "bench.yaml"
    with pytest.raises(NotAcknowledged, match="gaussmeter sees that"):
        refuse_until_acknowledged(bench)
    assert acknowledge(bench) is not None
    refuse_until_acknowledged(bench)


@pytest.mark.campaign
def test_a_supply_that_comes_on_while_it_is_made_safe_is_switched_off_by_the_same_attempt(
    tmp_path: Path,
) -> None:
    outcome, world = run_with(tmp_path, entry("comes-back", after="0.3 s"))
    assert is_safe(world)
    assert outcome.exit_code == 0, outcome.error
    assert on_again(outcome) == []


@pytest.mark.parametrize("after", quick(["1.5 s", "3 s"], "3 s"))
def test_a_supply_that_comes_on_again_is_switched_off_again(after: str, tmp_path: Path) -> None:
    outcome, world = run_with(tmp_path, entry("comes-back", after=after))
    assert is_safe(world)
    assert outcome.exit_code == 0, outcome.error
    assert [words.partition(" A")[0] for words in on_again(outcome)] in (
        [f"{SUPPLY}: output on, 3.999"],
        [f"{SUPPLY}: output on, 4.000"],
    )


def test_a_supply_that_comes_on_again_and_again_is_named(tmp_path: Path) -> None:
    outcome, world = run_with(tmp_path, entry("comes-back", times=99))
    assert not is_safe(world)
    assert outcome.exit_code == 3
    (unsafe,) = outcome.unsafe
    assert not unsafe.doubted  # it says so itself: a guardian would go on trying
    assert "on again after it was switched off: output on" in unsafe.read_back


def test_an_undisturbed_run_asks_its_witness_and_says_when_it_looked(tmp_path: Path) -> None:
    outcome, _ = run_with(tmp_path)
    (report,) = outcome.witness_reports
    assert (report.agrees, report.ambient) == (True, False)
    assert list(report.sources) == [SUPPLY]
    (safe,) = RunFolder(outcome.folder).events_of("safe-state")
    assert 0.0 <= safe.details["oldest_s"] <= 2.0
    assert f"no reading older than {safe.details['oldest_s']:.1f} s" in outcome.read_when


class Meter:
    """A gaussmeter with the readings that it is to give, the last for ever."""

    def __init__(self, *readings_mT: tuple[float, float, float]) -> None:
        self.readings_mT = [*readings_mT[:1] * 2, *readings_mT]

    def field_now_mT(self) -> tuple[float, float, float]:
        if not self.readings_mT:
            raise InstrumentError(METER, "asked", "nothing came", "look at it")
        return self.readings_mT.pop(0) if len(self.readings_mT) > 1 else self.readings_mT[0]


def rows(*field_mT: tuple[float, float, float]) -> Any:
    kind = [("x_T", float), ("y_T", float), ("z_T", float)]
    return np.array([tuple(value * 1e-3 for value in one) for one in field_mT], dtype=kind)


def beside(field_mT: float) -> tuple[float, float, float]:
    return (BEFORE_MT[0] + field_mT, BEFORE_MT[1], BEFORE_MT[2])


def sine(amplitude_mT: float) -> Any:
    return rows(*(beside(amplitude_mT * math.sin(0.3 * k)) for k in range(60)))


def watched(meter: Meter) -> Witnesses:
    witnesses = Witnesses(CLOCK)
    witnesses.open({METER: meter})
    witnesses.drives(SUPPLY, {METER: 1.0})
    witnesses.came(METER, sine(1.0))
    witnesses.drives(SUPPLY, {METER: 0.0})
    return witnesses


def asked(witnesses: Witnesses) -> WitnessReport:
    (report,) = witnesses.testify()
    return report


@pytest.mark.parametrize(
    ("left_mT", "agrees", "ambient"),
    [(0.0, True, False), (0.02, True, False), (0.05, True, True), (0.2, False, False)],
)
def test_more_than_a_tenth_contradicts_and_less_is_the_ambient(
    left_mT: float, agrees: bool, ambient: bool
) -> None:
    report = asked(watched(Meter(BEFORE_MT, beside(left_mT))))
    assert (report.agrees, report.ambient) == (agrees, ambient)


def test_a_sine_that_is_left_is_seen_though_it_passes_zero() -> None:
    swinging = [beside(value) for value in (0.0, 0.8, 0.0, -0.7, 0.0)]
    assert asked(watched(Meter(BEFORE_MT, *swinging))).agrees is False


def test_one_wild_reading_at_the_end_or_before_is_no_field() -> None:
    wild = [beside(value) for value in (0.0, 0.0, 70.0, 0.0, 0.0)]
    assert asked(watched(Meter(BEFORE_MT, *wild))).agrees is True
    before = Meter(BEFORE_MT)
    before.readings_mT = [BEFORE_MT, beside(70.0), BEFORE_MT, BEFORE_MT]
    assert asked(watched(before)).agrees is True


def test_what_was_beyond_the_range_before_is_not_compared() -> None:
    beyond = (math.inf, math.inf, math.inf)
    sighting = Sighting(METER, "mT", list(beyond), expected={SUPPLY: 1.0}, change={SUPPLY: 1.0})
    assert judge(sighting, Meter(beyond), CLOCK).agrees is None
    witnesses = watched(Meter(beyond))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        witnesses.drives(SUPPLY, {METER: 1.0})
        witnesses.came(METER, rows(beside(0.5), (9e37, 9e37, 9e37), (9e37, 9e37, 9e37)))


def noisy(field_mT: float, looks: int) -> list[tuple[float, float, float]]:
    return [beside(field_mT + 1e-6 * k) for k in range(looks)]


def test_a_meter_that_stands_still_is_not_asked_where_it_did_not_before() -> None:
    stands_still = Meter(*noisy(0.0, 3), beside(0.4))
    del stands_still.readings_mT[:2]
    witnesses = watched(stands_still)
    report = asked(witnesses)
    assert (report.agrees, report.sentence) == (None, "not asked: its readings stand still")
    assert asked(watched(Meter(*noisy(0.0, 2), *noisy(0.4, 5)))).agrees is False
    coarse = Meter(BEFORE_MT, BEFORE_MT, beside(0.4))  # its digits never change at rest
    assert asked(watched(coarse)).agrees is False


def test_a_person_in_a_hurry_shortens_the_looks_and_loses_none() -> None:
    witnesses = watched(Meter(BEFORE_MT, BEFORE_MT, *noisy(0.4, 5)))
    hurry = Hurry(CLOCK)
    hurry.ask()
    assert asked(witnesses).agrees is False
    assert CLOCK.interruption is None


def test_what_is_not_asked_of_another_source_is_said() -> None:
    witnesses = watched(Meter(BEFORE_MT))
    witnesses.moved("the stage turned since")
    witnesses.drives("coil_supply.x", {METER: 1.0})
    witnesses.came(METER, sine(1.0))
    report = asked(witnesses)
    assert report.agrees is True
    assert report.sentence.endswith(f"; not asked of {SUPPLY}: the stage turned since")


def test_a_field_beyond_the_range_contradicts() -> None:
    report = asked(watched(Meter(BEFORE_MT, (math.inf, 0.0, 0.0))))
    assert report.agrees is False
    assert report.sentence.startswith("more than its range in mT are left")


def test_a_field_that_stays_beyond_the_range_contradicts_though_it_stands_still() -> None:
    beyond = (math.inf, math.inf, math.inf)
    report = asked(watched(Meter(*noisy(0.0, 2), *[beyond] * 5)))
    assert report.agrees is False


def test_a_sine_that_is_there_before_anything_is_driven_ends_the_run_unsafe() -> None:
    meter = Meter(BEFORE_MT)
    meter.readings_mT = [beside(value) for value in [0.0, 0.8, -0.7, 0.3, -0.2] * 3]
    witnesses = Witnesses(CLOCK)
    witnesses.open({METER: meter})
    with pytest.raises(BenchEnergised, match="readings differ by"):
        witnesses.refuse_energised({SUPPLY: {METER: 1.0}})
    assert asked(witnesses).agrees is False


@pytest.mark.parametrize(
    ("now_mT", "refused"), [(0.03, False), (-0.1, False), (0.5, True), (-0.9, True)]
)
def test_what_an_earlier_process_of_the_run_left_on_is_no_ambient(
    now_mT: float, refused: bool
) -> None:
    witnesses = Witnesses(CLOCK, {METER: BEFORE_MT})
    witnesses.open({METER: Meter(beside(now_mT))})
    if not refused:
        witnesses.refuse_energised({SUPPLY: {METER: 1.0}})
        return
    with pytest.raises(BenchEnergised, match="mT came since the run began"):
        witnesses.refuse_energised({SUPPLY: {METER: 1.0}})
    report = asked(witnesses)
    assert (report.agrees, list(report.sources)) == (False, [SUPPLY])


def test_a_wild_reading_is_no_change_that_hides_what_is_left() -> None:
    witnesses = Witnesses(CLOCK)
    witnesses.open({METER: Meter(BEFORE_MT, beside(0.5))})
    witnesses.drives(SUPPLY, {METER: 1.0})
    witnesses.came(METER, rows(*([beside(0.9)] * 5), beside(80.0), (9e37, 0, 0), beside(0.9)))
    assert asked(witnesses).agrees is False


@pytest.mark.parametrize(
    ("act", "reason"),
    [
        (lambda one: one.moved("the stage turned since"), "the stage turned since"),
        (lambda one: one.moved("the probe was turned since", METER), "probe was turned since"),
    ],
)
def test_what_was_moved_since_is_not_asked(act: Any, reason: str) -> None:
    witnesses = watched(Meter(BEFORE_MT, beside(0.15)))
    act(witnesses)
    report = asked(witnesses)
    assert report.agrees is None
    assert reason in report.sentence


@pytest.mark.parametrize("moved", [True, False])
def test_what_no_turn_could_make_contradicts_though_no_change_was_seen(moved: bool) -> None:
    witnesses = Witnesses(CLOCK)
    witnesses.open({METER: Meter(BEFORE_MT, beside(50.0))})
    witnesses.drives(SUPPLY, {METER: 50.0})
    if moved:
        witnesses.moved("the stage turned since")
    assert asked(witnesses).agrees is False


def test_what_is_seen_again_after_a_turn_is_asked_again() -> None:
    witnesses = watched(Meter(BEFORE_MT, beside(0.9)))
    witnesses.moved("the stage turned since")
    witnesses.drives(SUPPLY, {METER: 1.0})
    witnesses.came(METER, sine(1.0))
    assert asked(witnesses).agrees is False


def test_a_coil_elsewhere_is_not_spoken_of() -> None:
    meter = Meter(BEFORE_MT, beside(0.01))
    witnesses = Witnesses(CLOCK)
    witnesses.open({METER: meter})
    witnesses.drives("coil_supply.dc", {METER: 50.0})
    witnesses.came(METER, sine(0.02))
    report = asked(witnesses)
    assert (report.agrees, report.sentence) == (
        None,
        "not asked: it saw no change of what was driven",
    )


def test_before_anything_is_driven_a_move_is_looked_at_anew() -> None:
    meter = Meter(BEFORE_MT, beside(0.3), beside(0.3))
    witnesses = Witnesses(CLOCK)
    witnesses.open({METER: meter})
    witnesses.moved("somebody was at the bench since (mount)")
    witnesses.drives(SUPPLY, {METER: 1.0})
    witnesses.came(METER, rows(*([beside(1.3)] * 5)))
    assert asked(witnesses).agrees is True


def test_a_probe_of_one_axis_is_judged_along_it_alone() -> None:
    nan = math.nan
    seen = {SUPPLY: 1.0}
    sighting = Sighting(METER, "mT", [0.02, nan, nan], expected=seen, change=seen)
    assert judge(sighting, Meter((0.02, nan, nan)), CLOCK).agrees is True
    assert judge(sighting, Meter((0.6, nan, nan)), CLOCK).agrees is False
    # A driver that a guardian has just opened does not know how the probe is turned.
    assert judge(sighting, Meter((nan, 0.6, nan)), CLOCK).agrees is False
    turned = Sighting(METER, "mT", [0.02, nan, nan], expected=seen, lost={SUPPLY: "it was turned"})
    assert judge(turned, Meter((nan, 0.6, nan)), CLOCK).agrees is None
    assert judge(sighting, Meter(), CLOCK).agrees is None
    assert "cannot be reached" in judge(sighting, None, CLOCK).sentence


def test_a_driver_without_the_verb_is_no_witness() -> None:
    witnesses = Witnesses(CLOCK)
    witnesses.open({METER: SimpleNamespace()})
    assert not witnesses.sightings


def test_what_a_witness_should_see_comes_from_the_bench_file() -> None:
    witness = ROLE.witness
    assert witness is not None
    constant = {"coil_constant": "0.3 mT/A"}
    assert witness.expected({"current_A": 5.0}, constant) == pytest.approx(1.5)
    assert witness.expected({"field_mT": -2.0, "current_A": 5.0}, constant) == 2.0
    assert witness.expected({"voltage_V": 5.0}, {}) is None


def test_guardians_are_informed_before_and_when_more_is_seen() -> None:
    seen: list[list[dict[str, Any]]] = []
    witnesses = Witnesses(CLOCK)
    witnesses.open({METER: Meter(BEFORE_MT)})
    witnesses.informs(seen.append)
    witnesses.drives(SUPPLY, {METER: 1.0})
    assert json.loads(json.dumps(seen[-1]))[0]["before"] == list(BEFORE_MT)
    for amplitude_mT in np.linspace(0.5, 1.0, 100):
        witnesses.came(METER, sine(float(amplitude_mT)))
    assert seen[-1][0]["change"][SUPPLY] > 0.8
    assert len(seen) < 12


def test_time_that_nobody_watched_is_flagged() -> None:
    event = Event(90.0, "time-missed", {"seconds": 30.2, "at_s": 88.0})
    folder: Any = SimpleNamespace(events_of=lambda kind: [event] if kind == event.kind else [])
    (flag,) = flags_of_missed_time(folder)
    assert flag.code == "time-missed"
    assert "30 s until 88 s of run time" in flag.message
    folder.events_of = lambda kind: []
    assert not list(flags_of_missed_time(folder))
