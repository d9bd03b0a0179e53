"""What a plan determines and needs, before anything moves; and why a bench does not fit it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from station import registry
from station.console import span
from station.method.dry_run import reading_period_s
from station.procedure import Problem, RecordUse

from .frequencies import averaged_rows
from .parameters import RlgParameters
from .records import GAUSSMETER, GYRO, all_records
from .steps import AMPLITUDE

if TYPE_CHECKING:
    from station.instruments.bench import Bench

KEPT_ROW_BYTES, WORKED_ROW_BYTES = 160, 600
"""What a row of a record takes to the evaluation's end, and more of it while its record is fitted:
measured by `benchmarks/memory_evaluation.py`."""


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


def limited_results(parameters: RlgParameters) -> Mapping[str, tuple[str, ...]]:
    """Return the results that need a limit: all, where the plan stops when they are decided."""
    early = parameters.stop is not None and parameters.stop.early_decision
    return {"magnetic_sensitivity": tuple(parameters.axes)} if early else {}
