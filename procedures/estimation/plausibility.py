"""What can hardly be: a stated or measured value beyond what nature or an instrument has."""

from __future__ import annotations

from dataclasses import dataclass

from station.findings import Flag, contradiction

GRAVITY_G = (0.9955, 1.0030)
"""Gravity on the ground of the earth, in 9.80665 m/s^2: from the tops of the Andes to the poles."""
OUTPUT_V = 42.0
"""An accelerometer's output in V stays below it: a larger one is in mV or µV."""


@dataclass(frozen=True)
class Bounds:
    """What a value of a statement (a column or condition) can hardly go beyond, and where to look.

    `name` is as a sentence begins with it: `The local gravity`.
    """

    statement: str
    name: str
    low: float
    high: float
    unit: str
    look: str


def implausible(value: float, bounds: Bounds, axis: str | None = None) -> list[Flag]:
    """Return the flag of a value beyond its bounds, or none."""
    if bounds.low <= value <= bounds.high:
        return []
    read, low, high = (
        f"{number:.6g} {bounds.unit}".rstrip() for number in (value, bounds.low, bounds.high)
    )
    text = f"{bounds.name} is {read}, which is hardly possible: {low} to {high} are. {bounds.look}"
    return [contradiction(bounds.statement, text, axis, value=value)]
