"""Whether the meters still measure: they answer, but the number stays the same.

Angle or field change from each point to the next, and every reading has noise: a reading that is
the same to the last digit over several points is no measurement, and its fit would look perfect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from station.errors import InstrumentError

POINTS = 3
"""So many points in a row may not read the same."""


@dataclass
class StandingStill:
    """What a voltmeter and a gaussmeter read at the last points."""

    outputs_V: list[set[float]] = field(default_factory=list)
    commanded_mT: float = math.nan
    measured_mT: float = math.nan

    def output(self, instrument: str, unit: str, readings_V: set[float]) -> None:
        """Take the readings of a point; raises InstrumentError where three points read the same."""
        self.outputs_V = [*self.outputs_V[1 - POINTS :], readings_V]
        if len(self.outputs_V) == POINTS and len(set().union(*self.outputs_V)) == 1:
            raise InstrumentError(
                instrument,
                f"measured {unit}",
                f"it reads {min(readings_V):.9g} V to the last digit for {POINTS} points",
                "look at its display, its input and what triggers it, then run again",
            )

    def driven(
        self, instrument: str, commanded_mT: float, measured_mT: float, least_mT: float
    ) -> None:
        """Take the field of a point; raises InstrumentError where it did not follow at all.

        `least_mT` is the least change of the commanded field that must show.
        """
        changed = abs(commanded_mT - self.commanded_mT) > least_mT
        if changed and measured_mT == self.measured_mT:
            raise InstrumentError(
                instrument,
                f"looked for a field of {commanded_mT:g} mT",
                f"it reads {measured_mT:.9g} mT as at {self.commanded_mT:g} mT, to the last digit",
                "look at its display and its probe's cable, then run again",
            )
        self.commanded_mT, self.measured_mT = commanded_mT, measured_mT
