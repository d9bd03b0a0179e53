"""The parameters of a plan that measures a gyro's scale factor over temperature."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from procedures.common.constants import FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.common.thresholds import GAP, MODEL_TOO_STIFF, OUTLIER
from station.fields import Celsius, Degree, StrictModel, Unit, WarmUpWindow

AXES = ("x", "y", "z")
Axis = Literal["x", "y", "z"]
Turns = Literal["as_published", "pairs", "+--+"]
PUBLISHED_SOAK_H = (4.0, 6.0)
PUBLISHED_RAMP_DEGC_PER_H = (6.0, 12.0)
"""0.5 degC to 1 degC in 5 min."""
PUBLISHED_INTERVAL_S = 600.0
PUBLISHED_ORDER = 4
"""Of the curve over temperature."""
USUAL_REFERENCE_DEGC = 20.0
"""Where the curve is zero unless plan or dataset say otherwise."""
SIGNS: dict[str, tuple[int, ...]] = {
    "as_published": (1,),
    "pairs": (1, -1),
    "+--+": (1, -1, -1, 1),
}
"""The senses of the turns about one axis in one set."""


@dataclass(frozen=True)
class Schedule:
    """A set: each axis is turned up, then makes its turns, from rest to rest.

    `turns` are those about one axis; the table settles before and after each, pauses between them.
    """

    interval_s: float
    axes: int
    turns: int
    settle_s: float
    pause_s: float
    reorientation_s: float
    rate_deg_per_s: float
    acceleration_deg_per_s2: float

    @property
    def motion_s(self) -> float:
        """The time that the table turns in one turn."""
        return motion_s(self.rate_deg_per_s, self.acceleration_deg_per_s2)

    @property
    def turn_s(self) -> float:
        """The time from the reading before a turn to the reading after it."""
        return self.motion_s + 2.0 * self.settle_s

    @property
    def axis_s(self) -> float:
        """The time for all turns about one axis, its way up included."""
        return self.reorientation_s + self.turns * self.turn_s + (self.turns - 1) * self.pause_s

    @property
    def set_s(self) -> float:
        """The time for all axes."""
        return self.axes * self.axis_s

    @property
    def fits(self) -> bool:
        """Whether a set ends before the next begins."""
        return self.set_s <= self.interval_s

    def rate_that_fits(self) -> float | None:
        """Return the least rate in deg/s, rounded up, at which a set fits; None where none does."""
        rest_s = self.reorientation_s + (self.turns - 1) * self.pause_s
        rest_s += 2.0 * self.turns * self.settle_s
        motion = (self.interval_s / self.axes - rest_s) / self.turns
        acceleration = self.acceleration_deg_per_s2
        inside = motion**2 - 4.0 * FULL_TURN_DEG / acceleration
        if motion <= 0.0 or inside < 0.0:
            return None
        least = acceleration * (motion - math.sqrt(inside)) / 2.0
        rounded = math.ceil(least - 1e-9)
        return float(rounded) if motion_s(rounded, acceleration) <= motion else least


def motion_s(rate_deg_per_s: float, acceleration_deg_per_s2: float) -> float:
    """Return the time of a full turn from rest to rest: up to rate, on, and down again."""
    top = min(rate_deg_per_s, math.sqrt(FULL_TURN_DEG * acceleration_deg_per_s2))
    return FULL_TURN_DEG / top + top / acceleration_deg_per_s2


class WarmUp(WarmUpWindow):
    """When self-heating counts as over: |slope| + 2 u of the gyro's temperature over a window."""

    slope_limit_degC_per_h: Annotated[float, Unit("degC/h"), Field(gt=0)] = 2.0
    window_s: Annotated[float, Unit("s"), Field(gt=0)] = 600.0
    at_most_s: Annotated[float, Unit("s"), Field(gt=0)] = 14400.0


class Verification(StrictModel):
    """The ramp of step 4: another direction or another rate than that of step 2."""

    direction: Literal["down", "up"] = "down"
    ramp_rate_degC_per_h: Annotated[float, Unit("degC/h"), Field(gt=0)] = 12.0


class Departure(StrictModel):
    """How a drive began, and how well all is known by which it is navigated."""

    initial_heading_deg: Degree | None = None
    initial_pitch_deg: Annotated[Degree, Field(ge=-90, le=90)] | None = None
    initial_roll_deg: Degree | None = None
    initial_heading_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] | None = None
    initial_level_uncertainty_arcsec: Annotated[float, Unit("arcsec"), Field(ge=0)] | None = None
    accelerometer_bias_ug: Annotated[float, Unit("ug"), Field(ge=0)] | None = None
    reference_position_uncertainty_mm: Annotated[float, Unit("mm"), Field(ge=0)] | None = None


class DriveTest(Departure):
    """The vehicle test of step 4: a recorded drive, and where it was.

    `file` and `reference`, its reference trajectory, are paths, or names in `config/drives`. Where
    `initial_heading` is left out the vehicle is taken to be level on average.
    """

    file: Annotated[str, Field(min_length=1)]
    reference: Annotated[str, Field(min_length=1)] | None = None
    latitude_deg: Annotated[Degree, Field(ge=-90, le=90)] | None = None
    latitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] | None = None


class Thresholds(StrictModel):
    """Where a flag is raised; the defaults are those of the result format."""

    gap: Annotated[float, Field(gt=1)] = GAP
    model_too_stiff: Annotated[float, Field(gt=0)] = MODEL_TOO_STIFF
    outlier: Annotated[float, Field(ge=3)] = OUTLIER


class AnalysisSettings(Thresholds):
    """With the choices of the estimator, which no plan states among its thresholds.

    `outlier` is in robust standard deviations of a turn, `gap` in nominal intervals between sets,
    `model_too_stiff` a correlation, `temperature_gap_degC` a stretch without a turn,
    `noise_beyond_statement` the noise of a turn over the stated one.
    """

    highest_order: int = 20
    temperature_gap_degC: float = 10.0
    noise_beyond_statement: float = 3.0


class FogParameters(StrictModel):
    """What the engineer chooses; outside the published ranges only where the plan says so."""

    outside_published_range: bool = False
    temperature_range_degC: tuple[Celsius, Celsius]
    soak_s: Annotated[float, Unit("s"), Field(gt=0)] = 18000.0
    ramp_rate_degC_per_h: Annotated[float, Unit("degC/h"), Field(gt=0)] = 12.0
    set_interval_s: Annotated[float, Unit("s"), Field(gt=0)] = PUBLISHED_INTERVAL_S
    axes: tuple[Axis, ...] = ("x", "y", "z")
    turns: Turns = "as_published"
    settle_s: Annotated[float, Unit("s"), Field(ge=0)] = 5.0
    pause_s: Annotated[float, Unit("s"), Field(ge=0)] = 2.0
    reorientation_s: Annotated[float, Unit("s"), Field(gt=0)] = 75.0
    turn_acceleration_deg_per_s2: Annotated[float, Unit("deg/s^2"), Field(gt=0)] = 10.0
    turn_rate_deg_per_s: Annotated[float, Unit("deg/s"), Field(gt=0)]
    latitude_deg: Annotated[Degree, Field(ge=-90, le=90)]
    alignment_s: Annotated[float, Unit("s"), Field(gt=0)] = 300.0
    alignment_at_most_s: Annotated[float, Unit("s"), Field(gt=0)] = 1200.0
    warm_up: WarmUp = WarmUp()
    random_rotation_s: Annotated[float, Unit("s"), Field(ge=0)] = 120.0
    soaked_within_degC: Annotated[float, Unit("degC", difference=True), Field(gt=0)] = 0.5
    chamber_at_most_s: Annotated[float, Unit("s"), Field(gt=0)] = 14400.0
    navigator_rate_Hz: Annotated[float, Unit("Hz"), Field(ge=1, le=10)] = 10.0
    heading_resolution_deg: Annotated[float, Unit("deg"), Field(gt=0)] = 0.0001
    angle_random_walk_deg_per_sqrt_h: Annotated[float, Unit("deg/sqrt(h)"), Field(ge=0)] = 0.002
    turntable_accuracy_arcsec: Annotated[float, Unit("arcsec"), Field(ge=0)] = 1.0
    gyro_bias_deg_per_h: Annotated[float, Unit("deg/h"), Field(gt=0)] | None = Field(
        default=None, validate_default=True
    )
    initial_order: Annotated[int, Field(ge=0, le=8)] = PUBLISHED_ORDER
    reference_temperature_degC: Celsius = USUAL_REFERENCE_DEGC
    asked_uncertainty_ppm: Annotated[float, Unit("ppm"), Field(gt=0)] | None = None
    verification: Verification | None = None
    drive: DriveTest | None = None
    thresholds: Thresholds = Thresholds()

    @field_validator("temperature_range_degC")
    @classmethod
    def low_to_high(cls, between: tuple[float, float]) -> tuple[float, float]:
        """Require a range that rises."""
        if between[1] <= between[0]:
            raise ValueError("must go from the lowest to the highest temperature")
        return between

    @field_validator("soak_s")
    @classmethod
    def published_soak(cls, soak_s: float, info: ValidationInfo) -> float:
        """Refuse a soak outside the published range."""
        low, high = PUBLISHED_SOAK_H
        if not low <= soak_s / SECONDS_PER_HOUR <= high:
            _refuse(info, f"the method is published for a soak of {low:g} h to {high:g} h")
        return soak_s

    @field_validator("ramp_rate_degC_per_h")
    @classmethod
    def published_ramp(cls, ramp_rate: float, info: ValidationInfo) -> float:
        """Refuse a ramp outside the published range."""
        low, high = PUBLISHED_RAMP_DEGC_PER_H
        if not low - 1e-9 <= ramp_rate <= high + 1e-9:
            _refuse(
                info,
                f"the method is published for {low:g} degC/h to {high:g} degC/h (0.5 degC to "
                "1 degC in 5 min)",
            )
        return ramp_rate

    @field_validator("set_interval_s")
    @classmethod
    def published_interval(cls, interval_s: float, info: ValidationInfo) -> float:
        """Refuse another interval than ten minutes."""
        if abs(interval_s - PUBLISHED_INTERVAL_S) > 1e-6:
            _refuse(info, "the method is published for a set of turns every 10 min")
        return interval_s

    @field_validator("axes")
    @classmethod
    def each_axis_once(cls, axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
        """Refuse an empty list and an axis named twice."""
        if not axes or len(set(axes)) != len(axes):
            raise ValueError("name at least one of x, y, z, each once")
        return axes

    @field_validator("turn_rate_deg_per_s")
    @classmethod
    def turns_fit_the_interval(cls, rate: float, info: ValidationInfo) -> float:
        """Refuse turns that take longer than the interval, and say the rate that would do."""
        needed = ("set_interval_s", "axes", "turns", "settle_s", "pause_s", "reorientation_s")
        if any(name not in info.data for name in (*needed, "turn_acceleration_deg_per_s2")):
            return rate
        schedule = schedule_of(info.data, rate)
        if schedule.fits:
            return rate
        enough = schedule.rate_that_fits()
        help_text = (
            f"{enough:g} deg/s would do"
            if enough is not None
            else f"no rate would do at {schedule.acceleration_deg_per_s2:g} deg/s^2; take fewer "
            "axes or turns, or a faster table"
        )
        raise ValueError(
            f"a set of {schedule.turns * schedule.axes} turns about {schedule.axes} axes takes "
            f"{schedule.set_s:.0f} s, the interval is {schedule.interval_s:g} s; {help_text}"
        )

    @field_validator("gyro_bias_deg_per_h")
    @classmethod
    def bias_of_single_turns(cls, bias: float | None, info: ValidationInfo) -> float | None:
        """Require the gyro's bias specification where turns have one sense only."""
        if bias is None and info.data.get("turns") == "as_published":
            raise ValueError(
                "is missing: turns of one sense cannot separate the gyro's bias from its scale "
                "factor; give its specification as a standard uncertainty, or take turns: pairs"
            )
        return bias

    @field_validator("reference_temperature_degC")
    @classmethod
    def reference_inside(cls, reference: float, info: ValidationInfo) -> float:
        """Refuse a reference temperature at which nothing will be measured."""
        between = info.data.get("temperature_range_degC")
        if between is not None and not between[0] <= reference <= between[1]:
            raise ValueError(
                f"lies outside the range of {between[0]:g} degC to {between[1]:g} degC; the model "
                "is not extrapolated"
            )
        return reference

    @property
    def schedule(self) -> Schedule:
        """The times of a set."""
        data = {name: getattr(self, name) for name in type(self).model_fields}
        return schedule_of(data, self.turn_rate_deg_per_s)

    @property
    def signs(self) -> tuple[int, ...]:
        """The senses of the turns about one axis in one set, in order."""
        return SIGNS[self.turns]

    @property
    def span_degC(self) -> float:
        """The width of the temperature range."""
        return self.temperature_range_degC[1] - self.temperature_range_degC[0]

    @property
    def outside(self) -> tuple[str, ...]:
        """What of the plan lies outside the published ranges, in words."""
        texts = []
        if not PUBLISHED_SOAK_H[0] <= self.soak_s / SECONDS_PER_HOUR <= PUBLISHED_SOAK_H[1]:
            texts.append(f"a soak of {self.soak_s / SECONDS_PER_HOUR:g} h (published 4 h to 6 h)")
        low, high = PUBLISHED_RAMP_DEGC_PER_H
        if not low - 1e-9 <= self.ramp_rate_degC_per_h <= high + 1e-9:
            texts.append(
                f"a ramp of {self.ramp_rate_degC_per_h:g} degC/h (published {low:g} degC/h to "
                f"{high:g} degC/h)"
            )
        if abs(self.set_interval_s - PUBLISHED_INTERVAL_S) > 1e-6:
            texts.append(f"a set every {self.set_interval_s / 60.0:g} min (published 10 min)")
        return tuple(texts)


def schedule_of(data: dict[str, object], rate_deg_per_s: float) -> Schedule:
    """Return the times of a set from parameters by name."""
    return Schedule(
        interval_s=float(data["set_interval_s"]),  # type: ignore[arg-type]
        axes=len(data["axes"]),  # type: ignore[arg-type]
        turns=len(SIGNS[str(data["turns"])]),
        settle_s=float(data["settle_s"]),  # type: ignore[arg-type]
        pause_s=float(data["pause_s"]),  # type: ignore[arg-type]
        reorientation_s=float(data["reorientation_s"]),  # type: ignore[arg-type]
        rate_deg_per_s=rate_deg_per_s,
        acceleration_deg_per_s2=float(data["turn_acceleration_deg_per_s2"]),  # type: ignore[arg-type]
    )


def _refuse(info: ValidationInfo, text: str) -> None:
    if info.data.get("outside_published_range") is not True:
        raise ValueError(f"{text}; outside_published_range: true allows it and the report says so")
