"""The part of the probe: where it stands in the coils, and how even their field is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.coils import is_possible as has_coils
from procedures.commissioning.coils.work import GAUSSMETER
from procedures.commissioning.parts import Part
from station import registry
from station.procedure import LazyImport

from .parameters import COILS, RESULTS
from .steps import STEPS, prompts
from .work import instruments, records, work

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


PROBE_PART = Part(
    name="probe",
    steps=STEPS,
    results=RESULTS,
    instruments=instruments,
    work=work,
    prompts=prompts,
    records=records,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
)
