"""What a channel of a Keysight 33522B plays besides: arbitrary waveforms, duty cycles.

From the 33500 series guide: arbitrary waveforms of 8 points at least between -1 and 1 or as DAC
counts; a number beyond its limits is clipped, with an error; a pulse and each level of a square
wave are at least 16 ns wide, and the edges of a pulse, 8.4 ns to 1 us, fit into it. From public
client code: a name that is in use is refused. Assumed: the numbers 785 and 786, that clearing the
memory brings the built-in waveform back, and that an edge takes at most 0.625 of the width, as on
the older 33220A, and becomes shorter where it does not fit.
"""

from __future__ import annotations

import numpy as np

from sim_instruments.generic.waveform import CONFLICT, OUT_OF_RANGE, Wave, clipped
from sim_instruments.wire.scpi import ScpiError, number, number_or
from sim_instruments.world.piecewise import Array

MIN_POINTS, MAX_POINTS = 8, 1_000_000
LARGEST_COUNT = 32767
PERCENT = (0.01, 99.99)
SHORTEST_EDGE_S, EDGE_S, LONGEST_EDGE_S = 8.4e-9, 10e-9, 1e-6
EDGE_PART = 0.625
ROUNDING = 1.0 + 1e-9
BUILT_IN = "EXP_RISE"
NO_SUCH_ARB, ARB_EXISTS = 785, 786


class ArbitraryWave(Wave):
    """The function of one channel, which may be a waveform that was sent."""

    def reset(self) -> None:
        """Go to a sine of 1 kHz."""
        super().reset()
        self.rate_per_s = 40e3
        self.leading_s = self.trailing_s = EDGE_S
        self.clear()

    def clear(self) -> None:
        """Forget the arbitrary waveforms that were sent."""
        self._memory: dict[str, Array] = {BUILT_IN: np.linspace(-1.0, 1.0, MIN_POINTS)}
        self.arb = BUILT_IN

    def cycle_s(self) -> float:
        """Return how long one cycle takes, in s."""
        if self.function == "ARB":
            return len(self._memory[self.arb]) / self.rate_per_s
        return super().cycle_s()

    def levels(self) -> list[tuple[float, float]]:
        """Return one cycle as times from its start in s and the levels, -1 to 1, from then on."""
        if self.function != "ARB":
            return super().levels()
        values = self._memory[self.arb]
        steps = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1))
        return [(float(k) / self.rate_per_s, float(values[k])) for k in steps]

    def idle(self) -> float:
        """Return the level, -1 to 1, at which a burst waits for its trigger."""
        return float(self._memory[self.arb][0]) if self.function == "ARB" else super().idle()

    @property
    def pulse_percent(self) -> float:
        """The width of the pulse as a part of the period, in %."""
        return 100.0 * self.width_s / self.period_s

    def number(self, text: str, lowest: float, highest: float, default: float) -> float:
        """Return a number, or what MIN, MAX, DEF stand for, clipped to what lies between two."""
        forms = {"MIN": lowest, "MINIMUM": lowest, "MAX": highest, "MAXIMUM": highest}
        value = number_or(text, {**forms, "DEF": default, "DEFAULT": default})
        return clipped(self.complain, value, lowest, highest)

    def set_period(self, period_s: float) -> None:
        """Set the period; pulse, edges and duty cycle that do not fit give way."""
        super().set_period(period_s)
        self._fit_edges()
        least = self._least_percent()
        if self.duty_percent != min(max(self.duty_percent, least), 100.0 - least):
            self.duty_percent = min(max(self.duty_percent, least), 100.0 - least)
            if self.function == "SQU":
                self.complain(CONFLICT, "duty cycle changed due to frequency")

    def set_width(self, text: str) -> None:
        """Set the width of the pulse; edges that do not fit become shorter."""
        super().set_width(text)
        self._fit_edges()

    def set_pulse_duty(self, text: str) -> None:
        """Set the width of the pulse as a part of the period, in %."""
        self.set_width(str(self.number(text, *PERCENT, 10.0) / 100.0 * self.period_s))

    def set_square_duty(self, text: str) -> None:
        """Set for how much of the period a square wave is high, in %."""
        least = self._least_percent()
        self.duty_percent = self.number(text, least, 100.0 - least, 50.0)

    def set_edges(self, *names: str, text: str) -> None:
        """Set how long edges of the pulse take; what does not fit into it is clipped."""
        longest_s = max(min(LONGEST_EDGE_S, EDGE_PART * self.width_s), SHORTEST_EDGE_S)
        edge_s = self.number(text, SHORTEST_EDGE_S, longest_s, EDGE_S)
        for name in names:
            setattr(self, name, edge_s)

    def _fit_edges(self) -> None:
        longest_s = max(EDGE_PART * self.width_s, SHORTEST_EDGE_S)
        if max(self.leading_s, self.trailing_s) > ROUNDING * longest_s:
            self.leading_s = min(self.leading_s, longest_s)
            self.trailing_s = min(self.trailing_s, longest_s)
            if self.function == "PULS":
                self.complain(CONFLICT, "edge time changed due to pulse width")

    def _least_percent(self) -> float:
        """Return the least part of the period that a level of a square wave lasts, in %."""
        return min(max(PERCENT[0], 100.0 * self.ratings.least_width_s / self.period_s), 50.0)

    def choose(self, text: str) -> None:
        """Choose an arbitrary waveform by its name."""
        name = named(text)
        if name not in self._memory:
            raise ScpiError(NO_SUCH_ARB)
        self.arb = name

    def take(self, parameters: list[str], *, counts: bool, block: bytes | None) -> None:
        """Take an arbitrary waveform: its name, then its points, or a `block` of them.

        A block holds DAC counts of 16 bits or single floats, the most significant byte first.
        """
        if len(parameters) < 2:
            raise ScpiError(-109)
        name = named(parameters[0])
        if name in self._memory:
            raise ScpiError(ARB_EXISTS)
        if block is None:
            values = np.array([number(text) for text in parameters[1:]])
        else:
            kind = np.dtype(">i2" if counts else ">f4")
            if len(block) % kind.itemsize:
                raise ScpiError(-161)
            values = np.frombuffer(block, kind).astype(np.float64)
        if not MIN_POINTS <= len(values) <= MAX_POINTS:
            raise ScpiError(OUT_OF_RANGE)
        values = values / LARGEST_COUNT if counts else values
        if (np.abs(values) > 1.0).any():
            raise ScpiError(OUT_OF_RANGE)
        self._memory[name] = values

    def catalogue(self) -> str:
        """Return the names of the waveforms in the memory."""
        return ",".join(f'"{name}"' for name in self._memory)


def named(text: str) -> str:
    """Return a name, which may stand between quotes."""
    quoted = len(text) >= 2 and text[0] in "\"'" and text[-1] == text[0]
    return (text[1:-1] if quoted else text).upper()
