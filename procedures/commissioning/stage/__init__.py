"""The part of the rotary stage: sense, zero, whole turn and axis, by the accelerometer on it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station import registry
from station.procedure import LazyImport, Problem, RecordUse

from .parameters import RESULTS, WHOLE_DEG, StageParameters
from .steps import ANGLE, KEY, METER, POWER, STAGE, STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has a rotary stage, and a voltmeter for the accelerometer on it."""
    return all(name in bench.instruments for name in (STAGE, METER, POWER))


def records(parameters: StageParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the uncertainty of an angle."""
    return (
        RecordUse(*ANGLE, needed=False, corrected=False),
        RecordUse(STAGE, "graduation", WHOLE_DEG, "deg", needed=False, corrected=False),
        RecordUse(METER, "voltage", parameters.scale_factor_V_per_g, "V", needed=False),
    )


def check(parameters: StageParameters, bench: Bench) -> Iterator[Problem]:
    """Yield an integration time that the voltmeter does not have."""
    meter = bench.instruments.get(METER)
    if meter is None or registry.why_not(registry.DRIVERS, meter.driver):
        return
    driver = registry.load(registry.DRIVERS, meter.driver)
    if parameters.nplc not in driver.integration_cycles:
        known = ", ".join(f"{cycles:g}" for cycles in driver.integration_cycles)
        yield Problem((*KEY, "nplc"), f"the {METER} integrates over {known} power-line cycles")


STAGE_PART = Part(
    name="stage",
    steps=STEPS,
    results=RESULTS,
    records=records,
    check=check,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
)
