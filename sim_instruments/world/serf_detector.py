"""The light detector: the probe beam's turn as a voltage, with what else is on the wire."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import Truth
from sim_instruments.world.serf_cell import axis_of

Array = npt.NDArray[np.float64]

CELL_S = 1e-5
BLOCK = 1024


class InstantNoise:
    """White noise that belongs to time itself: the same whoever looks, how often and when.

    One independent value in each 10 us, so that it is white up to 50 kHz.
    """

    def __init__(self, deviation: float, rng: np.random.Generator) -> None:
        self._deviation = deviation
        self._key = rng.integers(0, 2**63, size=2).astype(np.uint64)

    def at(self, time_s: Array) -> Array:
        """Return the noise at each time, same shape."""
        if self._deviation == 0.0 or time_s.size == 0:
            return np.zeros(time_s.shape)
        cells = np.floor(time_s / CELL_S).astype(np.int64)
        numbers, block = np.unique(cells // BLOCK, return_inverse=True)
        draws = np.stack([self._block(k) for k in numbers.tolist()])
        return np.asarray(self._deviation * draws[block.reshape(cells.shape), cells % BLOCK])

    def _block(self, number: int) -> Array:
        counter = np.array([0, 0, 0, number % 2**64], dtype=np.uint64)
        rng = np.random.Generator(np.random.Philox(key=self._key, counter=counter))
        return rng.standard_normal(BLOCK)


class Detector:
    """The probe light after the cell, and its amplifier.

    Truth (`simulation.serf.detector`): `probe` (`axis`, `lean`), the voltage of a fully polarised
    vapour along the probe, `full_polarisation`, the amplifier's `offset` and `noise` (standard
    deviation of a sample), and `mains`: `frequency`, `amplitude`, `phase` of the pick-up.
    """

    def __init__(self, truth: Truth, rng: np.random.Generator) -> None:
        self.probe_axis = axis_of(truth.section("probe"))
        self.full_V = truth.quantity("full_polarisation", "V")
        self._offset_V = truth.quantity("offset", "V")
        mains = truth.section("mains")
        self._mains_V = mains.quantity("amplitude", "V")
        self._mains_rad_per_s = 2.0 * np.pi * mains.quantity("frequency", "Hz")
        self._mains_rad = mains.quantity("phase", "rad")
        self._noise = InstantNoise(truth.quantity("noise", "V"), rng)

    def voltage_V(self, time_s: Array, polarisation: Array, powered: Array) -> Array:
        """Return the voltage at each time; `polarisation` (n, 3), `powered` 0 or 1, (n,).

        Switched off, the amplifier gives noise alone.
        """
        signal = self.full_V * (polarisation @ self.probe_axis)
        mains = self._mains_V * np.sin(self._mains_rad_per_s * time_s + self._mains_rad)
        return np.asarray(powered * (self._offset_V + signal + mains) + self._noise.at(time_s))
