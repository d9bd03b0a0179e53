"""The parameters of a plan for a tumble test, and the positions that they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, field_validator

from procedures.common.constants import FULL_TURN_DEG
from station.fields import StrictModel, Unit
from station.findings import FlagThresholds

Mounting = Literal["io", "io-reversed", "ip", "ip-reversed"]
HEADS_DEG = (0.0, 90.0, 180.0, 270.0)
REVERSED = "-reversed"


@dataclass(frozen=True)
class Setting:
    """How the accelerometer stands: its mounting, and how far the fixture is turned on the head."""

    mounting: Mounting
    head_deg: float

    @property
    def plane(self) -> str:
        """The plane that is turned in, `io` or `ip`."""
        return self.mounting.removesuffix(REVERSED)

    @property
    def reversed(self) -> bool:
        """Whether the unit is turned by 180 deg about its input axis."""
        return self.mounting.endswith(REVERSED)

    @property
    def name(self) -> str:
        """What it is called in prompts and units of work."""
        return f"{self.mounting} head {self.head_deg:g}" if self.head_deg else self.mounting


@dataclass(frozen=True)
class Position:
    """One unit of work: an angle, reached upwards or downwards, in a setting."""

    setting: Setting
    angle_deg: float
    way: str

    @property
    def unit(self) -> str:
        """The name of the unit of work, unique in a plan."""
        return f"{self.setting.name} {self.way} {self.angle_deg:g} deg"


class Thresholds(StrictModel):
    """Where a flag is raised; the defaults are those of the result format."""

    not_significant: Annotated[float, Field(gt=0)] = FlagThresholds.not_significant
    outlier: Annotated[float, Field(ge=3)] = FlagThresholds.outlier
    model_too_stiff: Annotated[float, Field(gt=0)] = FlagThresholds.model_too_stiff
    nuisance: Annotated[float, Field(gt=0)] = 4.5


class TumbleParameters(StrictModel):
    """What the engineer chooses."""

    mountings: tuple[Mounting, ...] = ("io", "io-reversed", "ip", "ip-reversed")
    heads_deg: tuple[Annotated[float, Unit("deg")], ...] = (0.0,)
    positions: Annotated[int, Field(ge=4, le=720)] = 24
    up_and_down: bool = True
    dwell_s: Annotated[float, Unit("s"), Field(ge=0)] = 10.0
    readings: Annotated[int, Field(ge=1, le=10000)] = 5
    nplc: Annotated[float, Field(gt=0, le=100)] = 10.0
    reading_noise_V: Annotated[float, Unit("V"), Field(gt=0)] = 3e-6
    scale_factor_V_per_g: Annotated[float, Unit("V/g"), Field(gt=0)] = 1.0
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0)] = 1800.0
    temperature: bool = True
    # On the ground it is 0.9957 g to 1.0028 g.
    local_gravity_g: Annotated[float, Unit("g"), Field(ge=0.99, le=1.01)]
    local_gravity_uncertainty_g: Annotated[float, Unit("g"), Field(ge=0, le=0.01)] = 0.0
    encoder_accuracy_arcsec: Annotated[float, Unit("arcsec"), Field(ge=0, le=3600)] | None = None
    mounting_repeatability_arcsec: Annotated[float, Unit("arcsec"), Field(ge=0, le=3600)]
    thresholds: Thresholds = Thresholds()

    @field_validator("mountings", "heads_deg")
    @classmethod
    def each_once(cls, values: Sequence[object]) -> Sequence[object]:
        """Refuse an empty list, and what stands twice."""
        if not values or len(set(values)) != len(values):
            raise ValueError("name at least one, each once")
        return values

    @field_validator("heads_deg")
    @classmethod
    def quarters(cls, heads_deg: tuple[float, ...]) -> tuple[float, ...]:
        """Refuse a place where a fixture has no seat."""
        if any(head not in HEADS_DEG for head in heads_deg):
            raise ValueError("the fixture is turned by 0, 90, 180 or 270 deg")
        return heads_deg

    @property
    def settings(self) -> tuple[Setting, ...]:
        """The mountings in their order, all of them for each place of the head."""
        return tuple(Setting(name, head) for head in self.heads_deg for name in self.mountings)

    @property
    def points(self) -> tuple[Position, ...]:
        """All units of work in their order."""
        return tuple(point for setting in self.settings for point in self.points_of(setting))

    def points_of(self, setting: Setting) -> tuple[Position, ...]:
        """Return the positions of one setting: upwards, then downwards."""
        angles = [FULL_TURN_DEG * n / self.positions for n in range(self.positions)]
        up = [Position(setting, round(angle, 9), "up") for angle in angles]
        down = [Position(setting, point.angle_deg, "down") for point in reversed(up)]
        return tuple(up + down if self.up_and_down else up)
