"""What the probe's part commands and records."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.coils.work import GAUSSMETER, supply_of
from station.method.commands import CoilOff, CoilOn, FieldRange, SteadyField
from station.method.work import Rows, Work, on_the_way
from station.procedure import RecordUse

from .parameters import COILS, PLACES, PlaceRecord, ProbeParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench

FIELD = ("parameters", "probe", "field")
RANGE_HEADROOM, EARTH_FIELD_MT = 1.5, 0.1
RAMP_S = 4.0


def instruments(parameters: ProbeParameters) -> tuple[str, ...]:
    """Return the bench instances that are used."""
    return (*(supply_of(coil) for coil in COILS), GAUSSMETER)


def field_range(parameters: ProbeParameters) -> FieldRange:
    """Return the range of the probe; the ambient field adds to the coil's."""
    range_mT = RANGE_HEADROOM * (parameters.field_mT + EARTH_FIELD_MT)
    return FieldRange(GAUSSMETER, range_mT, decided_by=FIELD)


def coil_field(record: PlaceRecord) -> SteadyField:
    """Return the steady field of a record."""
    return SteadyField(supply_of(record.coil), record.field_mT, decided_by=FIELD)


def work(parameters: ProbeParameters) -> Iterator[Work]:
    """Yield each coil's fields of both senses at every place."""
    each_s = parameters.settle_s + parameters.record_s
    rows = (Rows(GAUSSMETER, each_s, read_s=parameters.record_s),)
    yield Work("P1", commands=(field_range(parameters),))
    for place in PLACES:
        for record in parameters.records_at(place):
            supply = supply_of(record.coil)
            commands = (CoilOn(supply), coil_field(record))
            yield Work("P1", record.unit, commands, rows, each_s, decided=on_the_way(RAMP_S))
        off = tuple(CoilOff(supply_of(coil)) for coil in COILS)
        yield Work("P1", commands=off)


def records(parameters: ProbeParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return the gaussmeter's, of which shares of a field need no gain and no zero."""
    # In the budget, with a part of zero: gain and zero leave the ratio of two differences alone.
    return (
        RecordUse(
            GAUSSMETER,
            "field",
            parameters.field_mT,
            "mT",
            in_budget=True,
            needed=False,
            corrected=False,
        ),
    )
