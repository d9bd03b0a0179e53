"""The part of pick-up: what the voltmeter reads of driven coils while the device is off."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.coils.steps import supply_of
from procedures.commissioning.parts import Part
from station.procedure import LazyImport, RecordUse

from .parameters import COILS, RESULTS, PickUpParameters
from .steps import METER, POWER, RANGE_V, STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has three coils, a voltmeter and a supply of the device."""
    needed = (METER, POWER, *(supply_of(coil) for coil in COILS))
    return all(name in bench.instruments for name in needed)


def records(parameters: PickUpParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return the voltmeter's, whose few millionths are nothing beside a limit on microvolts."""
    return (RecordUse(METER, "voltage", RANGE_V, "V", needed=False, corrected=False),)


PICK_UP_PART = Part(
    name="pick_up",
    steps=STEPS,
    results=RESULTS,
    records=records,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
)
