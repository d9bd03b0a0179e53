"""What the stage's part commands and records."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station import registry
from station.method.commands import Angle, Homing, MeterRange, Power
from station.method.work import Rows, Work, on_the_way
from station.procedure import Problem, RecordUse

from .parameters import WHOLE_DEG, StageParameters, StageRecord

if TYPE_CHECKING:
    from station.instruments.bench import Bench

STAGE = "rotary_stage"
METER = "multimeter"
POWER = "dut_power"
ANGLE = (STAGE, "angle", WHOLE_DEG, "deg")
"""What the stage's calibration record states."""
KEY = ("parameters", "stage")
LARGEST_G = 1.1
HOMING_S, TURN_S, MAINS_HZ = 15.0, 8.0, 50.0
AUTO_ZERO = 2.0
"""A reading with auto-zero takes twice its integration time."""


def instruments(parameters: StageParameters) -> tuple[str, ...]:
    """Return the bench instances that are commissioned."""
    return (STAGE, METER, POWER)


def meter_range(parameters: StageParameters) -> MeterRange:
    """Return how the voltmeter is read."""
    largest_V = LARGEST_G * parameters.scale_factor_V_per_g
    return MeterRange(METER, largest_V, parameters.nplc, parameters.readings)


def angle_of(record: StageRecord) -> Angle:
    """Return the angle of a record."""
    return Angle(STAGE, record.angle_deg, f"plane {record.plane}", decided_by=KEY)


def burst_s(parameters: StageParameters) -> float:
    """Return the bench time in s of one burst."""
    return AUTO_ZERO * parameters.readings * parameters.nplc / MAINS_HZ


def work(parameters: StageParameters) -> Iterator[Work]:
    """Yield the set-up, then each record."""
    setting_up = (Homing(STAGE), meter_range(parameters), Power(POWER, True))
    yield Work("R1", None, setting_up, (), parameters.warm_up_s, decided=on_the_way(HOMING_S))
    duration_s = burst_s(parameters)
    rows = (Rows(METER, duration_s, parameters.readings), Rows(STAGE, duration_s, 1))
    for record in parameters.records:
        step = "R1" if record.plane == "io" else "R2"
        yield Work(
            step, record.unit, (angle_of(record),), rows, duration_s, decided=on_the_way(TURN_S)
        )
    yield Work("R2", None, (Power(POWER, False),))


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
