"""The part of the clocks: an instrument that stamps its readings keeps the station's time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.coils.steps import GAUSSMETER
from procedures.commissioning.parts import Part
from station import registry
from station.procedure import LazyImport

from .parameters import RESULTS
from .steps import STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has a gaussmeter that stamps its readings."""
    gaussmeter = bench.instruments.get(GAUSSMETER)
    if gaussmeter is None or registry.why_not(registry.DRIVERS, gaussmeter.driver):
        return False
    return bool(registry.load(registry.DRIVERS, gaussmeter.driver).keeps_readings)


CLOCK_PART = Part(
    name="clocks",
    steps=STEPS,
    results=RESULTS,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
    drift={"gaussmeter_clock_error": 50.0},
)
