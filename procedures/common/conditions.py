"""Conditions of datasets that several procedures ask for, each with its rule."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from station.fields import InputAxis, StrictModel, Unit


class OverDevice(StrictModel):
    """By how much, at most, the device is elsewhere off the temperature that counts."""

    device_gradient_degC: Annotated[float, Unit("degC", True), Field(ge=0)] | None = None


class OnEarth(StrictModel):
    """Where on earth: its rate is taken off."""

    latitude_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)]
    latitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] = 0.0


class OfGyros(OnEarth):
    """Where the input axes of one gyro, or of a triad, point."""

    input_axis: Annotated[dict[Literal["IA", "X", "Y", "Z"], InputAxis], Field(min_length=1)]
    attitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] = 0.0

    @field_validator("input_axis")
    @classmethod
    def one_or_triad(cls, value: dict[str, InputAxis]) -> dict[str, InputAxis]:
        """Require IA alone, or axes of a triad."""
        if "IA" in value and len(value) > 1:
            raise ValueError("give IA alone for one gyro, or X, Y, Z for a triad")
        return value


class OfRateOrCounts(StrictModel):
    """What the gyro's column holds; counts come with the weight of a pulse."""

    gyro_output: Literal["rate", "counts"]
    pulse_weight_arcsec: Annotated[float, Unit("arcsec"), Field(gt=0)] | None = Field(
        default=None, validate_default=True
    )

    @field_validator("pulse_weight_arcsec")
    @classmethod
    def weight_of_counts(cls, value: float | None, info: ValidationInfo) -> float | None:
        """Require the pulse weight where the output is counts."""
        if value is None and info.data.get("gyro_output") == "counts":
            raise ValueError("an output in counts needs pulse_weight, such as 0.4 arcsec")
        return value
