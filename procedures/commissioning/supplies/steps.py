"""Steps V1 and V2 of a commissioning: what each supply does on its own."""

from __future__ import annotations

from procedures.commissioning.coils.parameters import COILS
from procedures.commissioning.coils.steps import (
    EARTH_FIELD_MT,
    GAUSSMETER,
    PLACE_PROBE,
    follow_field,
    supply_of,
)
from station.method.commands import CoilOff, FieldRange
from station.method.duration import on_the_way
from station.method.run import Run
from station.method.verbs import keep_row
from station.procedure import Step
from station.roles import DirectCurrentSupply

from .commands import BeyondOwnLimit, CutOff
from .parameters import COMMANDED, FLOWS, SupplyParameters, before_unit, cut_unit, limit_unit

WHERE = ("parameters", "supplies")
FIELD_OF_CUT = (GAUSSMETER, "field", 0.1, "mT")
RANGE_MT, RAMP_S = 0.5, 3.0
"""A few hundred mA in a coil of up to 0.4 mT/A, and the ambient field."""
COLUMNS = {FLOWS: "A, read back", COMMANDED: "A, asked for beyond the limit"}


def own_limits(run: Run) -> None:
    """V1: a low limit into each supply, and a little more than that asked of it."""
    run.ask(PLACE_PROBE)
    parameters: SupplyParameters = run.parameters.supplies
    for coil in COILS:
        supply = supply_of(coil)
        run.role(supply, DirectCurrentSupply).programme_limits()
        for unit in run.unfinished([limit_unit(coil)]):
            with run.unit(unit):
                flows_A = run.apply(beyond_limit(parameters, coil), takes=on_the_way(RAMP_S))
                keep_row(run, unit, supply, COLUMNS, flows_A, parameters.asked_A)


def cuts(run: Run) -> None:
    """V2: a small current cut off, and whether its field is gone."""
    parameters: SupplyParameters = run.parameters.supplies
    times_s = parameters.settle_s, parameters.record_s
    for coil in COILS:
        before, after = before_unit(coil), cut_unit(coil)
        if run.is_finished(before) and run.is_finished(after):
            continue
        run.may_pause()
        run.apply(field_range(parameters, coil))
        if not run.is_finished(before):
            with run.unit(before):
                follow_field(run, before, *times_s)
        with run.unit(after):
            run.apply(cut(parameters, coil), takes=on_the_way(RAMP_S))
            follow_field(run, after, *times_s)
        # Whatever the field shows: to zero within the slew limit, then off.
        run.apply(CoilOff(supply_of(coil)))


STEPS = (
    Step("V1", "Supplies: a limit of their own acts", own_limits),
    Step("V2", "Supplies: an output that is cut off carries nothing", cuts),
)


def field_range(parameters: SupplyParameters, coil: str) -> FieldRange:
    """Return the range of the probe, turned along a coil where it has one axis."""
    turned = coil if parameters.turn_probe else None
    return FieldRange(GAUSSMETER, RANGE_MT + EARTH_FIELD_MT, turned, decided_by=WHERE)


def beyond_limit(parameters: SupplyParameters, coil: str) -> BeyondOwnLimit:
    """Return the current beyond a supply's own limit."""
    where = (*WHERE, "limit")
    limit_A, asked_A = parameters.limit_A, parameters.asked_A
    return BeyondOwnLimit(supply_of(coil), limit_A, asked_A, decided_by=where)


def cut(parameters: SupplyParameters, coil: str) -> CutOff:
    """Return the current that is cut off."""
    return CutOff(supply_of(coil), parameters.cut_at_A, decided_by=(*WHERE, "cut_at"))
