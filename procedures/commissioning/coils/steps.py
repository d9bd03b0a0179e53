"""Steps C1 and C2 of a commissioning: the room's field, then each coil's."""

from __future__ import annotations

from station.method.commands import CoilOff, CoilOn, FieldRange, SteadyField
from station.method.duration import on_the_way
from station.method.run import Run
from station.method.verbs import Recording, keep_row, require_off
from station.procedure import Prompt, Step
from station.roles import DirectCurrentSupply, Gaussmeter

from .parameters import COILS, CoilParameters, CoilRecord, ambient_unit

GAUSSMETER = "gaussmeter"
FIELD = ("parameters", "coils", "field")
RANGE_HEADROOM, EARTH_FIELD_MT = 1.5, 0.1
RANGE_S, RAMP_S = 0.5, 1.0
LOOK_S = 0.5
"""A gaussmeter that keeps no readings gives ten in a record of five seconds."""
CURRENT_COLUMNS = {
    "current_A": "A, read back",
    "commanded_A": "A, set-point by the bench's coil constant",
}
PLACE_PROBE = Prompt(
    "place-probe",
    "Set the gaussmeter's probe at the place of the device, its axes along the coils x, y, z; take "
    "the device and all iron and magnets away.",
)


def ambient(run: Run) -> None:
    """C1: limits into the supplies, then the field with all coils off."""
    run.ask(PLACE_PROBE)
    parameters: CoilParameters = run.parameters.coils
    for coil in COILS:
        run.role(supply_of(coil), DirectCurrentSupply).programme_limits()
    for along in run.unfinished(parameters.directions, ambient_unit):
        run.apply(field_range(parameters, along), takes=on_the_way(RANGE_S))
        with run.unit(ambient_unit(along)):
            follow_field(run, ambient_unit(along), parameters.settle_s, parameters.record_s)


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


STEPS = (
    Step("C1", "Ambient field and its noise, all coils off", ambient),
    Step("C2", "Coils: polarity, axis, constant, cross-axis, output off", coils),
)


def supply_of(coil: str) -> str:
    """Return the supply of a coil."""
    return f"coil_supply.{coil}"


def field_range(parameters: CoilParameters, along: str) -> FieldRange:
    """Return the range of the probe along a direction; the ambient field adds to the coil's."""
    range_mT = RANGE_HEADROOM * (parameters.field_mT + EARTH_FIELD_MT)
    turned = along if parameters.turn_probe else None
    return FieldRange(GAUSSMETER, range_mT, turned, decided_by=FIELD)


def coil_field(record: CoilRecord) -> SteadyField:
    """Return the steady field of a record."""
    return SteadyField(supply_of(record.coil), record.field_mT, decided_by=FIELD)


def measure(run: Run, record: CoilRecord) -> None:
    """Record the field of one coil, and the current that its supply reads back.

    A coil is driven as before where the record is finished: what follows is measured after that.
    """
    if run.is_finished(record.unit):
        drive(run, record)
        return
    supply, parameters = supply_of(record.coil), run.parameters.coils
    with run.toward(record.unit):
        drive(run, record)
        with run.unit(record.unit):
            if record.state != "off":
                source = run.role(supply, DirectCurrentSupply)
                commanded_A = run.read(lambda: record.field_mT / source.coil_constant_mT_per_A)
                current_A = source.current_A()
                keep_row(run, record.unit, supply, CURRENT_COLUMNS, current_A, commanded_A)
            follow_field(run, record.unit, parameters.settle_s, parameters.record_s)


def drive(run: Run, record: CoilRecord) -> None:
    """Bring a coil to the field of a record, or off and proven so."""
    if record.state != "off":
        run.apply(coil_field(record), takes=on_the_way(RAMP_S))
        return
    run.apply(CoilOff(supply_of(record.coil)), takes=on_the_way(RAMP_S))
    require_off(run, supply_of(record.coil))


def follow_field(run: Run, unit: str, settle_s: float, record_s: float) -> None:
    """Wait until what was averaged before is past, then record the field."""
    run.wait(settle_s, unit)
    run.role(GAUSSMETER, Gaussmeter).drain()
    Recording(run, unit, {GAUSSMETER: None}).follow(record_s, unit, every_s=LOOK_S)
