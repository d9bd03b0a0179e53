"""A dry run walks the steps of every shipped plan with nothing but the plan."""

from __future__ import annotations

import subprocess
import sys

import pytest

from station.errors import InputError
from station.files.lookup import PLANS, available, find
from station.files.plan import read_plan
from station.method.run import EarlierProgress
from station.method.set_points import Bounded
from station.procedure import INTERFACE, Procedure, Procedures, procedure_of

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
