"""The parameters of a laser-gyro magnetic-sensitivity plan, and what the method allows."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from procedures.common.thresholds import (
    FIELD_DIFFERS,
    GAP,
    MODEL_TOO_STIFF,
    NOT_SIGNIFICANT,
    OUTLIER,
)
from procedures.rlg_magnetic_sensitivity import frequencies
from procedures.rlg_magnetic_sensitivity.frequencies import (
    FEWEST_CYCLES,
    FREQUENCY_RANGE_HZ,
    LARGEST_CYCLES_PER_SAMPLE,
    LARGEST_UNDRIVEN,
)
from station.fields import Hertz, StrictModel, Unit, WarmUpWindow

Axis = Literal["IA", "NA", "LA"]
COIL_OF_AXIS: dict[str, str] = {"IA": "x", "NA": "y", "LA": "z"}
"""S1 turns the gyro so that IA, NA and LA are parallel to the coils' normals X, Y and Z."""

AMPLITUDE_RANGE_MT = (0.1, 2.0)
Check = Literal["linearity", "frequency", "background"]


class WarmUp(WarmUpWindow):
    """When the gyro counts as warm: |slope| + 2 u of its output below a limit over a window."""

    slope_limit_deg_per_h2: Annotated[float, Unit("deg/h^2"), Field(gt=0)]
    window_s: Annotated[float, Unit("s"), Field(gt=0)] = 600.0
    at_most_s: Annotated[float, Unit("s"), Field(gt=0)] = 5400.0


class Stop(StrictModel):
    """When a record is long enough: what ends it before `at_most`."""

    uncertainty_deg_per_h_per_mT: Annotated[float, Unit("deg/h/mT"), Field(gt=0)] | None = None
    early_decision: bool = False
    at_most_s: Annotated[float, Unit("s"), Field(gt=0)]

    @field_validator("at_most_s")
    @classmethod
    def something_to_wait_for(cls, at_most_s: float, info: ValidationInfo) -> float:
        """Refuse a stop that nothing but its time-out could bring about."""
        given = info.data
        if given.get("uncertainty_deg_per_h_per_mT") is None and not given.get("early_decision"):
            raise ValueError("say what ends a record before: uncertainty, or early_decision: true")
        return at_most_s


class Thresholds(StrictModel):
    """Where a flag is raised; the defaults are those of the result format."""

    not_significant: Annotated[float, Field(gt=0)] = NOT_SIGNIFICANT
    quadrature_significant: Annotated[float, Field(gt=0)] = 3.0
    field_differs_from_commanded: Annotated[float, Unit("1"), Field(gt=0)] = FIELD_DIFFERS
    gap: Annotated[float, Field(gt=1)] = GAP
    non_integer_cycles: Annotated[float, Field(gt=0)] = 0.001
    model_too_stiff: Annotated[float, Field(gt=0)] = MODEL_TOO_STIFF
    checks_differ: Annotated[float, Field(gt=0)] = 3.0


class AnalysisSettings(Thresholds):
    """With the choices of the estimator, which no plan states among its thresholds.

    Ratios are multiples of the standard uncertainty unless the name says otherwise;
    `non_integer_cycles` is in cycles, `gap` in nominal intervals,
    `field_differs_from_commanded` is relative; `undriven_sensitivity` (deg/h/mT) is the
    largest magnitude of the sensitivity of an axis that was not driven.
    """

    outlier: float = OUTLIER
    max_drift_order: int = 4
    max_autoregression_order: int = 16
    fewest_cycles: float = 3.0
    highest_frequency: float = 0.45
    undriven_sensitivity: float = LARGEST_UNDRIVEN

    @property
    def undriven_u(self) -> float:
        """The standard uncertainty of such a sensitivity: uniform between the bounds."""
        return self.undriven_sensitivity / math.sqrt(3.0)


class RlgParameters(StrictModel):
    """What the engineer chooses; the published ranges are enforced."""

    excitation: Literal["sequential", "simultaneous"] = "sequential"
    axes: tuple[Axis, ...] = ("IA", "NA", "LA")
    frequency_Hz: Annotated[float, Unit("Hz")] | None = Field(default=None, validate_default=True)
    amplitude_mT: Annotated[float, Unit("mT")]
    sample_interval_s: Annotated[float, Unit("s"), Field(gt=0)]
    duration_s: Annotated[float, Unit("s"), Field(gt=0)]
    frequencies_Hz: dict[Axis, Hertz] | None = Field(default=None, validate_default=True)
    stop: Stop | None = None
    checks: tuple[Check, ...] = ()
    settle_s: Annotated[float, Unit("s"), Field(ge=0)] = 20.0
    warm_up: WarmUp
    pulse_weight_arcsec: Annotated[float, Unit("arcsec"), Field(gt=0)]
    channel: Annotated[int, Field(ge=1, le=3)] = 1
    undriven_sensitivity_deg_per_h_per_mT: Annotated[float, Unit("deg/h/mT"), Field(ge=0)] = (
        LARGEST_UNDRIVEN
    )
    thresholds: Thresholds = Thresholds()

    @field_validator("axes")
    @classmethod
    def each_axis_once(cls, axes: tuple[Axis, ...], info: ValidationInfo) -> tuple[Axis, ...]:
        """Refuse an empty list, an axis named twice, and one axis alone driven simultaneously."""
        if not axes or len(set(axes)) != len(axes):
            raise ValueError("name at least one of IA, NA, LA, each once")
        if len(axes) == 1 and info.data.get("excitation") == "simultaneous":
            raise ValueError("simultaneous excitation needs two or three axes")
        return axes

    @field_validator("frequency_Hz")
    @classmethod
    def published_frequency(cls, frequency_Hz: float | None, info: ValidationInfo) -> float | None:
        """Refuse a frequency outside the published range."""
        if frequency_Hz is None:
            if info.data.get("excitation") == "sequential":
                raise ValueError("is missing; only with simultaneous excitation it is chosen")
            return None
        return within_published_range(frequency_Hz)

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
        return resolving(sample_interval_s, info.data.get("frequency_Hz"))

    @field_validator("duration_s")
    @classmethod
    def enough_cycles(cls, duration_s: float, info: ValidationInfo) -> float:
        """Refuse fewer than ten cycles (the source's T >= 10/f)."""
        return holding_enough_cycles(duration_s, info.data.get("frequency_Hz"))

    @field_validator("frequencies_Hz")
    @classmethod
    def frequencies_stand_apart(
        cls, given: dict[Axis, float] | None, info: ValidationInfo
    ) -> dict[Axis, float] | None:
        """Refuse frequencies whose lines fall on one another, and where none can be chosen."""
        data = info.data
        if data.get("excitation") != "simultaneous":
            if given is not None:
                raise ValueError("belong to excitation: simultaneous")
            return None
        needed = ("axes", "sample_interval_s", "duration_s", "frequency_Hz")
        if any(name not in data for name in needed):
            return given  # what is wrong there is reported there
        axes, interval_s = data["axes"], data["sample_interval_s"]
        record_s = math.ceil(data["duration_s"] / interval_s - 1e-9) * interval_s
        if given is None:
            decided = frequencies.with_first(axes, data["frequency_Hz"])
            if frequencies.choose(axes, record_s, interval_s, decided) is None:
                none = f"no {len(axes)} frequencies in a record of {record_s:g} s stand apart"
                if decided:
                    none = f"{none} with {decided[0][1]:g} Hz"
                raise ValueError(f"{none}; take a longer record")
            return None
        if set(given) != set(axes):
            raise ValueError(f"must name {', '.join(axes)}, each driven axis once")
        if data["frequency_Hz"] is not None:
            raise ValueError("stand in the place of frequency; take one of the two out")
        for f in given.values():
            within_published_range(f)
            resolving(interval_s, f)
            holding_enough_cycles(record_s, f)
        made: dict[str, float] = {
            axis: frequencies.whole_cycles_Hz(f, record_s) for axis, f in given.items()
        }
        if fault := frequencies.clash(made, record_s, interval_s):
            raise ValueError(fault)
        return given

    @field_validator("stop")
    @classmethod
    def at_most_beyond_duration(cls, stop: Stop | None, info: ValidationInfo) -> Stop | None:
        """Refuse a record that would have to end before its least duration."""
        duration_s = info.data.get("duration_s")
        if stop is not None and duration_s is not None and stop.at_most_s < duration_s:
            raise ValueError(f"at_most may not be below the least duration of {duration_s:g} s")
        return stop

    @field_validator("checks")
    @classmethod
    def checks_can_be_done(
        cls, checks: tuple[Check, ...], info: ValidationInfo
    ) -> tuple[Check, ...]:
        """Refuse a check named twice, and half a field below the published range."""
        if len(set(checks)) != len(checks):
            raise ValueError("name each check once")
        least_mT = 2.0 * AMPLITUDE_RANGE_MT[0]
        if "linearity" in checks and info.data.get("amplitude_mT", least_mT) < least_mT:
            raise ValueError(
                f"linearity repeats the measurement at half the amplitude, which must be at least "
                f"{AMPLITUDE_RANGE_MT[0]:g} mT"
            )
        return checks


def within_published_range(frequency_Hz: float) -> float:
    """Return a frequency; refuse one outside the published range."""
    low, high = FREQUENCY_RANGE_HZ
    if not low <= frequency_Hz <= high:
        raise ValueError(f"the method is published for {low:g} Hz to {high:g} Hz")
    return frequency_Hz


def resolving(sample_interval_s: float, frequency_Hz: float | None) -> float:
    """Return a sample interval; refuse one that cannot resolve twice a drive frequency."""
    if frequency_Hz and sample_interval_s * frequency_Hz > LARGEST_CYCLES_PER_SAMPLE:
        longest_s = LARGEST_CYCLES_PER_SAMPLE / frequency_Hz
        raise ValueError(f"at {frequency_Hz:g} Hz it may be {longest_s:g} s at most")
    return sample_interval_s


def holding_enough_cycles(duration_s: float, frequency_Hz: float | None) -> float:
    """Return a duration; refuse fewer than ten cycles."""
    if frequency_Hz and duration_s < FEWEST_CYCLES / frequency_Hz * (1 - 1e-9):
        needed_s = FEWEST_CYCLES / frequency_Hz
        raise ValueError(
            f"the method needs T >= 10/f, which is {needed_s:g} s at {frequency_Hz:g} Hz"
        )
    return duration_s
