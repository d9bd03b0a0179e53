"""The parameters of the lines' part."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from station.fields import StrictModel
from station.procedure import ResultKind

LineName = Literal[
    "coil_supply.x",
    "coil_supply.y",
    "coil_supply.z",
    "coil_supply.dc",
    "gaussmeter",
    "multimeter",
    "thermometer",
    "rotary_stage",
    "turntable",
    "thermal_chamber",
]
"""Instruments that answer one question at a time; those that stream have their own line checks."""
LINES: tuple[LineName, ...] = LineName.__args__  # type: ignore[attr-defined]
LATENCY, SLOWEST, LOST = "line_latency", "line_latency_p99", "line_errors"
JITTER, KEPT = "line_jitter", "kept_errors"
LONGEST = "longest_answer"
RESULTS = {
    LATENCY: ResultKind(LINES, "ms"),
    SLOWEST: ResultKind(LINES, "ms"),
    LONGEST: ResultKind(LINES, "ms"),
    JITTER: ResultKind(LINES, "ms"),
    LOST: ResultKind(LINES, "1"),
    KEPT: ResultKind(LINES, "1"),
}
"""What is reported of each instrument, with its unit."""


class LineParameters(StrictModel):
    """What the engineer chooses. `disconnected` are those whose cable a person pulls and puts back.

    `queries` are asked of each instrument, for its identity.
    """

    instruments: Annotated[tuple[LineName, ...], Field(min_length=1)] = LINES
    queries: Annotated[int, Field(ge=20, le=10000)] = 50
    disconnected: tuple[LineName, ...] = ()


def line_unit(name: str) -> str:
    """Return the name of the unit of work that asks an instrument."""
    return f"line of {name}"


def return_unit(name: str) -> str:
    """Return the name of the unit of work that disconnects an instrument."""
    return f"return of {name}"
