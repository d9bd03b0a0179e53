"""Why a plan cannot run on a bench, and what its analysis takes of calibration records."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.common.stage_and_meter import (
    MULTIMETER,
    STAGE,
    THERMOMETER,
    USUAL_DEGC,
    problems_of_meter,
)
from station.procedure import Problem, RecordUse

from .measuring import FULL_TURN_DEG, GAUSSMETER, LARGEST_FIELD
from .parameters import AccelerometerParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def records(parameters: AccelerometerParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records.

    The temperature is one that the results hold at, the zero of the angle counts where the angles
    of the plan do not tell it from the mounting: of neither a record is needed.
    """
    apart = {"needed": False}
    return (
        RecordUse(GAUSSMETER, "field", parameters.largest_field_mT, "mT"),
        RecordUse(GAUSSMETER, "angle", 0.0, "deg", needed=False, corrected=False),
        RecordUse(MULTIMETER, "voltage", parameters.scale_factor_V_per_g, "V"),
        RecordUse(STAGE, "angle", 0.0, "deg", **apart),
        RecordUse(STAGE, "graduation", FULL_TURN_DEG, "deg", needed=False, corrected=False),
        RecordUse(THERMOMETER, "temperature", USUAL_DEGC, "degC", **apart),
    )


def check(parameters: AccelerometerParameters, bench: Bench) -> Iterator[Problem]:
    """Yield what the voltmeter cannot do, and fields that the gaussmeter's record leaves out."""
    yield from problems_of_meter(parameters, bench)
    states = ("uncertainty", "field") in bench.statements(GAUSSMETER)
    for field_mT in parameters.field_levels_mT if states else ():
        if bench.stated(GAUSSMETER, "field", field_mT, "mT") is None:
            yield Problem(
                LARGEST_FIELD,
                f"the gaussmeter's calibration record states no uncertainty at {field_mT:g} mT",
            )
