"""The records that a plan asks for: which coils are driven, how, and for how many samples.

Nothing here opens an instrument: validation, the forecast, the steps and the analysis of a run all
go by the same list.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from procedures.rlg_magnetic_sensitivity import frequencies
from procedures.rlg_magnetic_sensitivity.frequencies import Drive
from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters

GYRO, GAUSSMETER = "gyro_acquisition", "gaussmeter"
"""The instruments whose rows make a record."""
Purpose = Literal["sensitivity", "linearity", "frequency", "background"]
LOOK_S = 20.0
"""Least time between two looks at whether a record is long enough."""


@dataclass(frozen=True)
class PlannedRecord:
    """One record: a unit of work.

    `drive` maps each axis to its sine; at an amplitude of zero its coil stays off and only the
    gyro's line at that frequency is looked at. A record has at least `samples` and at most `most`,
    in between a multiple of `block`: whole cycles of every drive.
    """

    unit: str
    purpose: Purpose
    drive: Mapping[str, Drive]
    samples: int
    block: int
    most: int

    @property
    def energised(self) -> tuple[str, ...]:
        """The axes whose coils carry current."""
        return tuple(axis for axis, drive in self.drive.items() if drive.amplitude_mT > 0.0)

    @property
    def largest_field_mT(self) -> float:
        """The magnitude of the field where the peaks of all coils coincide."""
        return math.hypot(*(drive.amplitude_mT for drive in self.drive.values()))

    def whole_blocks(self, samples: float) -> int:
        """Return the samples of a record of at least so many, within what it may have."""
        blocks = math.ceil(samples / self.block - 1e-9) * self.block
        return min(max(blocks, self.samples), self.most)


def reading_back_s(samples: int, interval_s: float) -> float:
    """Return the real time in s that a busy computer may need to look through a record.

    A step that does so gives no other sign of life meanwhile.
    """
    return 30.0 + 5e-6 * samples + 1e-3 * samples * interval_s


def sensitivity_records(parameters: RlgParameters) -> tuple[PlannedRecord, ...]:
    """Return the records that the results come from, in their order."""
    if parameters.excitation == "simultaneous":
        return (simultaneous(parameters, "sensitivity", parameters.amplitude_mT),)
    return tuple(
        sequential(parameters, axis, "sensitivity", axis, parameters.amplitude_mT)
        for axis in parameters.axes
    )


def check_records(parameters: RlgParameters) -> tuple[PlannedRecord, ...]:
    """Return the records that only test the results, in their order."""
    return tuple(record for check in parameters.checks for record in check_of(parameters, check))


def all_records(parameters: RlgParameters) -> tuple[PlannedRecord, ...]:
    """Return every record of a run, in its order; what tests the results comes after them."""
    return (*sensitivity_records(parameters), *check_records(parameters))


def check_of(parameters: RlgParameters, check: Purpose) -> tuple[PlannedRecord, ...]:
    """Return the records of one check."""
    whole, at_once = parameters.amplitude_mT, parameters.excitation == "simultaneous"
    if check == "background":
        if at_once:
            return (simultaneous(parameters, check, 0.0),)
        return (sequential(parameters, "background", check, parameters.axes[0], 0.0),)
    amplitude_mT = whole / 2 if check == "linearity" else whole
    if at_once:
        return (simultaneous(parameters, check, amplitude_mT),)
    return tuple(
        sequential(parameters, f"{axis}-{check}", check, axis, amplitude_mT)
        for axis in parameters.axes
    )


def sequential(
    parameters: RlgParameters, unit: str, purpose: Purpose, axis: str, amplitude_mT: float
) -> PlannedRecord:
    """Return the record of one coil alone; its frequency makes whole cycles in whole samples."""
    interval_s, f = parameters.sample_interval_s, parameters.frequency_Hz or 0.0
    if purpose == "frequency":
        f = frequencies.second_frequency_Hz(f, parameters.duration_s, interval_s)
    stop = parameters.stop if purpose == "sensitivity" else None
    block_s = LOOK_S if stop else parameters.duration_s
    cycles = math.ceil(f * block_s - 1e-9)
    block = round(cycles / (f * interval_s))
    drive = {axis: Drive(cycles / (block * interval_s), amplitude_mT)}
    return bounded(parameters, unit, purpose, drive, block)


def simultaneous(parameters: RlgParameters, purpose: Purpose, amplitude_mT: float) -> PlannedRecord:
    """Return the record of all coils at once; every frequency makes whole cycles in it.

    The check of the frequency exchanges the frequencies between the axes.
    """
    axes, interval_s = parameters.axes, parameters.sample_interval_s
    samples = math.ceil(parameters.duration_s / interval_s - 1e-9)
    record_s = samples * interval_s
    chosen: Mapping[str, float] | None = None
    if parameters.frequencies_Hz is not None:
        chosen = dict(parameters.frequencies_Hz.items())
    else:
        decided = frequencies.with_first(axes, parameters.frequency_Hz)
        chosen = frequencies.choose(axes, record_s, interval_s, decided)
    driven = [frequencies.whole_cycles_Hz((chosen or {})[axis], record_s) for axis in axes]
    if purpose == "frequency":
        driven = [*driven[1:], driven[0]]
    drive: dict[str, Drive] = {
        axis: Drive(f, amplitude_mT) for axis, f in zip(axes, driven, strict=True)
    }
    common = math.gcd(samples, *(round(f * record_s) for f in driven))
    fits = [d for d in range(1, common + 1) if common % d == 0 and record_s / d >= LOOK_S]
    unit = "-".join(axes)
    unit = {"sensitivity": unit, "background": "background"}.get(purpose, f"{unit}-{purpose}")
    return bounded(parameters, unit, purpose, drive, samples // max(fits, default=1))


def bounded(
    parameters: RlgParameters, unit: str, purpose: Purpose, drive: Mapping[str, Drive], block: int
) -> PlannedRecord:
    """Return a record of whole blocks; only one that the results come from may become longer."""
    interval_s = parameters.sample_interval_s
    samples = math.ceil(parameters.duration_s / interval_s / block - 1e-9) * block
    stop = parameters.stop if purpose == "sensitivity" else None
    most = samples
    if stop is not None:
        most = max(samples, math.floor(stop.at_most_s / interval_s / block + 1e-9) * block)
    return PlannedRecord(unit, purpose, drive, samples, block, most)
