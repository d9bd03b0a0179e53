"""What the pick-up part commands and records."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.coils.work import supply_of
from station.method.commands import CoilOff, MeterRange, Power, SineField
from station.method.work import Rows, Work, on_the_way
from station.procedure import RecordUse

from .parameters import COILS, OFF, PickUpParameters, unit_of

if TYPE_CHECKING:
    from station.instruments.bench import Bench

METER, POWER = "multimeter", "dut_power"
RANGE_V, CYCLES = 0.1, 1.0
SETTLE_S, RAMPS_S = 5.0, 11.0
"""After the sine has begun; to load it, and from it to zero."""


def instruments(parameters: PickUpParameters) -> tuple[str, ...]:
    """Return the bench instances that are used."""
    return (*(supply_of(coil) for coil in COILS), METER, POWER)


def meter_range() -> MeterRange:
    """Return range and integration time of the voltmeter, one reading at a time."""
    return MeterRange(METER, RANGE_V, CYCLES, 1)


def sine(parameters: PickUpParameters, coil: str) -> SineField:
    """Return the drive of a coil."""
    return SineField(
        supply_of(coil),
        parameters.frequency_Hz,
        parameters.field_mT,
        decided_by=("parameters", "pick_up", "field"),
    )


def work(parameters: PickUpParameters) -> Iterator[Work]:
    """Yield the record with all coils off, then one with each coil driven."""
    yield Work("U1", None, (Power(POWER, False), meter_range()))
    rows = (Rows(METER, parameters.record_s, parameters.record_s / parameters.every_s),)
    for coil in (OFF, *COILS):
        commands = () if coil == OFF else (sine(parameters, coil), CoilOff(supply_of(coil)))
        yield Work(
            "U1",
            unit_of(coil),
            commands,
            rows,
            parameters.record_s + (SETTLE_S if commands else 0.0),
            decided=on_the_way(RAMPS_S if commands else 0.0),
        )


def records(parameters: PickUpParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return the voltmeter's, whose few millionths are nothing beside a limit on microvolts."""
    return (RecordUse(METER, "voltage", RANGE_V, "V", needed=False, corrected=False),)
