"""The parameters of a plan for the angles between three coils of a SERF gyro's cell."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, field_validator

from procedures.common.thresholds import GAP, MODEL_TOO_STIFF, OUTLIER
from station.fields import StrictModel, Unit

from .shots import (
    AXES,
    GAMMA_HZ_PER_NT,
    SPINS,
    Axis,
    SlowingDown,
    Wanted,
    known_spin,
    shots_of,
    why_without_signal,
)

Nanotesla = Annotated[float, Unit("nT"), Field(gt=0)]
Positive = Annotated[float, Unit("s"), Field(gt=0)]
TONE_SETTLING_S = 0.25
"""A dozen times what spins in pump light remember."""
TONE_SAMPLES = 500
"""Of each cycle of a tone."""
NuclearSpin = Annotated[float, AfterValidator(known_spin)]


def not_along_pump(probe_axis: Axis, info: ValidationInfo) -> Axis:
    """Refuse a probe along the pump light: the spins precess about neither."""
    if probe_axis == info.data.get("pump_axis"):
        raise ValueError("must be another axis than pump_axis: no shot would carry a signal")
    return probe_axis


ProbeAxis = Annotated[Axis, AfterValidator(not_along_pump)]
"""Of a model with a `pump_axis` before it."""


class Fields(StrictModel):
    """A field for each coil, where they are not to be alike."""

    x_nT: Nanotesla
    y_nT: Nanotesla
    z_nT: Nanotesla


NullingMethod = Literal["precession", "modulation"]
Gentle = Annotated[Nanotesla, Field(le=5)]


class Nulling(StrictModel):
    """When the residual field is small enough, and how often it is looked for at most.

    Beyond `at_most` it is not the shield's but that of polarised nuclei, and not nulled. By
    modulation a `tone` swings about a `bias` to either side; `light_shift` bounds what the pump
    light does as a field along it, which precession in the dark does not feel.
    """

    method: NullingMethod = "precession"
    tolerance_nT: Nanotesla = 0.5
    at_most_nT: Nanotesla = 10.0
    rounds: Annotated[int, Field(ge=0, le=20)] = 4
    tone_nT: Gentle = 0.4
    bias_nT: Gentle = 0.6
    frequency_Hz: Annotated[float, Unit("Hz"), Field(ge=0.5, le=100)] = 8.0
    cycles: Annotated[int, Field(ge=4, le=200)] = 8
    light_shift_nT: Annotated[float, Unit("nT"), Field(ge=0)] = 0.3

    @property
    def half_s(self) -> float:
        """How long each level of the tone lasts."""
        return 0.5 / self.frequency_Hz

    @property
    def settling_s(self) -> float:
        """Of a tone, before its answer is the same in each cycle: a whole number of cycles."""
        return math.ceil(TONE_SETTLING_S * self.frequency_Hz) / self.frequency_Hz

    @property
    def record_s(self) -> float:
        """Of a tone, from the trigger on."""
        return self.settling_s + self.cycles / self.frequency_Hz


def method_alone(given: object) -> object:
    """Take the name of a method for a mapping with nothing else in it."""
    return {"method": given} if isinstance(given, str) else given


AnyNulling = Annotated[
    Nulling,
    BeforeValidator(method_alone, json_schema_input_type=Nulling | NullingMethod),
]


class Depolarising(StrictModel):
    """The gradient that takes the nuclei's polarisation away, and how long, and how often."""

    gradient_nT_per_cm: Annotated[float, Unit("nT/cm"), Field(gt=0)] = 2000.0
    duration_s: Positive = 5.0
    rounds: Annotated[int, Field(ge=1, le=20)] = 3


class Stability(StrictModel):
    """When a cell is warm: near its temperature for a time, at most so long after heating began."""

    within_degC: Annotated[float, Unit("degC", difference=True), Field(gt=0)] = 0.5
    duration_s: Positive = 300.0
    at_most_s: Positive = 3600.0


class Thresholds(StrictModel):
    """Where a flag is raised; the defaults are those of the result format."""

    residual_field_large_nT: Nanotesla = 1.5
    few_cycles: Annotated[float, Field(ge=1)] = 1.5
    chirp: Annotated[float, Unit("1"), Field(gt=0)] = 0.01
    gap: Annotated[float, Field(gt=1)] = GAP
    model_too_stiff: Annotated[float, Field(gt=0)] = MODEL_TOO_STIFF


class AnalysisSettings(Thresholds):
    """With the choices of the estimator, which no plan states among its thresholds.

    `few_cycles` within the 1/e time; `residual_field_large_nT` magnitude; `chirp` relative change
    of the frequency over the decay, which must also be `chirp_u` of its uncertainties; `gap` in
    nominal intervals; `model_too_stiff` lag-1 correlation of a shot's residuals. Samples before
    `skip_s`, while the coils' currents rise, are left out.
    """

    outlier: float = OUTLIER
    chirp_u: float = 5.0
    skip_s: float = 0.0


class SerfParameters(StrictModel):
    """What the engineer chooses; the source document gives the gradient alone."""

    pump_axis: Axis
    probe_axis: ProbeAxis
    single_axis: Axis | None = None
    nuclear_spin: NuclearSpin
    shots: Literal["as_published", "reversal"] = "reversal"
    coil_constants: Literal["known", "nominal"] = "nominal"
    field_nT: Nanotesla | None = None
    fields: Fields | None = None
    relaxation_rate_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] | None = None
    exchange_rate_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] | None = Field(
        default=None, validate_default=True
    )
    gyromagnetic_ratio_Hz_per_nT: Annotated[float, Unit("Hz/nT"), Field(gt=0)] = GAMMA_HZ_PER_NT
    sample_rate_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] = 10_000.0
    record_s: Positive = 0.1
    full_scale_V: Annotated[float, Unit("V"), Field(gt=0)] = 1.0
    pump_s: Positive = 1.0
    repeats: Annotated[int, Field(ge=0, le=20)] = 3
    mains_frequency_Hz: Annotated[float, Unit("Hz"), Field(gt=0)] | None = None
    cell_temperature_degC: Annotated[float, Unit("degC"), Field(ge=20, le=250)] | None = None
    heating_rate_degC_per_min: Annotated[float, Unit("degC/min"), Field(gt=0)] = 10.0
    stability: Stability = Stability()
    gyro_was_running: bool = False
    depolarise: Depolarising = Depolarising()
    nulling: AnyNulling = Nulling()
    thresholds: Thresholds = Thresholds()

    @field_validator("single_axis")
    @classmethod
    def carries_a_signal(cls, axis: Axis | None, info: ValidationInfo) -> Axis | None:
        """Refuse a shot with one coil whose field lies along the pump or the probe light."""
        lights = info.data.get("pump_axis"), info.data.get("probe_axis")
        if axis is not None and (why := why_without_signal(axis, *lights)):
            raise ValueError(why)
        return axis

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
        """The field of each coil that carries one: given, or the best for the angles."""
        if self.fields is not None:
            return {"x": self.fields.x_nT, "y": self.fields.y_nT, "z": self.fields.z_nT}
        field_nT = self.field_nT if self.field_nT is not None else self.best_field_nT
        return dict.fromkeys(AXES, field_nT)

    @property
    def best_field_nT(self) -> float:
        """The field of each coil at which spin exchange broadens a pair's line by half its width.

        There the relative uncertainty of the frequency of a pair is smallest.
        """
        assert self.relaxation_rate_Hz is not None
        assert self.exchange_rate_Hz is not None
        q = self.slowing_down.at_rest
        width = self.relaxation_rate_Hz / q
        omega = math.sqrt(width * self.exchange_rate_Hz / (2.0 * self.slowing_down.broadening))
        pair_nT = omega * q / (2 * math.pi * self.gyromagnetic_ratio_Hz_per_nT)
        return round(pair_nT / math.sqrt(2.0), 1)

    @property
    def slowing_down(self) -> SlowingDown:
        """How the nuclear spin slows the precession down."""
        return SPINS[self.nuclear_spin]

    @property
    def fastest_precession_Hz(self) -> float:
        """The highest frequency to be expected: the largest pair at the least slowing-down."""
        levels = sorted(self.field_levels_nT.values())
        largest_nT = math.hypot(levels[-1], levels[-2])
        return self.gyromagnetic_ratio_Hz_per_nT * largest_nT / self.slowing_down.polarised

    @property
    def tone_rate_Hz(self) -> float:
        """How fast the answer to a tone is sampled."""
        return min(self.sample_rate_Hz, TONE_SAMPLES * self.nulling.frequency_Hz)

    @property
    def constants_known(self) -> bool:
        """Whether the bench file's coil constants are taken for exact but for their u."""
        return self.coil_constants == "known" or self.shots == "as_published"

    @property
    def wanted(self) -> tuple[Wanted, ...]:
        """The shots in the order in which they are taken; each is a unit of work."""
        return shots_of(self.shots, self.field_levels_nT, self.pump_axis, self.probe_axis)
