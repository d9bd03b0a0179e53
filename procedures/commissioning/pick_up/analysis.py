"""The line at the drive frequency in a voltmeter whose device is off: least squares of a sine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Analysis, Estimate, Flag, undetermined

from .limits import COVERAGE, OF_ROOM, PICK_UP_UV
from .parameters import COILS, OFF, RESULTS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PickUpReadings:
    """Readings (n,) in uV at times in s, and the frequency in Hz of the drive."""

    time_s: Array
    voltage_uV: Array
    frequency_Hz: float


@dataclass(frozen=True)
class PickUpDataset:
    """The readings by driven coil, and those with all coils `off`."""

    readings: Mapping[str, PickUpReadings]


@dataclass(frozen=True)
class Line:
    """Amplitude of a line in uV, its standard uncertainty, and the degrees of freedom."""

    amplitude_uV: float
    u_uV: float
    freedom: float


def analyse(data: PickUpDataset) -> Analysis:
    """Return the line of each coil, and a flag for each that is beyond the limit."""
    lines = {coil: line_of(reading) for coil, reading in data.readings.items()}
    method = "least squares of a sine beside an offset and a drift"
    estimates = [
        Estimate("pick_up", coil, line.amplitude_uV, "uV", line.u_uV, line.freedom, method)
        for coil, line in ((coil, lines[coil]) for coil in COILS)
    ]
    return Analysis(estimates, (), causes_of(lines))


def causes_of(lines: Mapping[str, Line]) -> tuple[Flag, ...]:
    """Return the flag of lines beyond the limit: of the leads, or of the room with coils off."""
    beyond = [coil for coil in COILS if lines[coil].amplitude_uV > limit_of(lines[coil])]
    if not beyond:
        return ()
    worst = max(beyond, key=lambda coil: lines[coil].amplitude_uV)
    line, room_uV = lines[worst], lines[OFF].amplitude_uV
    seen = (
        f"The voltmeter reads up to {line.amplitude_uV:.3g} uV (u = {line.u_uV:.1g} uV) at the "
        f"drive frequency of coil {worst}, the device off"
    )
    details = {"coils": beyond, "amplitude_uV": line.amplitude_uV}
    if room_uV > OF_ROOM * line.amplitude_uV:
        message = (
            f"{seen}, and {room_uV:.3g} uV with all coils off: the line is not the coil's. Look "
            "for what else repeats so often, or choose another frequency."
        )
        return (Flag("line-at-drive-frequency", message, details=details),)
    message = f"{seen}: twist and screen its leads, and part them from those of the coil."
    return (Flag("pick-up", message, details=details),)


def beyond_range(over: Sequence[str], range_V: float) -> Analysis:
    """Return that nothing is determined: readings with coils `over` driven exceed the range."""
    driven = " and ".join(
        "all coils off" if coil == OFF else f"coil {coil} driven" for coil in over
    )
    message = (
        f"The voltmeter reads beyond its range of {range_V:g} V with {driven}, the device off: its "
        "leads are open, or another voltage is on them."
    )
    estimates = [
        undetermined(name, axis, kind.unit, "beyond the range")
        for name, kind in RESULTS.items()
        for axis in kind.axes or (None,)
    ]
    return Analysis(estimates, (), (Flag("pick-up-beyond-range", message),))


def limit_of(line: Line) -> float:
    """Return beyond what a line is named, in uV."""
    return PICK_UP_UV + COVERAGE * line.u_uV


def line_of(data: PickUpReadings) -> Line:
    """Return the line of a record of at least six readings; ValueError of fewer."""
    if len(data.time_s) < 6:
        raise ValueError("a line needs six readings")
    time_s = data.time_s - data.time_s.mean()
    phase = 2.0 * math.pi * data.frequency_Hz * time_s
    columns = np.column_stack((np.cos(phase), np.sin(phase), np.ones_like(time_s), time_s))
    shares, *_ = np.linalg.lstsq(columns, data.voltage_uV, rcond=None)
    freedom = float(len(time_s) - len(shares))
    left = data.voltage_uV - columns @ shares
    covariance = float(left @ left) / freedom * np.linalg.inv(columns.T @ columns)
    u_uV = math.sqrt((covariance[0, 0] + covariance[1, 1]) / 2.0)
    return Line(float(np.hypot(*shares[:2])), u_uV, freedom)
