"""What trials of an analysis do to data alike: a column in another scale or moved, noise drawn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np


def scaled(data: Any, part: float, *, column: str) -> Any:
    """Return a dataclass with a number or array of its own larger by a part."""
    return replace(data, **{column: getattr(data, column) * (1.0 + part)})


def shifted(data: Any, by: float, *, column: str) -> Any:
    """Return a dataclass with a number or array of its own moved by so much."""
    return replace(data, **{column: getattr(data, column) + by})


def drawn_size(degrees_of_freedom: float, random: np.random.Generator) -> float:
    """Return by what a standard deviation known with so many degrees of freedom may be larger."""
    if not math.isfinite(degrees_of_freedom):
        return 1.0
    return math.sqrt(degrees_of_freedom / random.chisquare(degrees_of_freedom))
