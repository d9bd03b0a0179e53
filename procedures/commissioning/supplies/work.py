"""What the supplies' part commands and records, and why it cannot be done on a bench."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.coils.parameters import COILS
from procedures.commissioning.coils.work import EARTH_FIELD_MT, GAUSSMETER, supply_of
from station.method.commands import CoilOff, FieldRange
from station.method.work import Rows, Work, on_the_way
from station.procedure import RecordUse

from .commands import BeyondOwnLimit, CutOff
from .parameters import SupplyParameters, before_unit, cut_unit, limit_unit

if TYPE_CHECKING:
    from station.instruments.bench import Bench

WHERE = ("parameters", "supplies")
FIELD_OF_CUT = (GAUSSMETER, "field", 0.1, "mT")
RANGE_MT, RAMP_S = 0.5, 3.0
"""A few hundred mA in a coil of up to 0.4 mT/A, and the ambient field."""


def instruments(parameters: SupplyParameters) -> tuple[str, ...]:
    """Return the bench instances that are commissioned."""
    return (*(supply_of(coil) for coil in COILS), GAUSSMETER)


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


def work(parameters: SupplyParameters) -> Iterator[Work]:
    """Yield what each supply is asked for beyond its limit, and the fields around a cut."""
    each_s = parameters.settle_s + parameters.record_s
    rows = (Rows(GAUSSMETER, each_s, read_s=parameters.record_s),)
    for coil in COILS:
        yield Work(
            "V1", limit_unit(coil), (beyond_limit(parameters, coil),), decided=on_the_way(RAMP_S)
        )
    for coil in COILS:
        turn = (field_range(parameters, coil),)
        yield Work("V2", before_unit(coil), turn, rows, each_s)
        commands = (cut(parameters, coil), CoilOff(supply_of(coil)))
        yield Work("V2", cut_unit(coil), commands, rows, each_s, decided=on_the_way(RAMP_S))


def records(parameters: SupplyParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the gaussmeter's gain."""
    return (
        RecordUse(*FIELD_OF_CUT, corrected=False),
        RecordUse(GAUSSMETER, "angle", 0.0, "deg", needed=False, corrected=False),
    )
