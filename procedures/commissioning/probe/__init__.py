"""The part of the probe: where it stands in the coils, and how even their field is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.coils import is_possible as has_coils
from procedures.commissioning.coils.steps import GAUSSMETER
from procedures.commissioning.parts import Part
from station import registry
from station.procedure import LazyImport, RecordUse

from .parameters import COILS, RESULTS, ProbeParameters
from .steps import STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has three coils and a gaussmeter of three axes."""
    if not has_coils(bench):
        return False
    driver = bench.instruments[GAUSSMETER].driver
    if registry.why_not(registry.DRIVERS, driver):
        return False
    return bool(registry.load(registry.DRIVERS, driver).axes == len(COILS))


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


PROBE_PART = Part(
    name="probe",
    steps=STEPS,
    results=RESULTS,
    records=records,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
)
