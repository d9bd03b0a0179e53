"""The parameters of the probe's part, and the records that they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.procedure import ResultKind

COILS = ("x", "y", "z")
MOVE_MM = 80.0
"""A third of a usual coil's radius: the field falls off there by more than its readings' noise."""
SENSES = {"plus": 1.0, "minus": -1.0}
RESULTS = {
    "probe_offset": ResultKind(COILS, "mm"),
    "probe_field_error": ResultKind(COILS, "1"),
    "homogeneity": ResultKind(COILS, "1"),
}
"""What is reported of each axis, with its unit."""


@dataclass(frozen=True)
class ProbePlace:
    """Where a person puts the probe, in mm from the place of the device."""

    name: str
    shift_mm: tuple[float, float, float]


DEVICE = ProbePlace("at the device", (0.0, 0.0, 0.0))
PLACES = (
    DEVICE,
    *(
        ProbePlace(
            f"{axis}-{sense}",
            (
                MOVE_MM * sign * (axis == "x"),
                MOVE_MM * sign * (axis == "y"),
                MOVE_MM * sign * (axis == "z"),
            ),
        )
        for axis in COILS
        for sense, sign in SENSES.items()
    ),
)


@dataclass(frozen=True)
class PlaceRecord:
    """A unit of work: the field of a coil in one sense, at a place of the probe."""

    place: ProbePlace
    coil: str
    sense: str
    field_mT: float

    @property
    def unit(self) -> str:
        """The name of the unit of work."""
        return f"probe {self.place.name}, coil {self.coil} {self.sense}"


class ProbeParameters(StrictModel):
    """What the engineer chooses; `device` is the edge of the cube that holds the device."""

    field_mT: Annotated[float, Unit("mT"), Field(gt=0, le=2.0)] = 0.5
    record_s: Annotated[float, Unit("s"), Field(ge=2, le=600)] = 3.0
    settle_s: Annotated[float, Unit("s"), Field(ge=0.5, le=60)] = 1.0
    device_mm: Annotated[float, Unit("mm"), Field(gt=0, le=200)] = 60.0
    placing_mm: Annotated[float, Unit("mm"), Field(ge=0, le=10)] = 1.0

    def records_at(self, place: ProbePlace) -> tuple[PlaceRecord, ...]:
        """Return the records at a place: every coil in both senses."""
        return tuple(
            PlaceRecord(place, coil, sense, sign * self.field_mT)
            for coil in COILS
            for sense, sign in SENSES.items()
        )
