"""The parameters of the chamber's part."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.procedure import ResultKind

AXES = ("x", "y", "z")
RESULTS = {
    "chamber_overshoot": ResultKind((), "K"),
    "chamber_lag": ResultKind((), "s"),
    "chamber_steady_error": ResultKind((), "K"),
    "thermometer_gain": ResultKind(AXES, "1"),
    "thermometer_lag": ResultKind(AXES, "1"),
}
"""What is reported of the chamber and of the device's thermometers, with its unit."""
UNIT = "chamber step"
STEPPED = "stepped_s"


class ChamberParameters(StrictModel):
    """What the engineer chooses: where the air is held first, and the step from there."""

    from_degC: Annotated[float, Unit("degC")] = 25.0
    step_K: Annotated[float, Unit("K"), Field(ge=2, le=10)] = 5.0
    before_s: Annotated[float, Unit("s"), Field(ge=900, le=14400)] = 1800.0
    after_s: Annotated[float, Unit("s"), Field(ge=1800, le=14400)] = 3600.0
