"""The keys of an interlock in a bench file."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, WithJsonSchema

from station.fields import Second, StrictModel, quantity_pattern
from station.units import UNITS

BOUND = {
    "type": "string",
    "pattern": quantity_pattern(UNITS),
    "description": "a number with its unit",
}
LEVEL: dict[str, Any] = {
    "type": "object",
    "properties": {
        "instrument": {"type": "string", "description": "an instrument of this bench"},
        "quantity": {"type": "string"},
        "above": BOUND,
        "below": BOUND,
        "outside": {"type": "array", "items": BOUND, "minItems": 2, "maxItems": 2},
        "equals": {"type": "string", "description": "a state, such as open"},
    },
    "required": ["instrument", "quantity"],
    "additionalProperties": False,
}
PARTS = {"type": "array", "items": {"type": "object"}, "minItems": 1}
WHEN = {
    "anyOf": [
        LEVEL,
        *(
            {
                "type": "object",
                "properties": {word: PARTS if word != "not" else {"type": "object"}},
                "required": [word],
                "additionalProperties": False,
            }
            for word in ("any", "all", "not")
        ),
    ],
    "description": "a level or a state of a quantity, or any, all, not of such conditions",
}


class InterlockEntry(StrictModel):
    """One interlock: when it trips, for how long that may be so, and how often it is looked at."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")]
    when: Annotated[dict[str, Any], WithJsonSchema(WHEN)]
    grace_s: Annotated[Second, Field(ge=0)] = 0.0
    period_s: Annotated[Second, Field(gt=0)] | None = None
