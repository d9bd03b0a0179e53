"""The board's counters: pulses of the gyro at the ends of equal intervals.

Samples are computed some way ahead, as if nothing would change, and again from the present one on
when the world's version says that something did; the noise of a sample stays the same.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sim_instruments.world.laser_gyro import LaserGyroBench, PulseNoise

FIRST_AHEAD, MOST_AHEAD = 8, 1024
LONGEST_AHEAD_S = 60.0
NO_SENSOR = -32768
FRAME = np.dtype([("sequence", "<u2"), ("counts", "<i4"), ("temperature", "<i2")])
"""As the board on CAN sends a sample; temperatures in 0.01 degC."""

Rows = npt.NDArray[np.void]


class PulseSampler:
    """Counts and temperatures of one gyro, acquisition after acquisition."""

    def __init__(self, world: LaserGyroBench, rng: np.random.Generator) -> None:
        self._world = world
        self._rng = rng
        self._noise: PulseNoise | None = None
        self._begin_s = 0.0
        self._samples = 0
        self.interval_s = 0.0
        self.overflowed = False
        self._forget_ahead()

    def begin(self, time_s: float, interval_s: float) -> None:
        """Start an acquisition: counters and sequence at zero."""
        rate = 0.0
        if self._noise is not None:
            end_s = self.time_s(self._samples)
            hours = max(time_s - end_s, 0.0) / 3600.0
            step = self._world.gyro.walk_deg_per_h * np.sqrt(hours)
            # Between acquisitions the gyro's rate walks on unseen.
            rate = self._noise.rate_deg_per_h(self._samples)
            rate += float(step * self._rng.standard_normal())
        self._noise = PulseNoise(self._world.gyro, self._rng, interval_s, rate)
        self._begin_s, self.interval_s = time_s, interval_s
        self._samples, self._angle_arcsec = 0, 0.0
        self.overflowed = False
        self._forget_ahead()

    def time_s(self, sample: int) -> float:
        """Return the run time at which interval `sample` (from 1) ends."""
        return self._begin_s + sample * self.interval_s

    def rows(self, count: int) -> Rows:
        """Return the next `count` samples, of FRAME."""
        if self._version != self._world.version:
            self._forget_ahead()
        if self._used + count > len(self._rows):
            self._compute_ahead(count)
        found = self._rows[self._used : self._used + count]
        self._used += count
        self._samples += count
        self._angle_arcsec = float(self._angles[self._used - 1])
        return found

    def _forget_ahead(self) -> None:
        self._rows: Rows = np.empty(0, dtype=FRAME)
        self._angles: npt.NDArray[np.float64] = np.empty(0)
        self._used = 0
        self._ahead = FIRST_AHEAD
        self._version = self._world.version

    def _compute_ahead(self, at_least: int) -> None:
        assert self._noise is not None, "begin comes before rows"
        gyro, first = self._world.gyro, self._samples
        count = max(at_least, min(self._ahead, int(LONGEST_AHEAD_S / self.interval_s)))
        self._ahead = min(2 * self._ahead, MOST_AHEAD)
        edges_s = np.arange(first, first + count + 1, dtype=np.float64) * self.interval_s
        edges_s += self._begin_s
        on = np.diff(gyro.heat.on_time(edges_s)) / self.interval_s
        steps = self._world.gyro_angle_arcsec(edges_s)
        steps = steps + on * self._noise.angle_steps_arcsec(first, count)
        self._angles = self._angle_arcsec + np.cumsum(steps)
        dither = np.where(on > 0.5, self._noise.dither_arcsec(first, count), 0.0)
        pulses = np.floor((self._angles + dither) / gyro.pulse_arcsec + self._noise.phase)
        counts = pulses.astype(np.int64)
        self.overflowed = self.overflowed or bool((np.abs(counts) >= 2**31).any())
        frames = np.empty(count, dtype=FRAME)
        frames["sequence"] = np.arange(first + 1, first + count + 1) & 0xFFFF
        frames["counts"] = counts.astype(np.int32)
        warm = gyro.temperature_degC(edges_s[1:])
        frames["temperature"] = np.clip(np.round(warm * 100.0), -32767, 32767).astype(np.int16)
        self._rows = frames
        self._used = 0


class OpenInputs:
    """A board to which no gyro is connected: samples are numbered, and nothing is counted."""

    overflowed = False

    def __init__(self) -> None:
        self._begin_s = 0.0
        self._samples = 0
        self.interval_s = 0.0

    def begin(self, time_s: float, interval_s: float) -> None:
        """Start an acquisition: counters and sequence at zero."""
        self._begin_s, self.interval_s, self._samples = time_s, interval_s, 0

    def time_s(self, sample: int) -> float:
        """Return the run time at which interval `sample` (from 1) ends."""
        return self._begin_s + sample * self.interval_s

    def rows(self, count: int) -> Rows:
        """Return the next `count` samples, of FRAME."""
        frames = np.zeros(count, dtype=FRAME)
        frames["sequence"] = np.arange(self._samples + 1, self._samples + count + 1) & 0xFFFF
        frames["temperature"] = NO_SENSOR
        self._samples += count
        return frames
