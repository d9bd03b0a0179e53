"""Directions of the sensor that point up: `X`, `-X`, `X+Y`, `-X-Y-Z`, and where they stand."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

AXES = ("X", "Y", "Z")
DIRECTION = re.compile(r"[+-]?[XYZ](?:[+-][XYZ]){0,2}")


@dataclass(frozen=True)
class PoseLimits:
    """How far means may lie from an ideal position before it counts as a wrong one.

    `rate_deg_per_h` is what remains once the biases are free; `bias_deg_per_h` is what a bias may
    be where one position is judged alone.
    """

    acceleration_g: float = 0.05
    rate_deg_per_h: float = 1.0
    bias_deg_per_h: float = 5.0


def up_of(word: str) -> tuple[float, float, float] | None:
    """Return the unit vector in sensor axes that a word means; None for a word that means none."""
    if not DIRECTION.fullmatch(word):
        return None
    signed = re.findall(r"([+-]?)([XYZ])", word)
    if len({axis for _, axis in signed}) < len(signed):
        return None
    size = math.sqrt(len(signed))
    signs = {axis: (-1.0 if sign == "-" else 1.0) / size for sign, axis in signed}
    return signs.get("X", 0.0), signs.get("Y", 0.0), signs.get("Z", 0.0)


def table_angles_deg(word: str) -> tuple[float, float]:
    """Return middle and inner angle of a three-axis table that let a direction point up.

    At zero X is along the inner axis and Z up; the middle axis lifts X, the inner one then Y.
    """
    up = up_of(word)
    assert up is not None
    x, y, z = up
    across = math.hypot(y, z)
    inner = math.degrees(math.atan2(y, z)) if across else 0.0
    return math.degrees(math.atan2(x, across)), inner


def ending(word: str) -> str:
    """Return a direction as the end of a prompt's name: `X-up`, `X-down`, `X-down-Y-up`."""
    signed = re.findall(r"([+-]?)([XYZ])", word)
    return "-".join(f"{axis}-{'down' if sign == '-' else 'up'}" for sign, axis in signed)


def in_words(word: str) -> str:
    """Return what an operator reads: `X up`, `X down`, `the edge between X down and Y up, up`."""
    parts = ending(word).split("-")
    named = [f"{axis} {way}" for axis, way in zip(parts[::2], parts[1::2], strict=True)]
    if len(named) == 1:
        return named[0]
    return f"half way between {' and '.join(named)}"
