"""What a channel of a function generator plays: its function, its pulse, its square wave.

As guides of such generators have it, whoever made them: the width of a pulse goes up to the period
less the least width, and gives way to the period.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from sim_instruments.wire.scpi import number_or, numeric

Complain = Callable[[int, str], None]
"""Takes the number of an error and what is said beyond its standard text."""

OUT_OF_RANGE, CONFLICT = -222, -221


class Ratings(NamedTuple):
    """What the outputs of a model may give; voltages at an open end."""

    largest_V: float
    least_Vpp: float
    apart_V: float
    """The least between high and low level."""
    loads_ohm: tuple[float, float]
    periods_s: tuple[float, float]
    least_width_s: float


class Wave:
    """The function of one channel and the shape of one cycle, from -1 to 1."""

    def __init__(self, ratings: Ratings, complain: Complain) -> None:
        self.ratings, self.complain = ratings, complain
        self.reset()

    def reset(self) -> None:
        """Go to a sine of 1 kHz."""
        self.function = "SIN"
        self.period_s, self.width_s, self.duty_percent = 1e-3, 100e-6, 50.0

    @property
    def frequency_Hz(self) -> float:
        """The frequency."""
        return 1.0 / self.period_s

    def cycle_s(self) -> float:
        """Return how long one cycle takes, in s."""
        return self.period_s

    def levels(self) -> list[tuple[float, float]]:
        """Return one cycle as times from its start in s and the levels, -1 to 1, from then on.

        What does not consist of levels, a sine for instance, is represented by its mean.
        """
        if self.function == "PULS":
            return [(0.0, 1.0), (self.width_s, -1.0)]
        if self.function == "SQU":
            return [(0.0, 1.0), (self.period_s * self.duty_percent / 100.0, -1.0)]
        return [(0.0, 0.0)]

    def idle(self) -> float:
        """Return the level, -1 to 1, at which a burst waits for its trigger."""
        return -1.0 if self.function in ("PULS", "SQU") else 0.0

    def mean(self) -> float:
        """Return the mean level of the running waveform, -1 to 1."""
        cycle_s = self.cycle_s()
        ends_s = [*(start_s for start_s, _ in self.levels()[1:]), cycle_s]
        parts = zip(self.levels(), ends_s, strict=True)
        return sum(level * (end_s - start_s) for (start_s, level), end_s in parts) / cycle_s

    def set_period(self, period_s: float) -> None:
        """Set the period; a pulse that does not fit becomes shorter."""
        self.period_s = clipped(self.complain, period_s, *self.ratings.periods_s)
        longest_s = self.period_s - self.ratings.least_width_s
        if self.width_s > longest_s:
            self.width_s = longest_s
            if self.function == "PULS":
                self.complain(CONFLICT, "pulse width changed due to period")

    def number(self, text: str, lowest: float, highest: float, default: float) -> float:
        """Return a number between two, or what MIN, MAX, DEF stand for; others are refused."""
        return numeric(text, lowest, highest, default)

    def set_frequency(self, text: str, highest_Hz: float) -> None:
        """Set the period by the frequency."""
        self.set_period(1.0 / self.number(text, 1e-6, highest_Hz, 1e3))

    def set_width(self, text: str) -> None:
        """Set the width of the pulse."""
        least_s = self.ratings.least_width_s
        longest_s = self.period_s - least_s
        width_s = number_or(text, {"MIN": least_s, "MAX": longest_s})
        self.width_s = clipped(self.complain, width_s, least_s, longest_s)


def clipped(
    complain: Complain, value: float, lowest: float, highest: float, rounding: float = 0.0
) -> float:
    """Return what is left of a value between two others; what is clipped is an error."""
    if value < lowest - rounding:
        complain(OUT_OF_RANGE, "value clipped to lower limit")
    elif value > highest + rounding:
        complain(OUT_OF_RANGE, "value clipped to upper limit")
    return min(max(value, lowest), highest)
