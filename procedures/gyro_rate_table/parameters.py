"""The parameters of a plan for a gyro on a rate table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from procedures.common.constants import FULL_TURN_DEG
from procedures.common.gyro_source import NAVIGATOR, Axis, OfSource, need_axes
from procedures.common.switch_ons import Thresholds
from station.fields import Unit

UNITS = {
    "scale_factor": "1",
    "nonlinearity": "ppm",
    "nonlinearity_of_full_scale": "ppm",
    "asymmetry": "ppm",
    "scale_factor_repeatability": "ppm",
    "bias": "deg/h",
}

LARGEST_STEP_DEG = 120.0
"""Between two attitudes that must say which way round the table turned."""


@dataclass(frozen=True)
class Turn:
    """One record: a rate, positive counter-clockwise seen from above, 0 standing; its length."""

    rate_deg_per_s: float
    record_s: float

    @property
    def words(self) -> str:
        """What an operator reads of it."""
        return f"{self.rate_deg_per_s:+g} deg/s" if self.rate_deg_per_s else "standing"


class RateTableParameters(OfSource):
    """What the engineer chooses."""

    sample_interval_s: Annotated[float, Unit("s"), Field(gt=0, le=10)] = 1.0
    axes: Annotated[tuple[Axis, ...], Field(min_length=1, validate_default=True)] = ("IA",)
    latitude_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)]
    latitude_uncertainty_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0)] = 0.0
    rates_deg_per_s: Annotated[
        tuple[Annotated[float, Unit("deg/s"), Field(gt=0)], ...], Field(min_length=2)
    ] = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
    range_deg_per_s: Annotated[float, Unit("deg/s"), Field(gt=0)] | None = None
    record_s: Annotated[float, Unit("s"), Field(gt=0)] = 40.0
    stand_s: Annotated[float, Unit("s"), Field(gt=0)] = 120.0
    settle_s: Annotated[float, Unit("s"), Field(ge=0)] = 5.0
    switch_ons: Annotated[int, Field(ge=1, le=20)] = 3
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0)] = 1800.0
    cool_s: Annotated[float, Unit("s"), Field(ge=0)] = 3600.0
    reading_interval_s: Annotated[float, Unit("s"), Field(ge=0.1, le=10)] = 1.0
    levelled_by: Literal["table", "person"] = "table"
    table_axis: Annotated[int, Field(ge=1, le=3)] = 1
    alignment_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0, le=600)] = 3.0
    level_arcmin: Annotated[float, Unit("arcmin"), Field(ge=0, le=600)] = 1.0
    clock_ppm: Annotated[float, Unit("ppm"), Field(ge=0)] = 1.0
    angle_random_walk_deg_per_sqrt_h: Annotated[float, Unit("deg/sqrt(h)"), Field(gt=0)] = 0.001
    thresholds: Thresholds = Thresholds()

    @field_validator("axes")
    @classmethod
    def of_source(cls, axes: tuple[Axis, ...], info: ValidationInfo) -> tuple[Axis, ...]:
        """Refuse axes that the source does not have, and one that stands twice."""
        need_axes(info.data.get("source"), axes)
        if len(set(axes)) < len(axes):
            raise ValueError("an axis stands twice")
        return axes

    @field_validator("rates_deg_per_s")
    @classmethod
    def each_once(cls, rates: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        """Refuse a rate that stands twice, and one whose turns a navigator's attitude hides."""
        for place, rate in enumerate(rates):
            if any(math.isclose(rate, other, rel_tol=1e-9) for other in rates[:place]):
                raise ValueError(f"{rate:g} deg/s stands twice")
        largest_deg = max(rates) * info.data.get("sample_interval_s", 0.0)
        if info.data.get("source") == NAVIGATOR and largest_deg > LARGEST_STEP_DEG:
            raise ValueError(
                f"a navigator that turns {largest_deg:g} deg between two outputs does not show "
                "how far; give a shorter sample_interval"
            )
        return rates

    @property
    def turns(self) -> tuple[Turn, ...]:
        """The records of one switch-on in their order: standing, each rate both ways, standing."""
        standing = Turn(0.0, self.stand_s)
        turning = tuple(
            Turn(sense * rate, self.record_s_at(rate))
            for rate in self.rates_deg_per_s
            for sense in (1.0, -1.0)
        )
        return (standing, *turning, standing)

    def record_s_at(self, rate_deg_per_s: float) -> float:
        """Return how long whole turns take that last `record_s` or more."""
        turns = math.ceil(self.record_s * rate_deg_per_s / FULL_TURN_DEG - 1e-9)
        return turns * FULL_TURN_DEG / rate_deg_per_s
