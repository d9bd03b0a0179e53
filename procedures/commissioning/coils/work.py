"""What a commissioning commands and records, and why it cannot be done on a bench."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station import registry
from station.method.commands import CoilOff, CoilOn, FieldRange, SteadyField
from station.method.work import Rows, Work, on_the_way
from station.procedure import Problem, RecordUse

from .parameters import COILS, CoilParameters, CoilRecord, ambient_unit

if TYPE_CHECKING:
    from station.instruments.bench import Bench

GAUSSMETER = "gaussmeter"
FIELD = ("parameters", "coils", "field")
RANGE_HEADROOM, EARTH_FIELD_MT = 1.5, 0.1
RAMP_S = 1.0


def supply_of(coil: str) -> str:
    """Return the supply of a coil."""
    return f"coil_supply.{coil}"


def instruments(parameters: CoilParameters) -> tuple[str, ...]:
    """Return the bench instances that are commissioned."""
    return (*(supply_of(coil) for coil in COILS), GAUSSMETER)


def field_range(parameters: CoilParameters, along: str) -> FieldRange:
    """Return the range of the probe along a direction; the ambient field adds to the coil's."""
    range_mT = RANGE_HEADROOM * (parameters.field_mT + EARTH_FIELD_MT)
    turned = along if parameters.turn_probe else None
    return FieldRange(GAUSSMETER, range_mT, turned, decided_by=FIELD)


def coil_field(record: CoilRecord) -> SteadyField:
    """Return the steady field of a record."""
    return SteadyField(supply_of(record.coil), record.field_mT, decided_by=FIELD)


def work(parameters: CoilParameters) -> Iterator[Work]:
    """Yield the ambient field along each direction, then each coil's fields of both senses."""
    each_s = parameters.settle_s + parameters.record_s
    rows = (Rows(GAUSSMETER, each_s, read_s=parameters.record_s),)
    for along in parameters.directions:
        turn = (field_range(parameters, along),)
        yield Work("C1", ambient_unit(along), turn, rows, each_s)
    for along in reversed(parameters.directions):
        yield Work("C2", commands=(field_range(parameters, along),))
        for record in parameters.coil_records(along):
            supply = supply_of(record.coil)
            off = record.state == "off"
            first = (CoilOn(supply),) if record.state == "plus" else ()
            commands = (CoilOff(supply),) if off else (*first, coil_field(record))
            yield Work("C2", record.unit, commands, rows, each_s, decided=on_the_way(RAMP_S))


def records(parameters: CoilParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the gaussmeter's gain, zero, angle."""
    return (
        RecordUse(GAUSSMETER, "field", parameters.field_mT, "mT", corrected=False),
        RecordUse(GAUSSMETER, "angle", 0.0, "deg", needed=False, corrected=False),
    )


def check(parameters: CoilParameters, bench: Bench) -> Iterator[Problem]:
    """Yield that a probe of one axis has to be turned."""
    gaussmeter = bench.instruments.get(GAUSSMETER)
    if gaussmeter is None or registry.why_not(registry.DRIVERS, gaussmeter.driver):
        return
    if registry.load(registry.DRIVERS, gaussmeter.driver).axes == 1 and not parameters.turn_probe:
        yield Problem(
            ("parameters", "coils", "turn_probe"),
            f"the gaussmeter ({gaussmeter.driver}) measures one axis; write `turn_probe: true`",
        )
