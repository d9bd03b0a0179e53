"""How long a run takes on virtual time is what its plan declared beforehand, step by step."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from short_forms import SHORT_FORMS
from tiers import quick

from station.cli.validating import read_bench_named, read_plan_for
from station.files.lookup import PLANS, available
from station.method.duration import Duration
from station.procedure import procedure_of
from station.record.events import read_events
from station.record.layout import EVENTS

WITHIN = 0.01
EXCHANGES_S = 1.0
"""What asking the instruments of a step takes beside all that it waits for: of three BOPs, that
answer each message after 25 ms, three quarters of a second."""


def step_times(run: Path) -> list[tuple[str, Duration, float]]:
    """Return each step of a run, what was declared of it, and how long it took by the run's log."""
    began_s, ended_s, declared = {}, {}, {}
    for event in read_events(run / EVENTS):
        match event.kind:
            case "run-started":
                for step in event.details["steps"]:
                    bounds = (step[name] for name in ("expected_s", "shortest_s", "longest_s"))
                    declared[step["step"]] = Duration(*bounds)
            case "step-started":
                began_s[event.details["step"]] = event.time_s
            case "step-finished":
                ended_s[event.details["step"]] = event.time_s
    return [(step, declared[step], ended_s[step] - began_s[step]) for step in declared]


def faults_of(declared: Duration, took_s: float) -> str:
    """Return what is wrong with a declared duration, empty where nothing is."""
    if declared.is_certain:
        right = abs(took_s - declared.expected_s) <= max(WITHIN * declared.expected_s, EXCHANGES_S)
    else:
        right = declared.shortest_s <= took_s <= declared.longest_s + EXCHANGES_S
    return "" if right else f"took {took_s:.2f} s, declared {declared}"


@pytest.mark.parametrize(
    "name", quick(SHORT_FORMS, "rlg-magnetic-sensitivity", "gyro-static-noise", "gyro-rate-table")
)
def test_a_run_takes_as_long_as_its_plan_declares(name: str, run_of: Callable[[str], Path]) -> None:
    times = step_times(run_of(name))
    wrong = {step: fault for step, declared, s in times if (fault := faults_of(declared, s))}
    assert not wrong
    whole = sum((declared for _, declared, _ in times), Duration())
    assert not faults_of(whole, sum(took_s for _, _, took_s in times))


@pytest.mark.parametrize("name", [name for name, _ in available(PLANS)])
def test_what_is_expected_lies_between_the_shortest_and_the_longest(name: str) -> None:
    bench = read_bench_named("sim")
    plan = read_plan_for(name, bench, ())
    for step, declared in procedure_of(plan.procedure).timed_steps(plan.parameters):
        assert 0.0 <= declared.shortest_s <= declared.expected_s <= declared.longest_s, step.number


def test_a_wrong_declaration_is_seen() -> None:
    assert faults_of(Duration(300.0, 300.0, 300.0), 304.0)
    assert faults_of(Duration(300.0, 290.0, 310.0), 289.0)
    assert not faults_of(Duration(300.0, 300.0, 300.0), 302.0)
