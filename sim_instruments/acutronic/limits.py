"""The axes of an ACUTROL3000 as its commands name them, and the commands of their limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from sim_instruments.acutronic.axis import MODES, Axis
from sim_instruments.acutronic.language import (
    OUT_OF_RANGE,
    AclError,
    Language,
    argument,
    decimal,
    number,
    whole,
)
from sim_instruments.acutronic.table import ModeLimits, Table

NAMES = {"RATE": "rate", "ACCELERATION": "acceleration", "JERK": "jerk"}
TRIP_ABOVE = 1.2
"""The largest velocity trip, in the axis' largest rate."""


class Axes(dict[int, Axis]):
    """Axes by number; in a command ALL means each of them."""

    def one(self, given: list[str]) -> Axis:
        """Return the axis that the first argument names."""
        n = number(given, 0)
        if n not in self:
            raise AclError(OUT_OF_RANGE)
        return self[int(n)]

    def named(self, given: list[str]) -> list[Axis]:
        """Return the axes that the first argument names."""
        if given and given[0].upper() == "ALL":
            return list(self.values())
        return [self.one(given)]

    def answer(self, answer: Callable[[Axis, list[str]], str]) -> Callable[[list[str]], str]:
        """Return a query whose first argument is an axis."""
        return lambda given: answer(self.one(given), given[1:])

    def command(self, act: Callable[[Axis, list[str]], None]) -> Callable[[list[str]], None]:
        """Return a command whose first argument is an axis, or ALL."""

        def command(given: list[str]) -> None:
            for axis in self.named(given):
                act(axis, given[1:])

        return command


def add_limits(language: Language, axes: Axes, table: Table) -> None:
    """Add the limits: of a mode at once, one by one with the mode first, absolute, and trips."""
    add = language.add
    add("Limit", partial(limit_all, axes, table))
    add("Limit:Absolute?", axes.answer(partial(absolute, table)))
    for name, key in NAMES.items():
        add(f"Limit:{name}", partial(limit_one, axes, table, key))
        add(f"Limit:{name}?", partial(limit_of, axes, key))
    for name, key in (("LowPosition", "low_deg"), ("HighPosition", "high_deg")):
        add(f"Limit:{name}", axes.command(partial(limit_position, key)))
        add(f"Limit:{name}?", axes.answer(partial(position_limit, key)))
    add("Limit:VelocityTrip", axes.command(partial(set_trip, table)))
    add("Limit:VelocityTrip?", axes.answer(lambda axis, _: decimal(axis.velocity_trip)))


def limit_all(axes: Axes, table: Table, given: list[str]) -> None:
    """Take axis, mode, rate, acceleration and jerk."""
    mode = whole(argument(given, 1), MODES)
    for axis in axes.named(given):
        for place, key in enumerate(NAMES.values(), 2):
            if place < len(given):
                set_limit(table, axis.limits[mode], key, number(given, place))


def limit_one(axes: Axes, table: Table, key: str, given: list[str]) -> None:
    """Take mode, axis and one limit."""
    mode = whole(argument(given, 0), MODES)
    for axis in axes.named(given[1:]):
        set_limit(table, axis.limits[mode], key, number(given, 2))


def set_limit(table: Table, limits: ModeLimits, key: str, value: float) -> None:
    """Set a limit that the axis can keep."""
    largest = {"rate": table.largest_rate, "acceleration": table.largest_acceleration}
    if not 0 < value <= largest.get(key, math.inf):
        raise AclError(OUT_OF_RANGE)
    setattr(limits, key, value)


def limit_of(axes: Axes, key: str, given: list[str]) -> str:
    """Return a limit of a mode of an axis."""
    limits = axes.one(given[1:]).limits[whole(argument(given, 0), MODES)]
    return decimal(getattr(limits, key))


def limit_position(key: str, axis: Axis, given: list[str]) -> None:
    """Limit the positions of an axis that has end stops."""
    value = number(given, 0)
    if axis.encoder.continuous or not axis.encoder.low_deg <= value <= axis.encoder.high_deg:
        raise AclError(OUT_OF_RANGE)
    setattr(axis, key, value)


def position_limit(key: str, axis: Axis, given: list[str]) -> str:
    """Return a limit of the positions of an axis."""
    return ended(getattr(axis, key))


def set_trip(table: Table, axis: Axis, given: list[str]) -> None:
    """Set the rate at which an axis trips."""
    value = number(given, 0)
    if not 0 < value <= TRIP_ABOVE * table.largest_rate:
        raise AclError(OUT_OF_RANGE)
    axis.velocity_trip = value


def absolute(table: Table, axis: Axis, given: list[str]) -> str:
    """Return what the maker set: rate, acceleration, jerk, positions and velocity trip."""
    rate, acceleration = table.largest_rate, table.largest_acceleration
    ends = [ended(axis.encoder.low_deg), ended(axis.encoder.high_deg)]
    values = [decimal(one) for one in (rate, acceleration, 10 * acceleration)]
    return ",".join([*values, *ends, decimal(TRIP_ABOVE * rate)])


def ended(limit_deg: float) -> str:
    """Return a position limit, 0 and 360 standing for an axis that turns for ever."""
    if limit_deg in (float("inf"), float("-inf")):
        return decimal(360.0 if limit_deg > 0 else 0.0)
    return decimal(limit_deg)
