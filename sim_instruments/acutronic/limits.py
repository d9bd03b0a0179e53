"""Limits of an ACUTROL3000: of a mode at once or one by one, absolute, trips and positions.

The limits of trip and position are printed in the manual with mode, axis and value, and without
the mode. Which of them a controller takes is not confirmed: `limits_by` of the truth is `either`,
`mode` or `axis`.
"""

from __future__ import annotations

import math
from functools import partial

from sim_instruments.acutronic.axis import MODES, Axes, Axis
from sim_instruments.acutronic.language import (
    OUT_OF_RANGE,
    AclError,
    Act,
    Answer,
    argument,
    number,
    whole,
)
from sim_instruments.acutronic.table import TRIP_ABOVE, AclTableData
from sim_instruments.truth import Truth

OF_A_MODE = {"Rate": "rate", "Acceleration": "acceleration", "Jerk": "jerk"}
TRIP = "velocity_trip"
OF_EITHER = {
    "VTrip": TRIP,
    "HighPosition": "high_deg",
    "HPosition": "high_deg",
    "LowPosition": "low_deg",
    "LPosition": "low_deg",
}
"""Positions are written `:Limit:Highposition` and, in the examples, `:LIM:HPOS`."""

TRACKING_TRIP = 1.0
"""The tracking error at which an axis trips, in deg."""

FORMS = ("either", "mode", "axis")


class Limits:
    """What the axes may do in each mode, and how that is set and asked."""

    def __init__(self, truth: Truth, axes: Axes, table: AclTableData) -> None:
        self._axes, self._table = axes, table
        self._form = truth.word("limits_by", FORMS, FORMS[0])
        self._absolutes = truth.integer("absolute_limits", 6, 7)

    def commands(self) -> dict[str, Act]:
        """Return the table of their commands."""
        table: dict[str, Act] = {
            "Limit": self._set_all,
            "Limit:Absolute?": self._axes.answer(self._absolute),
        }
        for names, moded in ((OF_A_MODE, True), (OF_EITHER, False)):
            for name, key in names.items():
                table[f"Limit:{name}"] = partial(self._set_one, key, moded)
                table[f"Limit:{name}?"] = partial(self._one, key, moded)
        return table

    def _set_all(self, given: list[str]) -> None:
        """Take axis, mode, rate, acceleration and jerk."""
        mode = whole(argument(given, 1), MODES)
        for axis in self._axes.named(given):
            for place, key in enumerate(OF_A_MODE.values(), 2):
                if place < len(given):
                    self._set(axis, [mode], key, number(given, place))

    def _modes(self, given: list[str], moded: bool) -> tuple[list[str], list[str]]:
        """Return the modes that a command is for, and its arguments from the axis on."""
        first = argument(given, 0)
        form = "mode" if moded else self._form
        names_axis = first[0].isdigit() or first.upper() == "ALL"
        if names_axis and form != "mode":
            return list(MODES), given
        if form == "axis":
            raise AclError(OUT_OF_RANGE)
        return [whole(first, MODES)], given[1:]

    def _set_one(self, key: str, moded: bool, given: list[str]) -> None:
        modes, rest = self._modes(given, moded)
        for axis in self._axes.named(rest):
            self._set(axis, modes, key, number(rest, 1))

    def _one(self, key: str, moded: bool, given: list[str]) -> Answer:
        modes, rest = self._modes(given, moded)
        value: float = getattr(self._axes.named_axis(rest).limits[modes[-1]], key)
        return ended(value)

    def _set(self, axis: Axis, modes: list[str], key: str, value: float) -> None:
        """Set a limit that the axis can keep; of a continuous axis positions do nothing."""
        table = self._table
        largest = {
            "rate": table.largest_rate,
            "acceleration": table.largest_acceleration,
            TRIP: TRIP_ABOVE * table.largest_rate,
        }
        if key in ("low_deg", "high_deg"):
            allowed = axis.encoder.low_deg <= value <= axis.encoder.high_deg
        else:
            allowed = 0 < value <= largest.get(key, math.inf)
        if not allowed:
            raise AclError(OUT_OF_RANGE)
        for mode in modes:
            setattr(axis.limits[mode], key, value)

    def _absolute(self, axis: Axis) -> Answer:
        """Return what the maker set: rate, acceleration, jerk, positions and trips."""
        rate, acceleration = self._table.largest_rate, self._table.largest_acceleration
        ends = [ended(axis.encoder.low_deg), ended(axis.encoder.high_deg)]
        values = [rate, acceleration, 10 * acceleration, *ends, TRIP_ABOVE * rate, TRACKING_TRIP]
        return values[: self._absolutes]


def ended(limit: float) -> float:
    """Return a limit, 0 and 360 standing for the positions of an axis that turns for ever."""
    return limit if math.isfinite(limit) else 360.0 if limit > 0 else 0.0
