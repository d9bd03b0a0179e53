"""The parameters of a laser-gyro magnetic-sensitivity plan, and what the method allows."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from station.fields import StrictModel, Unit

Axis = Literal["IA", "NA", "LA"]
COIL_OF_AXIS: dict[str, str] = {"IA": "x", "NA": "y", "LA": "z"}
"""S1 turns the gyro so that IA, NA and LA are parallel to the coils' normals X, Y and Z."""

FREQUENCY_RANGE_HZ = (0.05, 0.2)
AMPLITUDE_RANGE_MT = (0.1, 2.0)
FEWEST_CYCLES = 10
LARGEST_CYCLES_PER_SAMPLE = 0.2
"""Above this the line at twice the drive frequency comes too near to the Nyquist frequency."""


class WarmUp(StrictModel):
    """When the gyro counts as warm: |slope| + 2 u of its output below a limit over a window."""

    slope_limit_deg_per_h2: Annotated[float, Unit("deg/h^2"), Field(gt=0)]
    window_s: Annotated[float, Unit("s"), Field(gt=0)] = 600.0
    at_most_s: Annotated[float, Unit("s"), Field(gt=0)] = 5400.0

    @field_validator("at_most_s")
    @classmethod
    def longer_than_window(cls, at_most_s: float, info: ValidationInfo) -> float:
        """Refuse a time-out that ends before the window can be full."""
        window_s = info.data.get("window_s")
        if window_s is not None and at_most_s < window_s:
            raise ValueError(f"the warm-up may not end before its window of {window_s:g} s is full")
        return at_most_s


class Thresholds(StrictModel):
    """Where a flag is raised; the defaults are those of the result format."""

    not_significant: Annotated[float, Field(gt=0)] = 2.0
    quadrature_significant: Annotated[float, Field(gt=0)] = 3.0
    field_differs_from_commanded: Annotated[float, Unit("1"), Field(gt=0)] = 0.01
    gap: Annotated[float, Field(gt=1)] = 1.5
    non_integer_cycles: Annotated[float, Field(gt=0)] = 0.001
    model_too_stiff: Annotated[float, Field(gt=0)] = 0.3


class RlgParameters(StrictModel):
    """What the engineer chooses; the published ranges are enforced."""

    frequency_Hz: Annotated[float, Unit("Hz")]
    amplitude_mT: Annotated[float, Unit("mT")]
    sample_interval_s: Annotated[float, Unit("s"), Field(gt=0)]
    duration_s: Annotated[float, Unit("s"), Field(gt=0)]
    axes: tuple[Axis, ...] = ("IA", "NA", "LA")
    settle_s: Annotated[float, Unit("s"), Field(ge=0)] = 20.0
    warm_up: WarmUp
    pulse_weight_arcsec: Annotated[float, Unit("arcsec"), Field(gt=0)]
    channel: Annotated[int, Field(ge=1, le=3)] = 1
    thresholds: Thresholds = Thresholds()

    @field_validator("frequency_Hz")
    @classmethod
    def published_frequency(cls, frequency_Hz: float) -> float:
        """Refuse a frequency outside the published range."""
        low, high = FREQUENCY_RANGE_HZ
        if not low <= frequency_Hz <= high:
            raise ValueError(f"the method is published for {low:g} Hz to {high:g} Hz")
        return frequency_Hz

    @field_validator("amplitude_mT")
    @classmethod
    def published_amplitude(cls, amplitude_mT: float) -> float:
        """Refuse a field amplitude outside the published range."""
        low, high = AMPLITUDE_RANGE_MT
        if not low <= amplitude_mT <= high:
            raise ValueError(f"the method is published for {low:g} mT to {high:g} mT")
        return amplitude_mT

    @field_validator("sample_interval_s")
    @classmethod
    def resolves_the_drive(cls, sample_interval_s: float, info: ValidationInfo) -> float:
        """Refuse a sample interval that cannot resolve twice the drive frequency."""
        frequency_Hz = info.data.get("frequency_Hz")
        if frequency_Hz and sample_interval_s * frequency_Hz > LARGEST_CYCLES_PER_SAMPLE:
            longest_s = LARGEST_CYCLES_PER_SAMPLE / frequency_Hz
            raise ValueError(f"at {frequency_Hz:g} Hz it may be {longest_s:g} s at most")
        return sample_interval_s

    @field_validator("duration_s")
    @classmethod
    def enough_cycles(cls, duration_s: float, info: ValidationInfo) -> float:
        """Refuse fewer than ten cycles (the source's T >= 10/f)."""
        frequency_Hz = info.data.get("frequency_Hz")
        if frequency_Hz and duration_s < FEWEST_CYCLES / frequency_Hz * (1 - 1e-9):
            needed_s = FEWEST_CYCLES / frequency_Hz
            raise ValueError(
                f"the method needs T >= 10/f, which is {needed_s:g} s at {frequency_Hz:g} Hz"
            )
        return duration_s

    @field_validator("axes")
    @classmethod
    def each_axis_once(cls, axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
        """Refuse an empty list and an axis named twice."""
        if not axes or len(set(axes)) != len(axes):
            raise ValueError("name at least one of IA, NA, LA, each once")
        return axes

    @property
    def cycles(self) -> int:
        """Whole cycles of the drive in a record, at least as long as `duration` asks for."""
        return math.ceil(self.frequency_Hz * self.duration_s - 1e-9)

    @property
    def samples(self) -> int:
        """Samples of a record: the nearest whole number to `cycles` periods."""
        return round(self.cycles / (self.frequency_Hz * self.sample_interval_s))

    @property
    def drive_frequency_Hz(self) -> float:
        """The frequency that makes a record of `samples` hold exactly `cycles` periods."""
        return self.cycles / (self.samples * self.sample_interval_s)
