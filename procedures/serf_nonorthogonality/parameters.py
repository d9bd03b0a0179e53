"""The parameters of a plan for the angles between three coils of a SERF gyro's cell."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from procedures.serf_nonorthogonality.shots import AXES, Wanted, shots_of
from station.fields import StrictModel, Unit

Axis = Literal["x", "y", "z"]
Nanotesla = Annotated[float, Unit("nT"), Field(gt=0)]
Positive = Annotated[float, Unit("s"), Field(gt=0)]

SLOWING_DOWN = {1.5: (4.0, 6.0), 2.5: (6.0, 38.0 / 3.0), 3.5: (8.0, 22.0)}
"""Slowing-down factor by nuclear spin, from full to no polarisation."""
BROADENING = {1.5: 20.0 / 12.0, 2.5: 4.912, 3.5: 9.545}
"""Spin-exchange broadening in units of omega^2 / R_se: (q^2 - (2I + 1)^2) / (2 q)."""


class Fields(StrictModel):
    """A field for each coil, where they are not to be alike."""

    x_nT: Nanotesla
    y_nT: Nanotesla
    z_nT: Nanotesla


class Nulling(StrictModel):
    """When the residual field is small enough, and how often it is looked for at most."""

    tolerance_nT: Nanotesla = 0.5
    rounds: Annotated[int, Field(ge=0, le=20)] = 4


class Depolarising(StrictModel):
    """The gradient that takes the nuclei's polarisation away, and how long, and how often."""

    gradient_nT_per_cm: Annotated[float, Unit("nT/cm"), Field(gt=0)] = 2000.0
    duration_s: Positive = 5.0
    rounds: Annotated[int, Field(ge=1, le=20)] = 3


class Thresholds(StrictModel):
    """Where a flag is raised; the defaults are those of the result format."""

    residual_field_large_nT: Nanotesla = 1.5
    few_cycles: Annotated[float, Field(ge=1)] = 1.5
    chirp: Annotated[float, Unit("1"), Field(gt=0)] = 0.01
    gap: Annotated[float, Field(gt=1)] = 1.5
    model_too_stiff: Annotated[float, Field(gt=0)] = 0.3


class SerfParameters(StrictModel):
    """What the engineer chooses; the source document gives the gradient alone."""

    pump_axis: Axis
    probe_axis: Axis = Field()
    single_axis: Axis | None = None
    nuclear_spin: float
    shots: Literal["as_published", "reversal"] = "reversal"
    coil_constants: Literal["known", "nominal"] = "nominal"
    field_nT: Nanotesla | None = None
    fields: Fields | None = None
    relaxation_rate_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] | None = None
    exchange_rate_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] | None = Field(
        default=None, validate_default=True
    )
    gyromagnetic_ratio_Hz_per_nT: Annotated[float, Unit("Hz/nT"), Field(gt=0)] = 28.02495
    sample_rate_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] = 10_000.0
    record_s: Positive = 0.1
    full_scale_V: Annotated[float, Unit("V"), Field(gt=0)] = 1.0
    pump_s: Positive = 1.0
    repeats: Annotated[int, Field(ge=0, le=20)] = 3
    mains_frequency_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] | None = None
    gyro_was_running: bool = False
    depolarise: Depolarising = Depolarising()
    nulling: Nulling = Nulling()
    thresholds: Thresholds = Thresholds()

    @field_validator("probe_axis")
    @classmethod
    def not_the_pump_axis(cls, probe_axis: Axis, info: ValidationInfo) -> Axis:
        """Refuse a probe along the pump light: the spins precess about neither."""
        if probe_axis == info.data.get("pump_axis"):
            raise ValueError("must be another axis than pump_axis: no shot would carry a signal")
        return probe_axis

    @field_validator("single_axis")
    @classmethod
    def carries_a_signal(cls, axis: Axis | None, info: ValidationInfo) -> Axis | None:
        """Refuse a shot with one coil whose field lies along the pump or the probe light."""
        lights = {info.data.get("pump_axis"): "pump", info.data.get("probe_axis"): "probe"}
        if axis in lights and None not in lights:
            usable = next(one for one in AXES if one not in lights)
            raise ValueError(
                f"a field along {axis}, the {lights[axis]} light, lets nothing be seen to precess; "
                f"use {usable}"
            )
        return axis

    @field_validator("nuclear_spin")
    @classmethod
    def of_an_alkali(cls, nuclear_spin: float) -> float:
        """Refuse a spin whose slowing-down factor is not known."""
        if nuclear_spin not in SLOWING_DOWN:
            raise ValueError("must be 1.5 (K, Rb-87, Na), 2.5 (Rb-85) or 3.5 (Cs)")
        return nuclear_spin

    @field_validator("fields")
    @classmethod
    def not_beside_one_for_all(cls, fields: Fields | None, info: ValidationInfo) -> Fields | None:
        """Refuse a field for each coil beside one for all."""
        if fields is not None and info.data.get("field_nT") is not None:
            raise ValueError("give either field or fields")
        return fields

    @field_validator("exchange_rate_Hz")
    @classmethod
    def enough_to_choose_a_field(
        cls, exchange_rate_Hz: float | None, info: ValidationInfo
    ) -> float | None:
        """Require a field, or the cell's rates to choose it from."""
        given = info.data.get("field_nT") or info.data.get("fields")
        if not given and (exchange_rate_Hz is None or info.data.get("relaxation_rate_Hz") is None):
            raise ValueError(
                "is missing; give field, or relaxation_rate and exchange_rate to choose it from"
            )
        return exchange_rate_Hz

    @property
    def field_levels_nT(self) -> dict[str, float]:
        """The field of each coil that carries one: given, or where the angles are told best."""
        if self.fields is not None:
            return {"x": self.fields.x_nT, "y": self.fields.y_nT, "z": self.fields.z_nT}
        field_nT = self.field_nT if self.field_nT is not None else self.best_field_nT
        return dict.fromkeys(AXES, field_nT)

    @property
    def best_field_nT(self) -> float:
        """The field of each coil at which spin exchange broadens a pair's line by half its width.

        There the frequency of a pair is told best in relation to itself.
        """
        assert self.relaxation_rate_Hz is not None
        assert self.exchange_rate_Hz is not None
        q = self.largest_slowing_down
        width = self.relaxation_rate_Hz / q
        omega = math.sqrt(width * self.exchange_rate_Hz / (2.0 * BROADENING[self.nuclear_spin]))
        pair_nT = omega * q / (2 * math.pi * self.gyromagnetic_ratio_Hz_per_nT)
        return round(pair_nT / math.sqrt(2.0), 1)

    @property
    def largest_slowing_down(self) -> float:
        """The slowing-down factor of unpolarised vapour."""
        return SLOWING_DOWN[self.nuclear_spin][1]

    @property
    def fastest_precession_Hz(self) -> float:
        """The highest frequency to be expected: the largest pair at the least slowing-down."""
        levels = sorted(self.field_levels_nT.values())
        largest_nT = math.hypot(levels[-1], levels[-2])
        return self.gyromagnetic_ratio_Hz_per_nT * largest_nT / SLOWING_DOWN[self.nuclear_spin][0]

    @property
    def wanted(self) -> tuple[Wanted, ...]:
        """The shots in the order in which they are taken; each is a unit of work."""
        return shots_of(self.shots, self.field_levels_nT, self.pump_axis, self.probe_axis)
