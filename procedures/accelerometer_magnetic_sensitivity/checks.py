"""Why a plan cannot run on a bench, and what its analysis takes of calibration records."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station import registry
from station.procedure import Problem, RecordUse

from .measuring import (
    FULL_TURN_DEG,
    GAUSSMETER,
    LARGEST_FIELD,
    MULTIMETER,
    STAGE,
    THERMOMETER,
    USUAL_DEGC,
    first_range,
)
from .parameters import AccelerometerParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.roles import Multimeter


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
    if MULTIMETER in bench.instruments:
        driver = registry.load(registry.DRIVERS, bench.instruments[MULTIMETER].driver)
        yield from meter_problems(parameters, driver)
    states = ("uncertainty", "field") in bench.statements(GAUSSMETER)
    for field_mT in parameters.field_levels_mT if states else ():
        if bench.stated(GAUSSMETER, "field", field_mT, "mT") is None:
            yield Problem(
                LARGEST_FIELD,
                f"the gaussmeter's calibration record states no uncertainty at {field_mT:g} mT",
            )


def meter_problems(
    parameters: AccelerometerParameters, driver: type[Multimeter]
) -> Iterator[Problem]:
    """Yield integration time, range and burst that the voltmeter's driver says it cannot do."""
    if parameters.nplc not in driver.integration_cycles:
        known = ", ".join(f"{cycles:g}" for cycles in driver.integration_cycles)
        yield Problem(
            ("parameters", "nplc"),
            f"the {MULTIMETER} cannot integrate over {parameters.nplc:g} power-line cycles; it can "
            f"do {known}",
        )
    if parameters.readings > driver.most_readings:
        yield Problem(
            ("parameters", "readings"),
            f"the {MULTIMETER} takes {driver.most_readings} readings in a burst at most",
        )
    largest_V = first_range(parameters).largest_V
    if largest_V > driver.highest_V:
        yield Problem(
            ("parameters", "scale_factor"),
            f"the {MULTIMETER} must hold {largest_V:g} V, its highest range ends at "
            f"{driver.highest_V:g} V",
        )
