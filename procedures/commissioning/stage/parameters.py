"""The parameters of the stage's part, and the records that they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.procedure import ResultKind

RESULTS = {
    "stage_response": ResultKind((), "1"),
    "stage_zero": ResultKind((), "deg"),
    "stage_closure": ResultKind((), "deg"),
    "stage_lean": ResultKind((), "deg"),
}
"""What is reported of the stage, with its unit."""
QUARTERS_DEG = (0.0, 90.0, 180.0, 270.0)
WHOLE_DEG = 360.0


@dataclass(frozen=True)
class StageRecord:
    """A unit of work: the accelerometer's output at an angle, mounted for a plane."""

    plane: str
    angle_deg: float

    @property
    def unit(self) -> str:
        """The name of the unit of work."""
        return f"stage {self.plane} at {self.angle_deg:g} deg"


class StageParameters(StrictModel):
    """What the engineer chooses of the stage's checks."""

    scale_factor_V_per_g: Annotated[float, Unit("V/g"), Field(gt=0)] = 1.0
    mounting_deg: Annotated[float, Unit("deg"), Field(ge=0, le=1)] = 0.008
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0, le=7200)] = 300.0
    readings: Annotated[int, Field(ge=2, le=1000)] = 10
    nplc: Annotated[float, Field(ge=0.02, le=100)] = 10.0

    @property
    def records(self) -> tuple[StageRecord, ...]:
        """All records, in order: a whole turn in the plane io, then a reversal in op."""
        turn = [StageRecord("io", angle_deg) for angle_deg in (*QUARTERS_DEG, WHOLE_DEG)]
        return (*turn, *(StageRecord("op", angle_deg) for angle_deg in reversed(QUARTERS_DEG)))
