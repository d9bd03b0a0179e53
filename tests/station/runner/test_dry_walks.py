"""A dry run walks the steps of every shipped plan with nothing but the plan."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from station.errors import InputError
from station.files.lookup import PLANS, available, find
from station.files.plan import read_plan
from station.instruments.bench import Bench
from station.method import dry_run
from station.method.commands import CoilOff, SineCurrent
from station.method.dry_run import DryRun
from station.method.duration import exactly
from station.method.prompts import AskedValue, Prompt
from station.method.run import EarlierProgress, Run, Step
from station.method.set_points import Bounded, Command, Station
from station.procedure import INTERFACE, Procedure, Procedures, procedure_of
from station.roles import Gaussmeter

HEAVY = ("scipy", "matplotlib", "numpy")
WALK = """
import sys
from station.files.lookup import PLANS, find
from station.files.plan import read_plan
from station.procedure import Procedures, procedure_of
plan = read_plan(find(PLANS, sys.argv[1]), Procedures())
walk = procedure_of(plan.procedure).walk(plan.parameters)
assert walk.acts and walk.instruments and walk.prompts
print(*(name for name in {heavy!r} if name in sys.modules))
"""
NAMES = [name for name, _ in available(PLANS)]


@pytest.mark.parametrize("name", NAMES)
def test_a_dry_run_loads_no_library_of_numbers_or_pictures(name: str) -> None:
    program = WALK.format(heavy=HEAVY)
    ran = subprocess.run(
        [sys.executable, "-c", program, name], capture_output=True, text=True, check=True
    )
    assert not ran.stdout.strip()


@pytest.mark.parametrize("name", NAMES)
def test_the_walk_of_a_resumed_run_leaves_out_what_is_finished(name: str) -> None:
    plan = read_plan(find(PLANS, name), Procedures())
    procedure = procedure_of(plan.procedure)
    whole = procedure.walk(plan.parameters)
    done = whole.units[:-1]
    left = procedure.walk(plan.parameters, EarlierProgress({unit: {} for unit in done}))
    assert not set(left.units) & set(done[1:])  # the first may be a warm-up, which is done again
    if len(whole.units) > 2:
        assert left.duration().expected_s < whole.duration().expected_s
    assert set(left.instruments) <= set(whole.instruments)


def test_a_procedure_of_the_old_form_is_refused_with_what_to_change() -> None:
    shipped = procedure_of("gyro-static-noise")
    of = {"name": "lab-drift", "title": "", "source": "", "parameters": shipped.parameters}
    with pytest.raises(InputError, match=rf"lab-drift .* this is interface {INTERFACE}: leave"):
        Procedure(**of, results={}, steps=(), evaluate_run=shipped.evaluate_run, work=lambda _: ())


def test_bounds_of_data_are_in_the_walk_and_not_sent() -> None:
    plan = read_plan(find(PLANS, "serf-nonorthogonality"), Procedures())
    walk = procedure_of(plan.procedure).walk(plan.parameters)
    assert any(isinstance(command, Bounded) for command in walk.commands)


@dataclass(frozen=True)
class WithList(Command[None]):
    """A command of a laboratory's own whose fields cannot be looked up."""

    values: list[float] = field(default_factory=list)

    def words(self, bench: Bench) -> str:
        return "values"

    def apply(self, station: Station, prepared: None) -> None: ...


def measured_twice(run: Run) -> None:
    for unit in run.unfinished(["x", "x"]):
        with run.unit(unit):
            run.wait(1.0)


def waits_for_a_reading(run: Run) -> None:
    while run.read(lambda: 200.0, assumed=20.0) < 100.0:
        run.wait(1.0)


def waits_for_the_clock(run: Run) -> None:
    while run.now_s < 5.0:
        run.say_progress()


def looks_at(expression: Callable[[Any], Any]) -> Callable[[Run], None]:
    return lambda run: expression(run.role("gaussmeter", Gaussmeter))


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (measured_twice, "two units of work are named x"),
        (waits_for_a_reading, "it does not come to its end"),
        (waits_for_the_clock, "it does not come to its end"),
        (lambda run: run.wait(-50.0), "-50 s is no time"),
        (lambda run: run.wait(math.nan), "nan s is no time"),
        (lambda run: run.read(str, takes=exactly(math.inf)), "inf s is no time"),
        (lambda run: run.apply(Bounded("coil_supply.x", "more")), "give it to `run.declare`"),
        (lambda run: run.apply(WithList("coil_supply.x", [1.0])), "give it tuples"),
        (lambda run: run.apply(CoilOff("coil_supply.x")) + 1, "TypeError, .*test_dry_walks.py:"),
        (lambda run: Path("nowhere").read_bytes(), "FileNotFoundError, .*test_dry_walks.py:"),
        (looks_at(lambda meter: meter.averaging_s**2), "cannot know `gaussmeter.averaging_s`"),
        (looks_at(lambda meter: meter.averaging_s % 360), "cannot know"),
        (looks_at(lambda meter: round(meter.averaging_s)), "cannot know"),
        (looks_at(lambda meter: str(meter.averaging_s)), "cannot know"),
    ],
)
def test_a_step_that_no_dry_run_comes_through_is_refused_by_its_number(
    body: Callable[[Run], None],
    says: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dry_run, "MAX_ACTS", 10_000)
    with pytest.raises(InputError, match=f"(?s)step 7: .*{says}"):
        DryRun(None).walk([Step("7", "", body)])


def test_what_is_loaded_and_may_never_start_is_held_against_limits_too() -> None:
    loaded, started = (SineCurrent("coil_supply.x", 0.1, current_A) for current_A in (1.0, 2.0))

    def body(run: Run) -> None:
        run.prepare(loaded)
        run.prepare(started)
        run.apply(started)

    walk = DryRun(None).walk([Step("1", "", body)])
    assert set(walk.commands) == {loaded, started}
    assert len(walk.commands) == 2


def test_a_value_that_is_asked_for_is_one_that_could_be_typed() -> None:
    asked = Prompt("how-warm", "How warm?", value=AskedValue("temperature", "degC", 20.0, 90.0))
    assert DryRun(None).ask(asked) == "20 degC"
