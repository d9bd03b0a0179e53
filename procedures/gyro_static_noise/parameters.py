"""The parameters of a plan for a gyro at rest."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from procedures.common.gyro_source import NAVIGATOR, Axis, OfSource, axes_of_source
from procedures.common.switch_ons import Thresholds
from station.fields import InputAxis, Unit

UNITS = {
    "quantisation_noise": "arcsec",
    "angle_random_walk": "deg/sqrt(h)",
    "bias_instability": "deg/h",
    "rate_random_walk": "deg/h/sqrt(h)",
    "rate_ramp": "deg/h^2",
    "allan_minimum": "deg/h",
    "bias_stability": "deg/h",
    "bias": "deg/h",
    "bias_repeatability": "deg/h",
}

SHORTEST = 40


class StaticParameters(OfSource):
    """What the engineer chooses."""

    latitude_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)]
    latitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] = 0.0
    input_axis: Annotated[
        dict[Axis, InputAxis],
        Field(min_length=1),
        AfterValidator(axes_of_source),
    ]
    attitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)]
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0)] = 1800.0
    record_s: Annotated[float, Unit("s"), Field(gt=0)] = 14400.0
    repeats: Annotated[int, Field(ge=0, le=50)] = 6
    repeat_record_s: Annotated[float, Unit("s"), Field(gt=0)] = 900.0
    cool_s: Annotated[float, Unit("s"), Field(ge=0)] = 3600.0
    clock_ppm: Annotated[float, Unit("ppm"), Field(ge=0)] = 1.0
    thresholds: Thresholds = Thresholds()

    @field_validator("record_s")
    @classmethod
    def long_enough(cls, record_s: float, info: ValidationInfo) -> float:
        """Refuse a record that cannot show noise."""
        interval_s = info.data.get("sample_interval_s")
        if interval_s is not None and record_s < SHORTEST * interval_s:
            raise ValueError(f"a record of noise has at least {SHORTEST} samples")
        return record_s

    @property
    def mountings(self) -> tuple[Axis, ...] | tuple[None]:
        """The axes that are upright in turn; None alone where all are recorded at once."""
        return tuple(self.input_axis) if self.source == NAVIGATOR else (None,)

    @property
    def lengths_s(self) -> tuple[float, ...]:
        """How long the record of each switch-on is."""
        return (self.record_s, *([self.repeat_record_s] * self.repeats))
