"""The parameters of the clocks' part."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.procedure import ResultKind

RESULTS = {"gaussmeter_clock_error": ResultKind((), "ppm")}
UNIT = "gaussmeter clock"


class ClockParameters(StrictModel):
    """What the engineer chooses."""

    record_s: Annotated[float, Unit("s"), Field(ge=20, le=3600)] = 300.0
