"""The part of the coils: what coils, their supplies and the field probe do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station import registry
from station.procedure import LazyImport

from .limits import DRIFT
from .parameters import COILS, RESULTS
from .steps import STEPS, prompts
from .work import GAUSSMETER, check, instruments, records, supply_of, work

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


COIL_PART = Part(
    name="coils",
    steps=STEPS,
    results=RESULTS,
    instruments=instruments,
    work=work,
    prompts=prompts,
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
