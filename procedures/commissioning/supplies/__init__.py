"""The part of the supplies: a limit of their own acts, and an output that is off is off."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.coils import fits as fits_coils
from procedures.commissioning.coils import is_possible as has_coils
from procedures.commissioning.coils.parameters import COILS
from procedures.commissioning.coils.steps import GAUSSMETER, supply_of
from procedures.commissioning.parts import Part
from station import registry
from station.procedure import LazyImport, RecordUse

from .parameters import RESULTS, SupplyParameters
from .steps import FIELD_OF_CUT, STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has three coils, whose supplies can prove themselves, and a probe."""
    drivers = [bench.instruments[supply_of(coil)].driver for coil in COILS if has_coils(bench)]
    return bool(drivers) and all(
        not registry.why_not(registry.DRIVERS, driver)
        and hasattr(registry.load(registry.DRIVERS, driver), "cut_off")
        for driver in drivers
    )


def fits(bench: Bench) -> Iterator[str]:
    """Yield that a probe of one axis is turned."""
    yield from (fit.replace(".coils.", ".supplies.") for fit in fits_coils(bench))


def records(parameters: SupplyParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the gaussmeter's gain."""
    return (
        RecordUse(*FIELD_OF_CUT, corrected=False),
        RecordUse(GAUSSMETER, "angle", 0.0, "deg", needed=False, corrected=False),
    )


SUPPLY_PART = Part(
    name="supplies",
    steps=STEPS,
    results=RESULTS,
    records=records,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
    fits=fits,
)
