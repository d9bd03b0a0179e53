"""What a run will command and record, step by step; no instrument is opened to say so."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from procedures.estimation.grouping import averaged_rows
from procedures.rlg_magnetic_sensitivity.check import AMPLITUDE
from procedures.rlg_magnetic_sensitivity.measuring import (
    FIELD_HEADROOM,
    GAUSSMETER,
    coil_supply,
)
from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters
from procedures.rlg_magnetic_sensitivity.records import PlannedRecord, all_records
from procedures.rlg_magnetic_sensitivity.warming import GYRO, POWER, expected_warm_up_s
from station import registry
from station.console import span
from station.procedure import Forecast, Recording, SetPoint
from station.units import UnitError, parse_as

if TYPE_CHECKING:
    from station.instruments.bench import Bench

KEPT_ROW_BYTES, WORKED_ROW_BYTES = 160, 600
"""What a row of a record takes to the evaluation's end, and more of it while its record is fitted:
measured by `benchmarks/memory_evaluation.py`."""


def forecast(parameters: RlgParameters, bench: Bench) -> Forecast:
    """Return the set-points of S3 to S9 and the rows of gyro and gaussmeter."""
    supplies = (coil_supply(axis) for axis in parameters.axes)
    return Forecast(
        tuple(set_points(parameters, bench)),
        recordings(parameters, bench),
        dict.fromkeys((*supplies, GAUSSMETER), AMPLITUDE),
        held_bytes(parameters, bench),
    )


def outlook(parameters: RlgParameters) -> Sequence[str]:
    """Return in lines which coil gets which frequency, and what ends a record."""
    first, lines = all_records(parameters)[0], []
    if parameters.excitation == "simultaneous":
        told = ", ".join(f"{axis} {sine.frequency_Hz:.4g} Hz" for axis, sine in first.drive.items())
        lines.append(f"all coils at once: {told}")
    if parameters.stop is not None:
        least_s, most_s = (n * parameters.sample_interval_s for n in (first.samples, first.most))
        lines.append(
            f"a record ends by itself after {span(least_s)} to {span(most_s)}; the time above "
            "is the longest"
        )
    return lines


def set_points(parameters: RlgParameters, bench: Bench) -> Iterator[SetPoint]:
    """Yield what is commanded of each instrument, in order; S8 repeats S3 and S4."""
    interval = f"a row every {parameters.sample_interval_s:g} s"
    yield SetPoint("S3.1", POWER, "on")
    yield SetPoint("S3.1", GYRO, f"channel {parameters.channel}, {interval}")
    for number, planned in enumerate(all_records(parameters)):
        driven, recorded = ("S8", "S8") if number else ("S3.2", "S4")
        yield field_set_point(driven, parameters, planned)
        for axis in planned.energised:
            supply, sine = coil_supply(axis), planned.drive[axis]
            constant = str(bench.instruments[supply].settings["coil_constant"])
            amplitude_A = sine.amplitude_mT / parse_as(constant, "mT/A")
            yield SetPoint(
                driven,
                supply,
                f"sine {sine.frequency_Hz:.6g} Hz, {amplitude_A:.3g} A, {sine.amplitude_mT:.4g} mT",
                field_mT=sine.amplitude_mT,
                current_A=amplitude_A,
                rms_current_A=amplitude_A / math.sqrt(2.0),
            )
        longer = f" to {planned.most}" if planned.most > planned.samples else ""
        yield SetPoint(recorded, GYRO, f"{planned.samples}{longer} samples for {planned.unit}")
        for axis in planned.energised:
            yield SetPoint(recorded, coil_supply(axis), "0 A, output off")
    yield SetPoint("S9", POWER, "off")


def field_set_point(step: str, parameters: RlgParameters, planned: PlannedRecord) -> SetPoint:
    """Return what the gaussmeter is set to; several coils add up where their peaks coincide."""
    together_mT = planned.largest_field_mT
    range_mT = FIELD_HEADROOM * (together_mT or parameters.amplitude_mT)
    text = f"range for {range_mT:.4g} mT"
    if len(planned.energised) < 2:
        return SetPoint(step, GAUSSMETER, text)
    text += f"; the coils together reach {together_mT:.4g} mT"
    return SetPoint(step, GAUSSMETER, text, field_mT=together_mT)


def recordings(parameters: RlgParameters, bench: Bench) -> tuple[Recording, ...]:
    """Return the rows of the gyro, warm-up included, and those of the field beside it."""
    samples = sum(planned.most for planned in all_records(parameters))
    record_s = samples * parameters.sample_interval_s
    gyro_s = record_s + expected_warm_up_s(parameters)
    return (
        Recording(GYRO, math.ceil(gyro_s / parameters.sample_interval_s), gyro_s),
        Recording(GAUSSMETER, math.ceil(record_s / reading_period_s(parameters, bench)), record_s),
    )


def held_bytes(parameters: RlgParameters, bench: Bench) -> int:
    """Return the most bytes that the evaluation holds: every record's, and one's at work.

    A long record is averaged while it is read, and no more of it is ever in memory.
    """
    period_s = reading_period_s(parameters, bench)
    rows = [0]
    for planned in all_records(parameters):
        highest_Hz = max(sine.frequency_Hz for sine in planned.drive.values())
        samples = averaged_rows(planned.most, parameters.sample_interval_s, highest_Hz)
        readings = math.ceil(planned.most * parameters.sample_interval_s / period_s)
        rows.append(max(samples, averaged_rows(readings, period_s, highest_Hz)))
    return KEPT_ROW_BYTES * sum(rows) + WORKED_ROW_BYTES * max(rows)


def reading_period_s(parameters: RlgParameters, bench: Bench) -> float:
    """Return the seconds between two readings of the field: the gaussmeter's averaging time.

    One that keeps no readings is read at each look. Where the bench file gives no time that can be
    read, one reading in each sample of the gyro.
    """
    from station.runner.acquisition import POLL_S

    gaussmeter = bench.instruments[GAUSSMETER]
    if not registry.load(registry.DRIVERS, gaussmeter.driver).keeps_readings:
        return POLL_S
    given = gaussmeter.settings.get("averaging")
    try:
        averaging_s = parse_as(given, "s")
    except UnitError:
        return parameters.sample_interval_s
    return averaging_s if averaging_s > 0 else parameters.sample_interval_s
