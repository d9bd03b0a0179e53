"""What gaussmeters share that measure along three axes at once and keep their readings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from station.roles import Block, Place

OVERLOAD_T = 9e37
"""SCPI's word for infinity, 9.9E37, and what is nearly that."""


def in_mT(magnitude_T: float) -> float:
    """Return a magnitude in mT, infinite for what an instrument says of an overload."""
    return magnitude_T * 1e3 if abs(magnitude_T) < OVERLOAD_T else math.inf


class ThreeAxes:
    """Nobody turns the probe; a row is the instrument's time in s, x, y, z in T, the state."""

    axes: ClassVar[int] = 3
    keeps_readings: ClassVar[bool] = True
    source = "gaussmeter"
    components: ClassVar[Mapping[str, str]] = {
        "x_T": "T along the probe's x",
        "y_T": "T along the probe's y",
        "z_T": "T along the probe's z",
    }
    columns: ClassVar[Mapping[str, str]]
    place: Place

    def turn_to(self, axis: str) -> None:
        """Do nothing: it measures along all three axes."""

    def block(self, rows: NDArray[np.float64], arrival_s: float) -> Block:
        """Return rows of the columns that came at a run time; publish the newest magnitude."""
        if len(rows):
            self.place.publish("field", in_mT(float(np.linalg.norm(rows[-1, 1:4]))), "mT")
        return Block(dict(zip(self.columns, rows.T, strict=True)), np.full(len(rows), arrival_s))
