"""A table under an ACUTROL3000: what its axes can, may and shall do."""

from __future__ import annotations

from dataclasses import dataclass

from sim_instruments.generic.table_axis import TableData
from sim_instruments.truth import Truth

TRIP_ABOVE = 1.2
"""The largest velocity trip, in the axis' largest rate."""


class AclTableData(TableData):
    """That and what an ACUTROL adds; truth of the bench file.

    `settling`, how long after its end a profile counts as complete; `tracking_bit`, in which a
    tracking fault is reported: 2, or 12 before build 1848.
    """

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        self.settling_s = self.time_s(truth, "settling")
        self.tracking_error = 1 << truth.integer("tracking_bit", 2, 2)


@dataclass
class ModeLimits:
    """What a mode may use of an axis."""

    rate: float
    acceleration: float
    jerk: float
    velocity_trip: float
    low_deg: float
    high_deg: float


@dataclass
class Demands:
    """What was demanded of each mode, whether or not the axis is in it."""

    position: float = 0.0
    rate: float = 0.0
    acceleration: float = 0.0
    change_deg: float = 0.0
    oscillator: tuple[float, ...] = (0.0, 0.0, 0.0)
    slews: tuple[str | float, ...] = ("Disable", 0.0, 0.0, "Position", "Linear")
    """Of the oscillator: whether its values slew, how fast amplitude and frequency do, of what
    quantity the amplitude is, and how it slews."""

    def vector(self) -> tuple[float, ...]:
        """Return the demands of position and rate."""
        return self.position, self.rate
