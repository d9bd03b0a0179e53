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
        # By piece of the air's course: its beginning, what is left there of all before, and how
        # much of its fading part is felt.
        self._pieces = Rows(1 + 2 * tau_s.size)
        self._left = slice(1, 1 + tau_s.size)
        self._felt = slice(1 + tau_s.size, None)
        self._begin(np.full(tau_s.size, chamber.room_degC))
        self._switched = Rows(2 + tau_s.size)
        self._switched.add(LONG_AGO_S, 0.0, *[0.0] * tau_s.size)

    def switch(self, time_s: float, on: bool) -> None:
        """Switch the bodies on or off from a time on, which no earlier switch comes after."""
        warmth, _ = self._own(np.array([time_s]))
        self._switched.add(time_s, float(on), *warmth[0])

    def forget_after(self, time_s: float) -> None:
        """Compute again what the air's course makes of the bodies after a time."""
        kept = int(np.searchsorted(self._pieces.all[:, 0], time_s, side="left"))
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
        """Begin to follow the next piece of the air's course, from where the bodies are."""
        row = self._chamber.pieces.all[self._pieces.count]
        # A fading that a body follows slowly is felt little, and less than nothing later.
        felt = row[AMPLITUDE] / (1.0 - self._tau_s / row[TAU])
        self._pieces.add(row[START], *np.zeros(self._tau_s.size), *felt)
        part, _ = self._response(row[START : START + 1], np.array([self._pieces.count - 1]))
        self._pieces.cut(self._pieces.count - 1)
        self._pieces.add(row[START], *(temperature_degC - part[0]), *felt)

    def _follow(self, time_s: Array, k: npt.NDArray[np.int64]) -> tuple[Array, Array]:
        """Return temperatures and rates that the pieces `k` of the air's course make."""
        own = self._pieces.all[k]
        part, part_rate = self._response(time_s, k)
        left = own[:, self._left] * np.exp(-(time_s - own[:, 0])[:, None] / self._tau_s)
        return part + left, part_rate - left / self._tau_s

    def _response(self, time_s: Array, k: npt.NDArray[np.int64]) -> tuple[Array, Array]:
        """Return the lasting response to the pieces, without what is left from before."""
        row = self._chamber.pieces.all[k]
        tau_s, turning = self._tau_s, self._chamber.cycling_rad_per_s
        since_s = time_s - row[:, START]
        fading = np.exp(-since_s / row[:, TAU])[:, None] * self._pieces.all[k, self._felt]
        slope = row[:, SLOPE]
        steady = (row[:, LEVEL] + slope * since_s)[:, None] - slope[:, None] * tau_s
        cycles = np.isfinite(row[:, CYCLES])
        phase = turning * np.where(cycles, time_s - row[:, CYCLES], 0.0)
        late = turning * tau_s
        size = np.where(cycles, self._chamber.cycling_K, 0.0)[:, None] / (1.0 + late**2)
        sine, cosine = np.sin(phase)[:, None], np.cos(phase)[:, None]
        cycle, cycle_rate = sine - late * cosine, turning * (cosine + late * sine)
        return (
            steady + fading + size * cycle,
            slope[:, None] - fading / row[:, TAU, None] + size * cycle_rate,
        )

    def _own(self, time_s: Array) -> tuple[Array, Array]:
        """Return how much the bodies are warmed by themselves, and how fast that grows."""
        row = self._switched.all[self._switched.at(time_s)]
        final = row[:, 1:2] * self._rise_K
        left = (row[:, 2:] - final) * np.exp(-(time_s[:, None] - row[:, :1]) / self._tau_s)
        return final + left, -left / self._tau_s
