"""What a channel of a Keysight 33522B plays: its functions, its pulse, its arbitrary waveforms.

From the 33500 series guide: pulse widths from 16 ns to the period less 16 ns, the width gives way
to the period, arbitrary waveforms of 8 points at least between -1 and 1 or as DAC counts. From
public client code: a name that is in use is refused. Assumed: the numbers 785 and 786, and that
clearing the memory brings the built-in waveform back.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim_instruments.wire.scpi import ScpiError, choice, number, numeric
from sim_instruments.world.piecewise import Array

Complain = Callable[[int, str], None]
"""Takes the number of an error and what is said beyond its standard text."""

MIN_WIDTH_S = 16e-9
MAX_S = 1e6
PERIODS_S = (1 / 30e6, MAX_S)
RATES_PER_S = (1e-6, 250e6)
MIN_POINTS, MAX_POINTS = 8, 1_000_000
LARGEST_COUNT = 32767
BUILT_IN = "EXP_RISE"
LOWER, UPPER = "value clipped to lower limit", "value clipped to upper limit"
OUT_OF_RANGE, CONFLICT = -222, -221
TRIPPED, NO_SUCH_ARB, ARB_EXISTS = -240, 785, 786
OWN_TEXTS = {
    TRIPPED: "Hardware error;output overload",
    NO_SUCH_ARB: "Specified arb waveform does not exist",
    ARB_EXISTS: "Specified arb waveform already exists",
}

FUNCTIONS = {
    "SIN": "SIN",
    "SINUSOID": "SIN",
    "SQU": "SQU",
    "SQUARE": "SQU",
    "TRI": "TRI",
    "TRIANGLE": "TRI",
    "RAMP": "RAMP",
    "PULS": "PULS",
    "PULSE": "PULS",
    "PRBS": "PRBS",
    "NOIS": "NOIS",
    "NOISE": "NOIS",
    "ARB": "ARB",
    "ARBITRARY": "ARB",
    "DC": "DC",
}
NO_BURST = ("DC", "NOIS", "PRBS")
HOLDS = {"WIDT": "WIDT", "WIDTH": "WIDT", "DCYC": "DCYC", "DCYCLE": "DCYC"}
FILTERS = {"NORM": "NORM", "NORMAL": "NORM", "STEP": "STEP", "OFF": "OFF"}


class Refusal(ScpiError):
    """A refusal with a number of the instrument's own."""

    def __init__(self, code: int) -> None:
        Exception.__init__(self, f"{code:+d},{OWN_TEXTS[code]}")
        self.code = code


class Wave:
    """The function of one channel and the shape of one cycle, from -1 to 1."""

    def __init__(self, complain: Complain) -> None:
        self._complain = complain
        self.reset()

    def reset(self) -> None:
        """Go to a sine of 1 kHz."""
        self.function = "SIN"
        self.period_s, self.width_s, self.hold = 1e-3, 100e-6, "WIDT"
        self.rate_per_s, self.filter, self.duty_percent = 40e3, "STEP", 50.0
        self.clear()

    def clear(self) -> None:
        """Forget the arbitrary waveforms that were sent."""
        self._memory: dict[str, Array] = {BUILT_IN: np.linspace(-1.0, 1.0, MIN_POINTS)}
        self.arb = BUILT_IN

    def cycle_s(self) -> float:
        """Return how long one cycle takes, in s."""
        if self.function == "ARB":
            return len(self._memory[self.arb]) / self.rate_per_s
        return self.period_s

    def levels(self) -> list[tuple[float, float]]:
        """Return one cycle as times from its start in s and the levels, -1 to 1, from then on.

        What does not consist of levels, a sine for instance, is represented by its mean.
        """
        if self.function == "PULS":
            return [(0.0, 1.0), (self.width_s, -1.0)]
        if self.function == "SQU":
            return [(0.0, 1.0), (self.period_s * self.duty_percent / 100.0, -1.0)]
        if self.function == "ARB":
            values = self._memory[self.arb]
            steps = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1))
            return [(float(k) / self.rate_per_s, float(values[k])) for k in steps]
        return [(0.0, 0.0)]

    def idle(self) -> float:
        """Return the level, -1 to 1, at which a burst waits for its trigger."""
        if self.function in ("PULS", "SQU"):
            return -1.0
        return float(self._memory[self.arb][0]) if self.function == "ARB" else 0.0

    def mean(self) -> float:
        """Return the mean level of the running waveform, -1 to 1."""
        cycle_s = self.cycle_s()
        ends_s = [*(start_s for start_s, _ in self.levels()[1:]), cycle_s]
        parts = zip(self.levels(), ends_s, strict=True)
        return sum(level * (end_s - start_s) for (start_s, level), end_s in parts) / cycle_s

    def set_period(self, period_s: float) -> None:
        """Set the period; a pulse that does not fit becomes shorter."""
        self.period_s = self._clipped(period_s, *PERIODS_S)
        longest_s = self.period_s - MIN_WIDTH_S
        if self.width_s > longest_s:
            self.width_s = longest_s
            if self.function == "PULS":
                self._complain(CONFLICT, "pulse width changed due to period")

    def set_width(self, text: str) -> None:
        """Set the width of the pulse."""
        word = text.upper()
        longest_s = self.period_s - MIN_WIDTH_S
        words = {"MIN": MIN_WIDTH_S, "MAX": longest_s}
        width_s = words[word] if word in words else number(text)
        self.width_s = self._clipped(width_s, MIN_WIDTH_S, longest_s)

    def set_duty(self, text: str) -> None:
        """Set the duty cycle of a square wave, in %."""
        self.duty_percent = numeric(text, 0.01, 99.99, 50.0)

    def set_pulse_duty(self, text: str) -> None:
        """Set the width of the pulse as a part of the period, in %."""
        self.set_width(str(numeric(text, 0.01, 99.99, 10.0) / 100.0 * self.period_s))

    def pulse_duty(self) -> float:
        """Return the width of the pulse as a part of the period, in %."""
        return 100.0 * self.width_s / self.period_s

    def set_hold(self, text: str) -> None:
        """Say whether width or duty cycle stays when the period changes."""
        self.hold = choice(text, HOLDS)

    def set_filter(self, text: str) -> None:
        """Choose the filter of arbitrary waveforms; here none shows."""
        self.filter = choice(text, FILTERS)

    def set_rate(self, text: str) -> None:
        """Set the sample rate of arbitrary waveforms."""
        self.rate_per_s = numeric(text, *RATES_PER_S, 40e3)

    def choose(self, text: str) -> None:
        """Choose an arbitrary waveform by its name."""
        name = unquoted(text)
        if name not in self._memory:
            raise Refusal(NO_SUCH_ARB)
        self.arb = name

    def take(
        self, parameters: list[str], *, counts: bool = False, block: bytes | None = None
    ) -> None:
        """Take an arbitrary waveform: its name, then its points, or a `block` of them.

        A block holds DAC counts of 16 bits or single floats, the most significant byte first.
        """
        if len(parameters) < 2:
            raise ScpiError(-109)
        name = unquoted(parameters[0])
        if name in self._memory:
            raise Refusal(ARB_EXISTS)
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

    def _clipped(self, value: float, lowest: float, highest: float) -> float:
        if value < lowest:
            self._complain(OUT_OF_RANGE, LOWER)
        elif value > highest:
            self._complain(OUT_OF_RANGE, UPPER)
        return min(max(value, lowest), highest)


def unquoted(text: str) -> str:
    """Return a name, which may stand between quotes."""
    quoted = len(text) >= 2 and text[0] in "\"'" and text[-1] == text[0]
    return (text[1:-1] if quoted else text).upper()
