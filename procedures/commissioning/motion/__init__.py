"""The part of the table: sense, encoder and direction of its axes, by a sensor on it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station import registry
from station.procedure import LazyImport, Problem, RecordUse
from station.roles.turntable import table_axes, unnamed_axes

from .parameters import RESULTS, MotionParameters
from .parameters import TURN_DEG as TURN_DEG
from .placing import ANGLE, IMU, MOTION, NAVIGATOR, POWER, TURNTABLE
from .steps import STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench

NAVIGATOR_HZ = 10.0


def is_possible(bench: Bench) -> bool:
    """Return whether a bench has a table of three named axes, and a sensor or a navigator."""
    if any(name not in bench.instruments for name in (TURNTABLE, POWER)):
        return False
    if not {IMU, NAVIGATOR} & set(bench.instruments):
        return False
    return table_axes(bench.instruments[TURNTABLE].settings) is not None


def fits(bench: Bench) -> Iterator[str]:
    """Yield that a navigator stands in for a sensor that a bench does not have."""
    if IMU not in bench.instruments:
        yield f"parameters.motion.device={NAVIGATOR}"


def records(parameters: MotionParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the uncertainty of an angle."""
    return (RecordUse(*ANGLE, needed=False, corrected=False),)


def check(parameters: MotionParameters, bench: Bench) -> Iterator[Problem]:
    """Yield axes that the bench file does not name, and a rate that the sensor does not have."""
    table, sensor = (bench.instruments.get(name) for name in (TURNTABLE, parameters.device))
    if table is not None:
        for what in unnamed_axes(TURNTABLE, table.settings):
            yield Problem(("parameters", "checks"), f"{what}, or leave out motion")
    if sensor is None or registry.why_not(registry.DRIVERS, sensor.driver):
        return
    if parameters.device == NAVIGATOR and parameters.sample_rate_Hz > NAVIGATOR_HZ:
        yield Problem((*MOTION, "sample_rate"), f"a navigator outputs {NAVIGATOR_HZ:g} Hz at most")
    driver = registry.load(registry.DRIVERS, sensor.driver)
    if refusal := getattr(driver, "rates_said", lambda rate_Hz: "")(parameters.sample_rate_Hz):
        yield Problem((*MOTION, "sample_rate"), refusal)


MOTION_PART = Part(
    name="motion",
    steps=STEPS,
    results=RESULTS,
    records=records,
    check=check,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
    fits=fits,
)
