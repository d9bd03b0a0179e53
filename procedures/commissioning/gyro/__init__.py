"""The part of the laser gyro: its channel, and its pulse weight by the earth's rate at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.parts import Part
from station.procedure import LazyImport, RecordUse

from .parameters import RESULTS, GyroParameters
from .steps import GYRO, POWER, SCALE, STEPS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from station.instruments.bench import Bench


def is_possible(bench: Bench) -> bool:
    """Return whether a bench acquires a laser gyro's pulses."""
    return all(name in bench.instruments for name in (GYRO, POWER))


def not_tried(parameters: GyroParameters) -> Mapping[str, str]:
    """Return why the pulse weight is not reported."""
    if parameters.earth is not None:
        return {}
    why = "the pulse weight was not compared with the earth's rate: state what the gyro feels of it"
    return {PULSE_WEIGHT_STEP: f"{why} in parameters.gyro.earth"}


PULSE_WEIGHT_STEP = "G2"


def records(parameters: GyroParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the pulse weight's uncertainty."""
    return (RecordUse(*SCALE, needed=False),)


GYRO_PART = Part(
    name="gyro",
    steps=STEPS,
    results=RESULTS,
    records=records,
    findings=LazyImport(f"{__name__}.evaluate:findings"),
    is_possible=is_possible,
    not_tried=not_tried,
)
