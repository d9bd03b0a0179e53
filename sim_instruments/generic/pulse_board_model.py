"""A laser-gyro pulse board without its line: commands, sample intervals, faults, lamps.

What a command comes to is a number that is the same on every line: 0 ok, 1 unknown command, 2 bad
interval, 3 bad channels, 4 already running, 5 bad length. Samples are computed some
way ahead, as if nothing would change, and again from the present one on when the world's version
says that something did; the noise of a sample stays the same.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import numpy as np
import numpy.typing as npt

from sim_instruments.faults.lasting import Dark, Frozen, LastingFault, Overheating, Silent
from sim_instruments.generic.outputs import Ahead, OutputModel
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError
from sim_instruments.world.laser_gyro import LaserGyroBench, PulseNoise

FIRST_AHEAD, MAX_AHEAD = 8, 1024
NO_SENSOR = -32768
FRAME = np.dtype([("sequence", "<u2"), ("counts", "<i4"), ("temperature", "<i2")])
"""As the board on CAN sends a sample; temperatures in 0.01 degC."""

Rows = npt.NDArray[np.void]


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


class PulseSampler(OpenInputs):
    """Counts and temperatures of one gyro, acquisition after acquisition."""

    def __init__(self, world: LaserGyroBench, rng: np.random.Generator) -> None:
        self._world = world
        self._rng = rng
        self._noise: PulseNoise | None = None
        super().__init__()
        self._ahead = Ahead(FIRST_AHEAD, MAX_AHEAD)
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
        super().begin(time_s, interval_s)
        self._angle_arcsec, self.overflowed = 0.0, False
        self._forget_ahead()

    def rows(self, count: int) -> Rows:
        """Return the next `count` samples, of FRAME."""
        if self._version != self._world.version:
            self._forget_ahead()
        if self._used + count > len(self._rows):
            self._compute_ahead(count)
        rows = self._rows[self._used : self._used + count]
        self._used += count
        self._samples += count
        self._angle_arcsec = float(self._angles[self._used - 1])
        return rows

    def _forget_ahead(self) -> None:
        self._rows: Rows = np.empty(0, dtype=FRAME)
        self._angles: npt.NDArray[np.float64] = np.empty(0)
        self._used = 0
        self._ahead.forget()
        self._version = self._world.version

    def _compute_ahead(self, at_least: int) -> None:
        assert self._noise is not None, "begin comes before rows"
        gyro, first = self._world.gyro, self._samples
        count = self._ahead.count(self.interval_s, at_least)
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


START, STOP, IDENTIFY, REPORT_STATUS = 1, 2, 3, 4
OK, UNKNOWN_COMMAND, BAD_INTERVAL, BAD_MASK, ALREADY_RUNNING, BAD_LENGTH = range(6)
REFUSED_BIT, OVERFLOW_BIT = 1, 2
CHANNELS = 3
VERSIONS = (1, 2, 1, CHANNELS)
"""Firmware major and minor, hardware, and how many channels there are."""
PROTOCOL_VERSION = 1
SHORTEST, LONGEST = 10, 100_000  # sample interval in units of 0.1 ms
LASTING_FAULTS = (Frozen.kind, Silent.kind, Dark.kind, Overheating.kind)


class PulseBoardModel(OutputModel):
    """The board, with the gyro of the simulated world on one of its channels where it has one.

    Its truth is that of `OutputModel`. `send` gets the numbers of samples (from 1) and what the
    gyro's channel counted in them, those that go out, with the world's lock held; it returns what
    sends them, without it. They go out in batches of `shortest_batch_s` or of one, `latency_s`
    after the last one's end.
    """

    def __init__(
        self,
        setting: Setting,
        send: Callable[[npt.NDArray[np.int64], Rows], Callable[[], None]],
        latency_s: float = 0.0,
        shortest_batch_s: float = 0.1,
    ) -> None:
        super().__init__(setting, latency_s)
        self._world, self._send, self._shortest_batch_s = setting.world, send, shortest_batch_s
        self.serial = setting.serial_number("the pulse board's")
        self._gyro_bench = self._world.find(LaserGyroBench)
        self.gyro_bit = 1 << (self._gyro_bench.gyro.channel - 1) if self._gyro_bench else 0
        if self.gyro_bit >= 1 << CHANNELS:
            raise SimulationError("simulation.gyro.channel: the pulse board has channels 1 to 3")
        self._sampler = (
            PulseSampler(self._gyro_bench, setting.rng) if self._gyro_bench else OpenInputs()
        )
        self.running, self._batch = False, 1
        self.mask = self.interval = self.samples = self.error_bits = 0
        self._faults.when_changed(Dark.kind, self._darken)
        self._faults.when_changed(Overheating.kind, self._overheat)
        self._last_shown = np.zeros(1, dtype=FRAME)

    @property
    def present(self) -> int:
        """Bits of the channels with a gyro."""
        return self.gyro_bit if self._gyro_bench and self._gyro_bench.mounted else 0

    @property
    def lit(self) -> int:
        """Bits of the channels with a gyro whose discharge burns."""
        return self.gyro_bit if self._gyro_bench and self._gyro_bench.gyro.heat.is_on else 0

    def begin_to_report(self, period_s: float, report: Callable[[], None]) -> None:
        """Report every so often by the board's clock, until it is closed, the lock held."""
        begin_s, periods = self._clock.now(), count(1)

        def due_s() -> float:
            return begin_s + next(periods) * period_s * self._stretch

        def report_again() -> float | None:
            if self._closed:
                return None
            with self._world.lock:
                report()
            return due_s()

        self._clock.repeat(f"{self._name} status", due_s(), report_again)

    def carry_out(self, command: int, mask: int, interval: int) -> int:
        """Do what a command asks for and return what it comes to."""
        if command == START:
            result = self._start(mask, interval)
        elif command == STOP:
            self.running = False
            result = OK
        else:
            result = OK if command in (IDENTIFY, REPORT_STATUS) else UNKNOWN_COMMAND
        return self.refuse(result) if result != OK else OK

    def refuse(self, result: int) -> int:
        """Take note that a command was refused; return why."""
        self.error_bits |= REFUSED_BIT
        return result

    def time_s(self, sample: int) -> float:
        """Return the run time at which a sample interval (from 1) ends."""
        return self._sampler.time_s(sample)

    def _start(self, mask: int, interval: int) -> int:
        if self.running:
            return ALREADY_RUNNING
        if not SHORTEST <= interval <= LONGEST:
            return BAD_INTERVAL
        if not 0 < mask < 1 << CHANNELS:
            return BAD_MASK
        self.mask, self.interval = mask, interval
        self.samples, self.error_bits = 0, 0
        self.running = True
        self._sampler.begin(self._clock.now(), interval * 1e-4 * self._stretch)
        samples = np.ceil(self._shortest_batch_s / self._sampler.interval_s - 1e-3)
        self._batch = max(1, int(samples))
        self._begin()
        return OK

    def _batch_s(self) -> float:
        return self.time_s(self.samples + self._batch) + self._latency_s

    def _next_s(self) -> float:
        """Return when the next batch is due; before it is, when to notice an end."""
        return min(self._batch_s(), self._clock.now() + 1.0)

    def _goes_on(self) -> bool:
        return self.running

    def _due(self) -> Callable[[], object] | None:
        if self._batch_s() > self._clock.now():
            return None
        self._faults.catch_up()
        return self._send(*self._taken(self._batch))

    def _taken(self, count: int) -> tuple[npt.NDArray[np.int64], Rows]:
        """Return the next samples as faults have them: frozen ones repeated, silent ones gone."""
        numbers = np.arange(self.samples + 1, self.samples + count + 1)
        self.samples += count
        rows = self._sampler.rows(count)
        if self._sampler.overflowed:
            self.error_bits |= OVERFLOW_BIT
        if not self._faults.all:
            self._last_shown = rows[-1:]
            return numbers, rows
        rows = rows.copy()
        times = np.array([self.time_s(n) for n in numbers.tolist()])
        for k in np.flatnonzero(self._faults.during(Frozen.kind, times)).tolist():
            last = rows[k - 1 : k] if k else self._last_shown
            for column in ("counts", "temperature"):
                rows[column][k] = last[column][0]
        self._last_shown = rows[-1:].copy()
        goes = ~self._faults.during(Silent.kind, times)
        return numbers[goes], rows[goes]

    def _darken(self, time_s: float, fault: LastingFault | None) -> None:
        if self._gyro_bench is not None:
            self._gyro_bench.darken_gyro(time_s, fault is not None)

    def _overheat(self, time_s: float, fault: LastingFault | None) -> None:
        if self._gyro_bench is not None:
            rise_K = fault.rise_K if isinstance(fault, Overheating) else 0.0
            self._gyro_bench.overheat_gyro(time_s, rise_K)
