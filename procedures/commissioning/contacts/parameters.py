"""The parameters of the contacts' part."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.procedure import ResultKind

RESULTS = {"door_contact_errors": ResultKind((), "1")}
UNIT = "door contact"


class ContactParameters(StrictModel):
    """What the engineer chooses."""

    settle_s: Annotated[float, Unit("s"), Field(ge=0, le=60)] = 1.0
