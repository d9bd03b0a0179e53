"""Steps C1 and C2 of a commissioning: the room's field, then each coil's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.method.commands import CoilOff, CoilOn
from station.method.verbs import Follower, keep_row, require_off
from station.procedure import Prompt, Step
from station.roles import DirectCurrentSupply, Gaussmeter

from .parameters import COILS, CoilParameters, CoilRecord, ambient_unit
from .work import GAUSSMETER, coil_field, field_range, supply_of

if TYPE_CHECKING:
    from station.method.run import Run

CURRENT_COLUMNS = {
    "current_A": "A, read back",
    "commanded_A": "A, set-point by the bench's coil constant",
}
PLACE_PROBE = Prompt(
    "place-probe",
    "Set the gaussmeter's probe at the place of the device, its axes along the coils x, y, z; take "
    "the device and all iron and magnets away.",
)


def prompts(parameters: CoilParameters) -> tuple[Prompt, ...]:
    """Return what the operator is asked to do."""
    return (PLACE_PROBE,)


def ambient(run: Run) -> None:
    """C1: limits into the supplies, then the field with all coils off."""
    run.ask(PLACE_PROBE)
    parameters: CoilParameters = run.parameters.coils
    for coil in COILS:
        run.role(supply_of(coil), DirectCurrentSupply).programme_limits()
    for along in parameters.directions:
        unit = ambient_unit(along)
        if run.is_finished(unit):
            continue
        run.may_pause()
        run.apply(field_range(parameters, along))
        with run.unit(unit):
            follow_field(run, unit)


def coils(run: Run) -> None:
    """C2: a small field of each sense from each coil alone, then its output off."""
    parameters: CoilParameters = run.parameters.coils
    for along in reversed(parameters.directions):
        wanted = parameters.coil_records(along)
        if all(run.is_finished(record.unit) for record in wanted):
            continue
        run.apply(field_range(parameters, along))
        for coil in COILS:
            of_coil = [record for record in wanted if record.coil == coil]
            if not all(run.is_finished(record.unit) for record in of_coil):
                run.may_pause()
                run.apply(CoilOn(supply_of(coil)))
                for record in of_coil:
                    measure(run, record)


def measure(run: Run, record: CoilRecord) -> None:
    """Record the field of one coil, and the current that its supply reads back."""
    supply = supply_of(record.coil)
    if record.state == "off":
        run.apply(CoilOff(supply))
        require_off(run, supply)
    else:
        run.apply(coil_field(record))
    if run.is_finished(record.unit):
        return
    with run.unit(record.unit):
        if record.state != "off":
            source = run.role(supply, DirectCurrentSupply)
            commanded_A = record.field_mT / source.coil_constant_mT_per_A
            keep_row(run, record.unit, supply, CURRENT_COLUMNS, source.current_A(), commanded_A)
        follow_field(run, record.unit)


def follow_field(run: Run, unit: str) -> None:
    """Wait until what was averaged before is past, then record the field."""
    parameters: CoilParameters = run.parameters.coils
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    run.wait(parameters.settle_s, unit)
    gaussmeter.drain()
    until_s = run.now_s + parameters.record_s
    Follower(run, {GAUSSMETER: gaussmeter}).follow(until_s, unit, unit, LOOK_S)


LOOK_S = 0.5
"""A gaussmeter that keeps no readings gives ten in a record of five seconds."""

STEPS = (
    Step("C1", "Ambient field and its noise, all coils off", ambient),
    Step("C2", "Coils: polarity, axis, constant, cross-axis, output off", coils),
)
