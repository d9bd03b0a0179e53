"""The parameters of the table's part, and the records that they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from station.fields import StrictModel, Unit
from station.procedure import ResultKind

AXES = ("outer", "middle", "inner")
ZEROED = ("middle", "inner")
"""Axes that are level at their zeros. That of the outer one is a heading, which no level shows."""
RESULTS = {
    "turn_ratio": ResultKind(AXES, "1"),
    "rate_ratio": ResultKind(AXES, "1"),
    "encoder_zero": ResultKind(ZEROED, "deg"),
    "axis_lean": ResultKind(AXES, "deg"),
    "axes_off_square": ResultKind((), "deg"),
}
"""What is reported of each axis, with its unit."""
Angles = tuple[float, float, float]
TURN_DEG = 360.0
HALF_TURNS: tuple[Angles, ...] = (
    (0.0, 0.0, 0.0),
    (0.0, 0.0, 180.0),
    (0.0, 180.0, 180.0),
    (0.0, 180.0, 0.0),
    (180.0, 180.0, 0.0),
    (180.0, 180.0, 180.0),
    (180.0, 0.0, 180.0),
    (180.0, 0.0, 0.0),
)
"""Outer, middle and inner angle: every axis at its zero and reversed, one moves at a time."""
HOME: Angles = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TableTurn:
    """A unit of work: an axis turns by an angle in the positive sense and back, between rests."""

    unit: str
    axis: str
    angle_deg: float
    rate_deg_per_s: float
    middle_deg: float = 0.0
    """Where the middle axis stands meanwhile; the two that do not turn are at zero else."""


class MotionParameters(StrictModel):
    """What the engineer chooses of the table's checks.

    `device` is what stands on the table; a navigator aligns at `latitude_deg`.
    """

    device: Literal["imu", "navigator"] = "imu"
    latitude_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)] = 39.9
    align_at_most_s: Annotated[float, Unit("s"), Field(ge=10, le=7200)] = 1800.0
    small_turn_deg: Annotated[float, Unit("deg"), Field(ge=5, le=45)] = 20.0
    small_rate_deg_per_s: Annotated[float, Unit("deg/s"), Field(ge=1, le=20)] = 5.0
    whole_turns: bool = True
    whole_rate_deg_per_s: Annotated[float, Unit("deg/s"), Field(ge=1, le=30)] = 10.0
    rest_s: Annotated[float, Unit("s"), Field(ge=2, le=600)] = 5.0
    sample_rate_Hz: Annotated[float, Unit("Hz"), Field(ge=5, le=100)] = 10.0
    placing_deg: Annotated[float, Unit("deg"), Field(ge=0, le=1)] = 0.005
    navigator_level_deg: Annotated[float, Unit("deg"), Field(ge=0, le=1)] = 0.008
    gyro_misalignment_deg: Annotated[float, Unit("deg"), Field(ge=0, le=1)] = 0.015
    gyro_scale: Annotated[float, Unit("1"), Field(ge=0, le=0.1)] = 0.001

    @property
    def small_turns(self) -> tuple[TableTurn, ...]:
        """The turns that decide the senses: each axis, and the outer one with the plate upright."""
        return (
            *(self._small(f"small turn {axis}", axis) for axis in AXES),
            self._small("small turn outer upright", "outer", 90.0),
        )

    @property
    def turns(self) -> tuple[TableTurn, ...]:
        """All turns, in order."""
        rate = self.whole_rate_deg_per_s
        whole = [TableTurn(f"whole turn {axis}", axis, TURN_DEG, rate) for axis in AXES]
        return (*self.small_turns, *(whole if self.whole_turns else ()))

    def _small(self, unit: str, axis: str, middle_deg: float = 0.0) -> TableTurn:
        return TableTurn(unit, axis, self.small_turn_deg, self.small_rate_deg_per_s, middle_deg)


def level_unit(angles_deg: Angles) -> str:
    """Return the name of the unit of work at rest at outer, middle and inner angles."""
    return f"level at {', '.join(f'{angle_deg:g}' for angle_deg in angles_deg)} deg"


TURNED_UNIT = "level, sensor turned on its plate"
"""At the axes' zeros, the sensor turned by half a turn."""
