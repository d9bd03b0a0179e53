"""Values with their uncertainties, and roots of squares that may be zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Measured:
    """A value with its standard uncertainty and degrees of freedom, None for infinitely many."""

    value: float
    u: float
    degrees_of_freedom: float | None = None


def root(square: float, u: float) -> Measured:
    """Return the root of a square with its uncertainty, which is finite at zero."""
    square = max(square, 0.0)
    return Measured(float(np.sqrt(square)), float(np.sqrt(square + u) - np.sqrt(square)))
