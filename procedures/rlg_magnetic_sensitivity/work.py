"""What a run of a plan commands and records, and why a plan cannot run on a bench.

The steps apply the commands that are declared here; forecast, limits and durations come from them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from procedures.rlg_magnetic_sensitivity.frequencies import averaged_rows
from procedures.rlg_magnetic_sensitivity.parameters import COIL_OF_AXIS, RlgParameters
from procedures.rlg_magnetic_sensitivity.records import PlannedRecord, all_records
from station import registry
from station.console import span
from station.method.commands import CoilOff, FieldRange, GyroSampling, Power, SineField
from station.method.set_points import Bounded
from station.method.work import (
    POLL_S,
    Duration,
    Rows,
    Work,
    on_the_way,
    reading_period_s,
)
from station.procedure import Problem, RecordUse

if TYPE_CHECKING:
    from station.instruments.bench import Bench

GYRO, POWER, GAUSSMETER = "gyro_acquisition", "dut_power", "gaussmeter"
WARM_UP = "warm-up"
AMPLITUDE = ("parameters", "amplitude")
UPLOAD_S, RAMP_DOWN_S = 5.0, 1.0
WARM_UP_LOOKS_EVERY_S = 30.0
WARM_UP_WINDOWS = 1.3
"""So many windows the warm-up is expected to take."""
FIELD_HEADROOM = 1.5
"""The gaussmeter's range covers the field of all coils together and the ambient field."""
KEPT_ROW_BYTES, WORKED_ROW_BYTES = 160, 600
"""What a row of a record takes to the evaluation's end, and more of it while its record is fitted:
measured by `benchmarks/memory_evaluation.py`."""


def coil_supply(axis: str) -> str:
    """Return the supply whose coil drives a gyro axis."""
    return f"coil_supply.{COIL_OF_AXIS[axis]}"


def instruments(parameters: RlgParameters) -> tuple[str, ...]:
    """Return the bench instances the plan needs."""
    return (*(coil_supply(axis) for axis in parameters.axes), GAUSSMETER, GYRO, POWER)


def gyro_sampling(parameters: RlgParameters) -> GyroSampling:
    """Return how the gyro is read out."""
    return GyroSampling(GYRO, parameters.sample_interval_s, parameters.channel)


def field_range(parameters: RlgParameters, planned: PlannedRecord) -> FieldRange:
    """Return the range of a record's field; several coils add up where their peaks coincide."""
    together_mT = planned.largest_field_mT
    return FieldRange(
        GAUSSMETER,
        FIELD_HEADROOM * (together_mT or parameters.amplitude_mT),
        COIL_OF_AXIS[next(iter(planned.drive))],
        together_mT if len(planned.energised) > 1 else None,
        decided_by=AMPLITUDE,
    )


def sines(planned: PlannedRecord) -> dict[str, SineField]:
    """Return the sine of each coil of a record that carries current."""
    return {
        axis: SineField(
            coil_supply(axis),
            planned.drive[axis].frequency_Hz,
            planned.drive[axis].amplitude_mT,
            decided_by=AMPLITUDE,
        )
        for axis in planned.energised
    }


def work(parameters: RlgParameters) -> Iterator[Work]:
    """Yield the warm-up, each record with its field, and the end; S8 repeats S3 and S4."""
    interval_s = parameters.sample_interval_s
    rule = parameters.warm_up
    warm_s = min(WARM_UP_WINDOWS * rule.window_s, rule.at_most_s)
    yield Work(
        "S3.1",
        WARM_UP,
        (Power(POWER, True), gyro_sampling(parameters)),
        (Rows(GYRO, warm_s, warm_s / interval_s),),
        decided=Duration(warm_s, rule.window_s, rule.at_most_s + WARM_UP_LOOKS_EVERY_S + POLL_S),
    )
    for number, planned in enumerate(all_records(parameters)):
        drive, record = ("S8", "S8") if number else ("S3.2", "S4")
        coils, record_s = len(planned.energised), planned.most * interval_s
        yield Work(
            drive,
            planned.unit,
            (field_range(parameters, planned), *sines(planned).values()),
            duration_s=parameters.settle_s if coils else 0.0,
            decided=on_the_way(UPLOAD_S * coils),
        )
        longer = f" to {planned.most}" if planned.most > planned.samples else ""
        longer_s = (planned.most - planned.samples) * interval_s
        # A record is seen to be long enough at the look after its last sample.
        lasts_longer = Duration(longer_s + POLL_S / 2.0, 0.0, longer_s + 2.0 * POLL_S)
        yield Work(
            record,
            planned.unit,
            (
                Bounded(GYRO, f"{planned.samples}{longer} samples for {planned.unit}"),
                *(CoilOff(coil_supply(axis)) for axis in planned.energised),
            ),
            (Rows(GYRO, record_s, planned.most), Rows(GAUSSMETER, record_s)),
            planned.samples * interval_s,
            decided=sum((off_s(planned, axis) for axis in planned.energised), lasts_longer),
        )
    yield Work("S9", commands=(Power(POWER, False),))


def off_s(planned: PlannedRecord, axis: str) -> Duration:
    """Return how long a coil takes to be off: its sine goes on to a zero, then the rest is ramped.

    That zero is a quarter of a period away in the mean, and half of one at most.
    """
    period_s = 1.0 / planned.drive[axis].frequency_Hz
    return Duration(period_s / 4.0, 0.0, period_s / 2.0) + on_the_way(RAMP_DOWN_S)


def held_bytes(parameters: RlgParameters, bench: Bench) -> int:
    """Return the most bytes that the evaluation holds: every record's, and one's at work.

    A long record is averaged while it is read, and no more of it is ever in memory.
    """
    period_s = reading_period_s(bench, GAUSSMETER)
    rows = [0]
    for planned in all_records(parameters):
        highest_Hz = max(sine.frequency_Hz for sine in planned.drive.values())
        samples = averaged_rows(planned.most, parameters.sample_interval_s, highest_Hz)
        readings = math.ceil(planned.most * parameters.sample_interval_s / period_s)
        rows.append(max(samples, averaged_rows(readings, period_s, highest_Hz)))
    return KEPT_ROW_BYTES * sum(rows) + WORKED_ROW_BYTES * max(rows)


def outlook(parameters: RlgParameters) -> Sequence[str]:
    """Return in lines which coil gets which frequency, and what ends a record."""
    first, lines = all_records(parameters)[0], []
    if parameters.excitation == "simultaneous":
        drive = ", ".join(
            f"{axis} {sine.frequency_Hz:.4g} Hz" for axis, sine in first.drive.items()
        )
        lines.append(f"all coils at once: {drive}")
    if parameters.stop is not None:
        least_s, most_s = (n * parameters.sample_interval_s for n in (first.samples, first.most))
        lines.append(
            f"a record ends by itself after {span(least_s)} to {span(most_s)}; the time above "
            "is the longest"
        )
    return lines


def records(parameters: RlgParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records.

    An uncertainty of the gaussmeter's direction is needed where it sees one axis alone.
    """
    return (
        RecordUse(GAUSSMETER, "field", parameters.amplitude_mT, "mT"),
        RecordUse(GAUSSMETER, "angle", 0.0, "deg", needed=sees_one_axis(bench), corrected=False),
        RecordUse(GYRO, "scale", 1.0, "1"),
    )


def sees_one_axis(bench: Bench) -> bool:
    """Whether the bench's gaussmeter sees the field along one axis alone.

    Where its driver is not installed a recorded run is evaluated; `check` had its record state the
    uncertainty of the angle then, so nothing depends on the answer.
    """
    gaussmeter = bench.instruments.get(GAUSSMETER)
    if gaussmeter is None or registry.why_not(registry.DRIVERS, gaussmeter.driver):
        return False
    return bool(registry.load(registry.DRIVERS, gaussmeter.driver).axes == 1)


def check(parameters: RlgParameters, bench: Bench) -> Iterator[Problem]:
    """Yield what the gaussmeter cannot see, and what its calibration record leaves out."""
    gaussmeter = bench.instruments.get(GAUSSMETER)
    states = ("uncertainty", "field") in bench.statements(GAUSSMETER)
    if states and bench.stated(GAUSSMETER, "field", parameters.amplitude_mT, "mT") is None:
        yield Problem(
            AMPLITUDE,
            f"the gaussmeter's calibration record states no uncertainty at "
            f"{parameters.amplitude_mT:g} mT",
        )
    if gaussmeter is None or not sees_one_axis(bench):
        return
    if parameters.excitation == "simultaneous":
        yield Problem(
            ("parameters", "excitation"),
            f"the gaussmeter ({gaussmeter.driver}) measures one axis at a time; with it the coils "
            "are driven one after the other: sequential",
        )
    if bench.stated(GAUSSMETER, "angle", 0.0, "deg") is None:
        yield Problem(
            ("procedure",),
            f"the gaussmeter ({gaussmeter.driver}) measures one axis; its calibration record must "
            "state the uncertainty of the angle at which its probe stands",
        )
