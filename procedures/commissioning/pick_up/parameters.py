"""The parameters of the pick-up part."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.procedure import ResultKind

COILS = ("x", "y", "z")
OFF = "off"
RESULTS = {"pick_up": ResultKind(COILS, "uV")}
"""What is reported of each coil, with its unit."""
FREQUENCY = "frequency_Hz"


class PickUpParameters(StrictModel):
    """What the engineer chooses: the drive that later plans use, and the record."""

    frequency_Hz: Annotated[float, Unit("Hz"), Field(ge=0.05, le=0.2)] = 0.1
    field_mT: Annotated[float, Unit("mT"), Field(gt=0, le=2.0)] = 0.5
    record_s: Annotated[float, Unit("s"), Field(ge=20, le=600)] = 30.0
    every_s: Annotated[float, Unit("s"), Field(ge=0.2, le=2)] = 0.5


def unit_of(coil: str) -> str:
    """Return the name of the unit of work in which a coil is driven, or all are off."""
    return f"pick-up, coils {OFF}" if coil == OFF else f"pick-up, coil {coil} driven"
