"""Step P1 of a commissioning: each coil's field at the place of the device and about it."""

from __future__ import annotations

from procedures.commissioning.coils.steps import (
    EARTH_FIELD_MT,
    GAUSSMETER,
    PLACE_PROBE,
    RANGE_HEADROOM,
    follow_field,
    supply_of,
)
from station.method.commands import CoilOff, CoilOn, FieldRange, SteadyField
from station.method.duration import on_the_way
from station.method.run import Run
from station.method.verbs import require_off
from station.procedure import Prompt, Step
from station.roles import DirectCurrentSupply

from .parameters import COILS, DEVICE, MOVE_MM, PLACES, PlaceRecord, ProbeParameters, ProbePlace

FIELD = ("parameters", "probe", "field")
RAMP_S = 4.0
BACK = Prompt("move-probe-back", "Move the probe back to the place of the device.")


def move_of(place: ProbePlace) -> Prompt:
    """Return what a person is asked to do to bring the probe to a place."""
    if place == DEVICE:
        return PLACE_PROBE
    axis, sense = place.name.split("-")
    way = {"plus": f"+{axis}", "minus": f"-{axis}"}[sense]
    return Prompt(
        f"move-probe-{place.name}",
        f"All coils are off. Move the probe by {MOVE_MM:g} mm from the place of the device towards "
        f"{way}, without turning it.",
    )


def places(run: Run) -> None:
    """P1: the probe at each place, there each coil alone in both senses."""
    parameters: ProbeParameters = run.parameters.probe
    for coil in COILS:
        run.role(supply_of(coil), DirectCurrentSupply).programme_limits()
    run.apply(field_range(parameters))
    for place in PLACES:
        records = parameters.records_at(place)
        if all(run.is_finished(record.unit) for record in records):
            continue
        all_off(run)
        run.may_pause()
        run.ask(move_of(place))
        for record in run.unfinished(records, lambda record: record.unit, pauses=False):
            measure(run, record)
        all_off(run)
    run.ask(BACK)


STEPS = (Step("P1", "Place of the probe and homogeneity, by moving the probe", places),)


def field_range(parameters: ProbeParameters) -> FieldRange:
    """Return the range of the probe; the ambient field adds to the coil's."""
    range_mT = RANGE_HEADROOM * (parameters.field_mT + EARTH_FIELD_MT)
    return FieldRange(GAUSSMETER, range_mT, decided_by=FIELD)


def coil_field(record: PlaceRecord) -> SteadyField:
    """Return the steady field of a record."""
    return SteadyField(supply_of(record.coil), record.field_mT, decided_by=FIELD)


def all_off(run: Run) -> None:
    """Switch every coil off and prove it, before a hand comes near."""
    for coil in COILS:
        run.apply(CoilOff(supply_of(coil)))
        require_off(run, supply_of(coil))


def measure(run: Run, record: PlaceRecord) -> None:
    """Record the field of one coil in one sense."""
    parameters: ProbeParameters = run.parameters.probe
    supply = supply_of(record.coil)
    run.apply(CoilOn(supply))
    run.apply(coil_field(record), takes=on_the_way(RAMP_S))
    with run.unit(record.unit):
        follow_field(run, record.unit, parameters.settle_s, parameters.record_s)
    if record.sense == "minus":
        run.apply(CoilOff(supply))
