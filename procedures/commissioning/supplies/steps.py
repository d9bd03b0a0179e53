"""Steps V1 and V2 of a commissioning: what each supply does on its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.coils.parameters import COILS
from procedures.commissioning.coils.steps import LOOK_S, PLACE_PROBE
from procedures.commissioning.coils.work import GAUSSMETER, supply_of
from station.method.commands import CoilOff
from station.method.verbs import Follower, keep_row
from station.procedure import Prompt, Step
from station.roles import DirectCurrentSupply, Gaussmeter

from .parameters import (
    COMMANDED,
    FLOWS,
    SupplyParameters,
    before_unit,
    cut_unit,
    limit_unit,
)
from .work import beyond_limit, cut, field_range

if TYPE_CHECKING:
    from station.method.run import Run

COLUMNS = {FLOWS: "A, read back", COMMANDED: "A, asked for beyond the limit"}


def prompts(parameters: SupplyParameters) -> tuple[Prompt, ...]:
    """Return what the operator is asked to do."""
    return (PLACE_PROBE,)


def own_limits(run: Run) -> None:
    """V1: a low limit into each supply, and a little more than that asked of it."""
    run.ask(PLACE_PROBE)
    parameters: SupplyParameters = run.parameters.supplies
    for coil in COILS:
        supply, unit = supply_of(coil), limit_unit(coil)
        run.role(supply, DirectCurrentSupply).programme_limits()
        if run.is_finished(unit):
            continue
        run.may_pause()
        with run.unit(unit):
            flows_A = run.apply(beyond_limit(parameters, coil))
            keep_row(run, unit, supply, COLUMNS, flows_A, parameters.asked_A)


def cuts(run: Run) -> None:
    """V2: a small current cut off, and whether its field is gone."""
    parameters: SupplyParameters = run.parameters.supplies
    for coil in COILS:
        if run.is_finished(before_unit(coil)) and run.is_finished(cut_unit(coil)):
            continue
        run.may_pause()
        run.apply(field_range(parameters, coil))
        if not run.is_finished(before_unit(coil)):
            with run.unit(before_unit(coil)):
                follow_field(run, before_unit(coil))
        with run.unit(cut_unit(coil)):
            run.apply(cut(parameters, coil))
            follow_field(run, cut_unit(coil))
        # Whatever the field shows: to zero within the slew limit, then off.
        run.apply(CoilOff(supply_of(coil)))


def follow_field(run: Run, unit: str) -> None:
    """Wait until what was averaged before is past, then record the field."""
    parameters: SupplyParameters = run.parameters.supplies
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    run.wait(parameters.settle_s, unit)
    gaussmeter.drain()
    until_s = run.now_s + parameters.record_s
    Follower(run, {GAUSSMETER: gaussmeter}).follow(until_s, unit, unit, LOOK_S)


STEPS = (
    Step("V1", "Supplies: a limit of their own acts", own_limits),
    Step("V2", "Supplies: an output that is cut off carries nothing", cuts),
)
