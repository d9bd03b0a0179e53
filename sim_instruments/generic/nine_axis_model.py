"""The electronics of a nine-axis sensor: what it outputs and when, whichever line carries it.

Outputs are computed some way ahead as if nothing would change, and again from the present one on
when the world's version says that something did.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from sim_instruments.faults.lasting import Frozen, GyroFails, Overheating, Overload, Silent
from sim_instruments.generic.outputs import Ahead, OutputModel
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError
from sim_instruments.world.nine_axis_sensor import Means
from sim_instruments.world.piecewise import Array

FIRST_AHEAD, MAX_AHEAD = 16, 1024
SHORTEST_BATCH_S = 0.1
ROOM_DEGC = 22.0
PROBED_S = 1e-3
LASTING_FAULTS = (Frozen.kind, Silent.kind, Overload.kind, GyroFails.kind, Overheating.kind)

Counters = npt.NDArray[np.int64]


@runtime_checkable
class SensorWorld(Protocol):
    """What a world with a nine-axis sensor in it offers beside what every world does."""

    @property
    def version(self) -> int:
        """A number that rises with every change of what the future holds."""

    @property
    def dut_powered(self) -> bool:
        """Whether the sensor is switched on now."""

    @property
    def range_deg_per_s(self) -> float:
        """The rate at which a gyro saturates."""

    def nine_axis_means(self, edges_s: Array) -> Means:
        """Return what the sensor measures between neighbouring times."""


class Shelf:
    """A world of another procedure: the sensor lies there, on, and measures nothing."""

    version = 0
    dut_powered = True
    range_deg_per_s = 1000.0

    def nine_axis_means(self, edges_s: Array) -> Means:
        """Return zeros that are not valid, at room temperature."""
        count = edges_s.size - 1
        nothing = np.zeros((count, 3))
        return Means(
            nothing,
            np.zeros((count, 3), dtype=np.bool_),
            nothing,
            nothing,
            np.full(count, ROOM_DEGC),
        )


class NineAxisModel(OutputModel):
    """A sensor that gives its outputs to `send` when they are due, in batches of at least 0.1 s.

    `encode` makes frames of what is measured: it is given counters from 1 and the means. Truth
    (`simulator` mapping): `latency` between an output and its first byte; `clock_error`, by how
    much the sensor's intervals are too long.
    """

    def __init__(
        self,
        setting: Setting,
        encode: Callable[[Counters, Means], Sequence[Any]],
        send: Callable[[Sequence[Any]], None],
    ) -> None:
        truth = setting.truth
        super().__init__(setting, truth.quantity("latency", "s"))
        if self._latency_s < 0:
            raise SimulationError(f"{truth.where}.latency: must not be negative")
        self._world: SensorWorld = setting.world.find(SensorWorld) or Shelf()
        self._encode, self._send = encode, send
        self._ahead = Ahead(FIRST_AHEAD, MAX_AHEAD)
        self.rate_Hz = 0.0
        """Outputs per second now, by the sensor's clock; 0 while nothing is output."""
        self.counter = 0
        self._begin_s = self._interval_s = 0.0
        self._last: Means | None = None
        self._rows: Means
        self._forget_ahead()

    @property
    def powered(self) -> bool:
        """Whether the sensor is switched on."""
        on = self._world.dut_powered
        if not on:
            self.rate_Hz = 0.0
        return on

    @property
    def gyro_failed(self) -> bool:
        """Whether the gyro x has failed its own test."""
        self._faults.catch_up()
        return self._faults.now(GyroFails.kind) is not None

    def temperature_degC(self) -> float:
        """Return how warm the sensor is now."""
        now_s = self._clock.now()
        edges_s = np.array([now_s, now_s + PROBED_S])
        return float(self._world.nine_axis_means(edges_s).temperature_degC[0])

    def start(self, rate_Hz: float) -> None:
        """Begin to output, the counter from 1."""
        self.rate_Hz, self.counter = rate_Hz, 0
        self._begin_s, self._interval_s = self._clock.now(), self._stretch / rate_Hz
        self._forget_ahead()
        self._batch = max(1, int(np.ceil(SHORTEST_BATCH_S / self._interval_s - 1e-3)))
        self._begin()

    def stop(self) -> None:
        """End the output."""
        self.rate_Hz = 0.0

    def _next_s(self) -> float:
        return self._begin_s + (self.counter + self._batch) * self._interval_s + self._latency_s

    def _goes_on(self) -> bool:
        return self.powered and self.rate_Hz > 0

    def _due(self) -> Callable[[], object]:
        return partial(self._send, self._next(self._batch))

    def _next(self, batch: int) -> Sequence[Any]:
        """Return the frames of the next outputs, without those that a fault keeps back."""
        self._faults.catch_up()
        if self._version != self._world.version:
            self._forget_ahead()
        if self._used + batch > len(self._frames):
            self._compute_ahead(batch)
        here = slice(self._used, self._used + batch)
        frames = self._frames[here]
        rows = self._rows.rows(here)
        counters = np.arange(self.counter + 1, self.counter + batch + 1)
        self._used += batch
        self.counter += batch
        if self._faults.all and any(self._faults.now(kind) is not None for kind in LASTING_FAULTS):
            frames = self._encode(counters, self._with_faults(rows))
            times_s = np.asarray(self._begin_s + counters * self._interval_s, dtype=np.float64)
            silent = self._faults.during(Silent.kind, times_s)
            return [frame for frame, kept in zip(frames, silent, strict=True) if not kept]
        self._last = rows.rows(slice(-1, None))
        return frames

    def _with_faults(self, rows: Means) -> Means:
        if self._faults.now(Frozen.kind) is not None:
            self._last = self._last or rows.rows(slice(1))
            rows = self._last.rows(np.zeros(len(rows.temperature_degC), dtype=np.int64))
        gyro, valid = rows.gyro_deg_per_s.copy(), rows.valid.copy()
        if self._faults.now(Overload.kind) is not None:
            gyro[:, 0], valid[:, 0] = self._world.range_deg_per_s, False
        if self._faults.now(GyroFails.kind) is not None:
            gyro[:, 0], valid[:, 0] = 0.0, False
        warmer = self._faults.now(Overheating.kind)
        rise_K = warmer.rise_K if isinstance(warmer, Overheating) else 0.0
        return rows._replace(
            gyro_deg_per_s=gyro, valid=valid, temperature_degC=rows.temperature_degC + rise_K
        )

    def _forget_ahead(self) -> None:
        self._frames: Sequence[Any] = []
        self._used = 0
        self._ahead.forget()
        self._version = self._world.version

    def _compute_ahead(self, at_least: int) -> None:
        count = self._ahead.count(self._interval_s, at_least)
        counters = np.arange(self.counter, self.counter + count + 1)
        self._rows = self._world.nine_axis_means(
            np.asarray(self._begin_s + self._interval_s * counters)
        )
        self._frames = self._encode(counters[1:], self._rows)
        self._used = 0
