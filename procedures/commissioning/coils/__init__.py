"""The part of the coils: what coils, their supplies and the field probe do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station import registry
from station.procedure import LazyImport, Problem, RecordUse

from .limits import DRIFT
from .parameters import COILS, RESULTS, CoilParameters
from .steps import GAUSSMETER, STEPS, supply_of

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has three coils and a gaussmeter."""
    needed = (GAUSSMETER, *(supply_of(coil) for coil in COILS))
    return all(name in bench.instruments for name in needed)


def fits(bench: Bench) -> Iterator[str]:
    """Yield that a probe of one axis is turned."""
    driver = bench.instruments[GAUSSMETER].driver
    if registry.why_not(registry.DRIVERS, driver):
        return
    if registry.load(registry.DRIVERS, driver).axes == 1:
        yield "parameters.coils.turn_probe=true"


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


COIL_PART = Part(
    name="coils",
    steps=STEPS,
    results=RESULTS,
    records=records,
    check=check,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
    fits=fits,
    drift=DRIFT,
    short=("parameters.coils.record=2 s",),
    completes=LazyImport(f"{__name__}.completing:completions"),
    may_stand=frozenset({"coil-constant-off"}),
)
