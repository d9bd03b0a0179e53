"""The limits in an ACUTROL3000: rates, accelerations, trips and positions, proved by read-back."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from drivers.acutronic.line import AclLine, AclSettings, agrees_within
from drivers.transport.exchanges import AnswerInDoubt, LineBroken
from drivers.transport.text_line import check_written
from station.errors import InstrumentError, InstrumentTimeout
from station.roles import Place

TRIP_ABOVE = 1.1
"""The rate at which an axis trips, in the bench's limit; less where the controller ends before."""

RATE, ACCELERATION, TRIP = 0, 1, 5
"""The places of these in the absolute limits, which are also in the order rate, acceleration, jerk,
lowest and highest position, velocity trip; some controllers add a trip of the tracking error."""

MODES = ("P", "R")
"""The modes that the station uses, position and rate."""

LETTERS = {"VTR": "V", "HPOS": "H", "LPOS": "L"}
"""Limits that the manual prints with a mode, and by a letter without one."""


class Limits:
    """What an axis may do, written into the controller for each mode."""

    def __init__(
        self,
        place: Place,
        settings: AclSettings,
        line: AclLine,
        limit: Callable[[str], float],
        met: Callable[[str], None],
    ) -> None:
        self._place, self._settings, self._line = place, settings, line
        self._limit, self._met = limit, met
        self._without_mode = False

    def programme(self, axis: int) -> None:
        """Write the limits of an axis and read them back.

        Position limits act on an axis with end stops alone. Raises InstrumentError where the bench
        allows more than the axis is rated for, and where another value reads back.
        """
        rated = self._rated(axis)
        for name, unit, where in (
            ("rate", "deg/s", RATE),
            ("acceleration", "deg/s^2", ACCELERATION),
        ):
            wanted = self._limit(name)
            if wanted > rated[where]:
                raise InstrumentError(
                    self._place.name,
                    f"limit the {name} of axis {axis} to {wanted:g} {unit}",
                    f"the axis ends at {rated[where]:g} {unit}",
                    f"lower limits.{name} in the bench file",
                )
            for mode in MODES:
                self._write(f"Limit:{name.title()}", [f"{mode},{axis}"], wanted)
        self._write_either("VTR", axis, min(TRIP_ABOVE * self._limit("rate"), rated[TRIP]))
        if axis in self._settings.turns_for_ever:
            return
        for name, header in (("angle_low", "LPOS"), ("angle_high", "HPOS")):
            if name in self._place.limits:
                self._write_either(header, axis, self._place.limits[name])

    def _rated(self, axis: int) -> list[float]:
        """Return what the maker allows of an axis, six numbers or more."""
        message = f":Limit:Absolute? {axis}"
        answer = self._line.query(message)
        try:
            values = [float(text) for text in answer.split(",")]
        except ValueError:
            values = []
        if len(values) < TRIP + 1:
            raise self._line.odd(message, answer)
        return values

    def _write_either(self, header: str, axis: int, value: float) -> None:
        """Set a limit in both modes or, where that is not taken, in the form without a mode."""
        if not self._without_mode:
            try:
                self._write(f"Limit:{header}", [f"{mode},{axis}" for mode in MODES], value)
            except (InstrumentTimeout, AnswerInDoubt, LineBroken):
                raise
            except InstrumentError:
                self._line.forget_errors()
            else:
                self._met("limits of trip and position with a mode")
                return
        self._write(f"L:{LETTERS[header]}", [f"{axis}"], value)
        self._without_mode = True
        self._met("limits of trip and position without a mode")

    def _write(self, header: str, which: Sequence[str], value: float) -> None:
        """Set a value and read it back; InstrumentError where another one comes."""
        self._line.command(";".join(f":{header} {prefix},{value:.6f}" for prefix in which))
        query = ";".join(f":{header}? {prefix}" for prefix in which)
        answer = self._line.query(query).split(";")
        if len(answer) != len(which):
            raise self._line.odd(query, ";".join(answer))
        for prefix, text in zip(which, answer, strict=True):
            read_back, half_digit = self._line.printed(query, text)
            check_written(
                self._place.name, f"{header} {prefix}", value, read_back, agrees_within(half_digit)
            )
