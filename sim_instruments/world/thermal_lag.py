"""What stands in a chamber and follows its air: slowly, and warmer while it is switched on."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import SimulationError
from sim_instruments.world.chamber import (
    AMPLITUDE,
    CYCLES,
    LEVEL,
    LONG_AGO_S,
    SLOPE,
    START,
    TAU,
    Chamber,
)
from sim_instruments.world.rows import Rows

Array = npt.NDArray[np.float64]


class ThermalLag:
    """Bodies in the air of a chamber, each a first-order lag of its own, exact at any time.

    `tau_s` and `rise_K`, what each body is warmer in the end while it is switched on: shape
    (bodies,). At first they are as warm as the room, and off.
    """

    def __init__(self, chamber: Chamber, tau_s: Array, rise_K: Array) -> None:
        self._chamber, self._tau_s, self._rise_K = chamber, tau_s, rise_K
        if tau_s.min() <= 0.0 or np.isclose(tau_s[:, None], chamber.taus_s, rtol=1e-3).any():
            raise SimulationError(
                "the time constant of a body in a chamber must be positive, and not one of the "
                "chamber's own"
            )
        # The air's cycling, as each body feels it: what of its sine, and of its cosine.
        self._turning = chamber.cycling_rad_per_s
        late = self._turning * tau_s
        self._sine = chamber.cycling_K / (1.0 + late**2)
        self._cosine = -late * self._sine
        # By piece of the air's course: see `_begin`.
        self._pieces = Rows(6 + 2 * tau_s.size)
        self._felt = slice(6, 6 + tau_s.size)
        self._left = slice(6 + tau_s.size, None)
        self._begin(np.full(tau_s.size, chamber.room_degC))
        self._switched = Rows(2 + tau_s.size)
        self._switched.add(LONG_AGO_S, 0.0, *[0.0] * tau_s.size)

    def switch(self, time_s: float, on: bool) -> None:
        """Switch the bodies on or off from a time on, which no earlier switch comes after."""
        warmth, _ = self._own(np.array([time_s]))
        self._switched.add(time_s, float(on), *warmth[0])

    def forget_after(self, time_s: float) -> None:
        """Compute again what the air's course makes of the bodies after a time."""
        kept = int(np.searchsorted(self._pieces.first, time_s, side="left"))
        self._pieces.cut(max(kept, 1))

    def temperature_and_rate(self, time_s: Array) -> tuple[Array, Array]:
        """Return the temperatures in degC and their rates in degC/s, both (times, bodies)."""
        air = self._chamber.pieces
        while self._pieces.count < air.count:
            here = self._pieces.count - 1
            ends, _ = self._follow(air.all[here + 1 : here + 2, START], np.array([here]))
            self._begin(ends[0])
        followed, rate = self._follow(time_s, air.at(time_s))
        own, own_rate = self._own(time_s)
        return followed + own, rate + own_rate

    def _begin(self, temperature_degC: Array) -> None:
        """Begin to follow the next piece of the air's course, from where the bodies are.

        A row holds the piece's start, level, slope and time constant, whether it cycles and since
        when, how much of its fading part each body feels, and what is left in each of all before.
        """
        air = self._chamber.pieces.all[self._pieces.count]
        cycles = bool(np.isfinite(air[CYCLES]))
        since_s = air[CYCLES] if cycles else 0.0
        felt = air[AMPLITUDE] / (1.0 - self._tau_s / air[TAU])
        row = [*air[[START, LEVEL, SLOPE, TAU]], float(cycles), since_s, *felt]
        at = np.array([self._pieces.count])
        self._pieces.add(*row, *np.zeros(self._tau_s.size))
        lasting, _ = self._follow(air[START : START + 1], at)
        self._pieces.cut(int(at[0]))
        self._pieces.add(*row, *(temperature_degC - lasting[0]))

    def _follow(self, time_s: Array, k: npt.NDArray[np.int64]) -> tuple[Array, Array]:
        """Return temperatures and rates that the pieces `k` of the air's course make."""
        row = self._pieces.all[k]
        since_s = time_s - row[:, 0]
        left = row[:, self._left] * np.exp(since_s[:, None] / -self._tau_s)
        fading = row[:, self._felt] * np.exp(since_s / -row[:, 3])[:, None]
        slope = row[:, 2:3]
        steady = (row[:, 1] + row[:, 2] * since_s)[:, None] - slope * self._tau_s
        phase = self._turning * (time_s - row[:, 5])
        sine, cosine = row[:, 4] * np.sin(phase), row[:, 4] * np.cos(phase)
        cycle = sine[:, None] * self._sine + cosine[:, None] * self._cosine
        turned = cosine[:, None] * self._sine - sine[:, None] * self._cosine
        rate = slope - fading / row[:, 3:4] - left / self._tau_s + self._turning * turned
        return steady + fading + left + cycle, rate

    def _own(self, time_s: Array) -> tuple[Array, Array]:
        """Return how much the bodies are warmed by themselves, and how fast that grows."""
        row = self._switched.all[self._switched.at(time_s)]
        final = row[:, 1:2] * self._rise_K
        left = (row[:, 2:] - final) * np.exp(-(time_s[:, None] - row[:, :1]) / self._tau_s)
        return final + left, -left / self._tau_s
