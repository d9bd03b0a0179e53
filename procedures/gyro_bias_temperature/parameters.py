"""The parameters of a plan for a gyro's bias over temperature, and the legs that follow of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from procedures.common.thresholds import GAP, MODEL_TOO_STIFF, NOT_SIGNIFICANT, OUTLIER
from station.fields import Celsius, InputAxis, StrictModel, Unit

UNITS = {
    "bias": "deg/h",
    "bias_temperature_sensitivity": "deg/h/degC",
    "largest_bias_slope": "deg/h/degC",
    "bias_rate_sensitivity": "deg/h/(degC/min)",
    "hysteresis": "deg/h",
    "sensor_lag": "s",
    "chamber_lag": "s",
}
"""The results and their units, in the order of the contract."""

SECONDS_PER_MINUTE = 60.0
RAMP, SOAK = "ramp", "soak"
Rate = Annotated[float, Unit("degC/min"), Field(gt=0)]


class Thresholds(StrictModel):
    """Where a flag is raised; the defaults are those of the result format."""

    not_significant: Annotated[float, Field(gt=0)] = NOT_SIGNIFICANT
    gap: Annotated[float, Field(gt=1)] = GAP
    outlier: Annotated[float, Field(gt=1)] = OUTLIER
    model_too_stiff: Annotated[float, Field(gt=0)] = MODEL_TOO_STIFF


@dataclass(frozen=True)
class Leg:
    """A unit of work: the set-point goes from one temperature to another, or stands.

    `rate_degC_per_min` is how fast, without a sign; 0 where it stands for `lasts_s`.
    """

    unit: str
    from_degC: float
    to_degC: float
    rate_degC_per_min: float
    lasts_s: float

    @property
    def phase(self) -> str:
        """What the set-point does."""
        return RAMP if self.rate_degC_per_min else SOAK


class BiasTemperatureParameters(StrictModel):
    """What the engineer chooses."""

    latitude_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)]
    latitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] = 0.0
    input_axis: dict[Literal["IA"], InputAxis]
    attitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)]
    sample_interval_s: Annotated[float, Unit("s"), Field(gt=0, le=5)] = 1.0
    row_interval_s: Annotated[float, Unit("s"), Field(gt=0)] = 60.0
    pulse_weight_arcsec: Annotated[float, Unit("arcsec"), Field(gt=0)]
    channel: Annotated[int, Field(ge=1, le=3)] = 1
    room_temperature_degC: Celsius = 22.0
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0)] = 7200.0
    soaks_degC: Annotated[tuple[Celsius, ...], Field(min_length=2)]
    soak_s: Annotated[float, Unit("s"), Field(gt=0)] = 7200.0
    ramp_up_degC_per_min: Rate = 1.0
    ramp_down_degC_per_min: Rate = 0.5
    chamber_interval_s: Annotated[float, Unit("s"), Field(gt=0)] = 20.0
    soaked_within_degC: Annotated[float, Unit("degC", difference=True), Field(gt=0)] = 2.0
    chamber_at_most_s: Annotated[float, Unit("s"), Field(gt=0)] = 7200.0
    reference_temperature_degC: Celsius = 20.0
    sensor_lag_prior_s: Annotated[float, Unit("s"), Field(ge=0)] = 300.0
    thermometer_uncertainty_degC: Annotated[float, Unit("degC", True), Field(ge=0)] = 0.0
    clock_ppm: Annotated[float, Unit("ppm"), Field(ge=0)] = 1.0
    thresholds: Thresholds = Thresholds()

    @field_validator("row_interval_s")
    @classmethod
    def of_whole_samples(cls, row_s: float, info: ValidationInfo) -> float:
        """Require rows that are means of several samples."""
        interval_s = info.data.get("sample_interval_s")
        if interval_s is not None and row_s < FEWEST_SAMPLES * interval_s:
            raise ValueError(f"a row is the mean of at least {FEWEST_SAMPLES} samples")
        return row_s

    @field_validator("soaks_degC")
    @classmethod
    def neighbours_differ(cls, soaks: tuple[float, ...]) -> tuple[float, ...]:
        """Refuse a soak at the temperature of that before it."""
        for before, after in pairwise(soaks):
            if before == after:
                raise ValueError(f"two soaks at {after:g} degC follow one another; name it once")
        return soaks

    @field_validator("reference_temperature_degC")
    @classmethod
    def reference_inside(cls, reference: float, info: ValidationInfo) -> float:
        """Refuse a reference temperature that the gyro does not come to."""
        soaks = info.data.get("soaks_degC")
        if soaks is not None and not min(soaks) <= reference <= max(soaks):
            raise ValueError(
                f"lies outside the soaks of {min(soaks):g} degC to {max(soaks):g} degC; the curve "
                "is not extrapolated"
            )
        return reference

    @property
    def outward(self) -> tuple[Leg, ...]:
        """The ramps and soaks of step 3."""
        return tuple(self._legs(self.room_temperature_degC, self.soaks_degC, 1))

    @property
    def homeward(self) -> tuple[Leg, ...]:
        """The ramp and the soak of step 4, back at room temperature."""
        last = self.soaks_degC[-1]
        return tuple(self._legs(last, (self.room_temperature_degC,), len(self.soaks_degC) + 1))

    def ramp(self, unit: str, from_degC: float, to_degC: float) -> Leg:
        """Return the way from one temperature to another."""
        up = to_degC > from_degC
        rate = self.ramp_up_degC_per_min if up else self.ramp_down_degC_per_min
        lasts_s = abs(to_degC - from_degC) / rate * SECONDS_PER_MINUTE
        return Leg(unit, from_degC, to_degC, rate, lasts_s)

    def _legs(self, stands: float, soaks: tuple[float, ...], first: int) -> Iterator[Leg]:
        for number, degC in enumerate(soaks, first):
            if degC != stands:
                yield self.ramp(f"{RAMP} {number}", stands, degC)
            yield Leg(f"{SOAK} {number}", degC, degC, 0.0, self.soak_s)
            stands = degC


FEWEST_SAMPLES = 5
