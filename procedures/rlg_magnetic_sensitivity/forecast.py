"""What a run will command and record, step by step; no instrument is opened to say so."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.rlg_magnetic_sensitivity.check import AMPLITUDE
from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters
from procedures.rlg_magnetic_sensitivity.steps import (
    FIELD_HEADROOM,
    GAUSSMETER,
    GYRO,
    POWER,
    coil_supply,
    expected_warm_up_s,
)
from station.procedure import Forecast, Recording, SetPoint
from station.units import UnitError, parse_as

if TYPE_CHECKING:
    from station.bench import Bench


def forecast(parameters: RlgParameters, bench: Bench) -> Forecast:
    """Return the set-points of S3 to S9 and the rows of gyro and gaussmeter."""
    return Forecast(
        tuple(set_points(parameters, bench)),
        recordings(parameters, bench),
        {coil_supply(axis): AMPLITUDE for axis in parameters.axes},
    )


def set_points(parameters: RlgParameters, bench: Bench) -> Iterator[SetPoint]:
    """Yield what is commanded of each instrument, in order; S8 repeats S3 and S4."""
    interval = f"a row every {parameters.sample_interval_s:g} s"
    yield SetPoint("S3.1", POWER, "on")
    yield SetPoint("S3.1", GYRO, f"channel {parameters.channel}, {interval}")
    for number, axis in enumerate(parameters.axes):
        driven, recorded = ("S8", "S8") if number else ("S3.2", "S4")
        supply = coil_supply(axis)
        constant = str(bench.instruments[supply].settings["coil_constant"])
        amplitude_A = parameters.amplitude_mT / parse_as(constant, "mT/A")
        range_mT = FIELD_HEADROOM * parameters.amplitude_mT
        yield SetPoint(driven, GAUSSMETER, f"range for {range_mT:.4g} mT")
        yield SetPoint(
            driven,
            supply,
            f"sine {parameters.drive_frequency_Hz:.6g} Hz, {amplitude_A:.3g} A, "
            f"{parameters.amplitude_mT:.4g} mT",
            field_mT=parameters.amplitude_mT,
            current_A=amplitude_A,
            rms_current_A=amplitude_A / math.sqrt(2.0),
        )
        yield SetPoint(recorded, GYRO, f"{parameters.samples} samples for {axis}")
        yield SetPoint(recorded, supply, "0 A, output off")
    yield SetPoint("S9", POWER, "off")


def recordings(parameters: RlgParameters, bench: Bench) -> tuple[Recording, ...]:
    """Return the rows of the gyro, warm-up included, and those of the field beside it."""
    record_s = len(parameters.axes) * parameters.samples * parameters.sample_interval_s
    gyro_s = record_s + expected_warm_up_s(parameters)
    return (
        Recording(GYRO, math.ceil(gyro_s / parameters.sample_interval_s), gyro_s),
        Recording(GAUSSMETER, math.ceil(record_s / reading_period_s(parameters, bench)), record_s),
    )


def reading_period_s(parameters: RlgParameters, bench: Bench) -> float:
    """Return the seconds between two readings of the field: the gaussmeter's averaging time.

    Where the bench file gives none that can be read, one reading in each sample of the gyro.
    """
    given = bench.instruments[GAUSSMETER].settings.get("averaging")
    try:
        averaging_s = parse_as(given, "s")
    except UnitError:
        return parameters.sample_interval_s
    return averaging_s if averaging_s > 0 else parameters.sample_interval_s
