"""The parameters of the contacts' part."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.procedure import ResultKind

CHAMBER, CHAIN = "thermal_chamber", "interlock_chain"
DOOR_ERRORS, CHAIN_ERRORS = "door_contact_errors", "chain_contact_errors"
RESULTS = {DOOR_ERRORS: ResultKind((), "1"), CHAIN_ERRORS: ResultKind((), "1")}
UNIT = "door contact"


class ContactParameters(StrictModel):
    """What the engineer chooses; `station commission` takes both lists from the bench file."""

    door: bool = True
    chain: tuple[str, ...] = ()
    settle_s: Annotated[float, Unit("s"), Field(ge=0, le=60)] = 1.0


def chain_unit(contact: str) -> str:
    """Return the unit of work of a contact of the chain."""
    return f"chain contact {contact}"
