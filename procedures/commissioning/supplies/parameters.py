"""The parameters of the supplies' part, and its units of work."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from procedures.commissioning.coils.parameters import COILS
from station.fields import StrictModel, Unit
from station.procedure import ResultKind

RESULTS = {
    "own_limit_ratio": ResultKind(COILS, "1"),
    "field_after_cut": ResultKind(COILS, "mT"),
}
"""What is reported of each supply, with its unit."""
COMMANDED, FLOWS = "commanded_A", "current_A"


def limit_unit(coil: str) -> str:
    """Return the unit of work in which a supply is asked for more than a limit of its own."""
    return f"own limit {coil}"


def before_unit(coil: str) -> str:
    """Return the unit of work that records the field with the output off."""
    return f"before {coil} is on"


def cut_unit(coil: str) -> str:
    """Return the unit of work that records the field after the output was cut off."""
    return f"after {coil} is cut off"


class SupplyParameters(StrictModel):
    """What the engineer chooses; both currents are small, and below every limit of the bench."""

    limit_A: Annotated[float, Unit("A"), Field(gt=0, le=2)] = 0.3
    beyond: Annotated[float, Unit("1"), Field(gt=0.1, le=1)] = 0.5
    cut_at_A: Annotated[float, Unit("A"), Field(gt=0, le=1)] = 0.3
    record_s: Annotated[float, Unit("s"), Field(ge=2, le=600)] = 3.0
    settle_s: Annotated[float, Unit("s"), Field(ge=0.5, le=60)] = 1.0
    turn_probe: bool = False

    @property
    def asked_A(self) -> float:
        """The current that is asked for while the limit is in force."""
        return self.limit_A * (1.0 + self.beyond)
