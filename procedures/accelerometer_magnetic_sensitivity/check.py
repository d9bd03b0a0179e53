"""Why a plan cannot run on a bench; nothing is energised to find out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.accelerometer_magnetic_sensitivity.parameters import AccelerometerParameters
from station.procedure import Problem

if TYPE_CHECKING:
    from station.bench import Bench

SUPPLY = "coil_supply.dc"
GAUSSMETER = "gaussmeter"
MULTIMETER = "multimeter"
THERMOMETER = "thermometer"
STAGE = "rotary_stage"
POWER = "dut_power"
LARGEST_FIELD = ("parameters", "largest_field")
ANGLES = ("parameters", "angles")


def instruments(parameters: AccelerometerParameters) -> tuple[str, ...]:
    """Return the bench instances that a plan needs, in the order in which they are opened."""
    needed = (SUPPLY, GAUSSMETER, MULTIMETER, STAGE, POWER)
    return (*needed, THERMOMETER) if parameters.temperature else needed


def check(parameters: AccelerometerParameters, bench: Bench) -> Iterator[Problem]:
    """Yield each field at which the gaussmeter's calibration record states no uncertainty."""
    gaussmeter = bench.instruments.get(GAUSSMETER)
    record = gaussmeter.calibration if gaussmeter else None
    for field_mT in parameters.field_levels_mT:
        if record is not None and not record.covers("field", field_mT, "mT"):
            yield Problem(
                LARGEST_FIELD,
                f"the gaussmeter's calibration record states no uncertainty at {field_mT:g} mT",
            )
