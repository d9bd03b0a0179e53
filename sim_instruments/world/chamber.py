"""A thermal chamber: the temperature of its air over all time, known in closed form.

The controller drives the air to its set-point as a first-order lag, as far as heater and compressor
can; then they take turns, and the air cycles a little. Every command starts a plan that holds until
the next, in pieces of c + a exp(-t/tau) + r t.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.rows import Rows

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

LONG_AGO_S = -1e6
START, LEVEL, AMPLITUDE, TAU, SLOPE, CYCLES, EFFORT = range(7)
OFF, CONTROLS, STRUGGLES = 0.0, 1.0, 2.0
REACHES_K = 0.5
"""How near its set-point a chamber stays although what should move it there is broken."""


def tell_nobody(time_s: float) -> None:
    """Tell nobody that something changes from a time on."""


class Chamber:
    """A chamber whose air is at room temperature, its control off, until it is told otherwise.

    Every command takes the time from which it holds; a time before the last command's counts as
    that. `changed` is called with it after each command.

    Truth: `room`; `time_constant` under control; `heating` and `cooling`, its fastest ways;
    `lowest` and `highest`, as far as it can; `idle_time_constant` of the closed chamber that is
    off, `door_time_constant` of the open one; `cycling` with `amplitude` and `period`. Of an open
    door the air takes the room's temperature, whatever the control does.
    """

    def __init__(self, truth: Truth, changed: Callable[[float], None] = tell_nobody) -> None:
        self._changed = changed
        self.room_degC = truth.quantity("room", "degC")
        self._tau_s = truth.quantity("time_constant", "s")
        self._heating = truth.quantity("heating", "degC/min") / 60.0
        self._cooling = truth.quantity("cooling", "degC/min") / 60.0
        self._lowest_degC = truth.quantity("lowest", "degC")
        self._highest_degC = truth.quantity("highest", "degC")
        self._idle_tau_s = truth.quantity("idle_time_constant", "s")
        self._door_tau_s = truth.quantity("door_time_constant", "s")
        cycling = truth.section("cycling")
        self.cycling_K = cycling.quantity("amplitude", "K")
        self.cycling_rad_per_s = 2.0 * np.pi / cycling.quantity("period", "s")
        self.taus_s = (self._tau_s, self._idle_tau_s, self._door_tau_s)
        if min(*self.taus_s, self._heating, self._cooling) <= 0.0:
            raise SimulationError(f"{truth.where}: time constants and rates must be positive")
        self._wanted_degC = self.room_degC
        self._on = self._open = False
        self._heats = self._cools = True
        self._cycles_from_s: float | None = None
        self._commanded_s = LONG_AGO_S
        self.pieces = Rows(EFFORT + 1)
        self._add(LONG_AGO_S, self.room_degC)

    def air_degC(self, time_s: Array) -> Array:
        """Return the temperature of the air at each time, same shape."""
        times = np.asarray(time_s, dtype=np.float64)
        return np.asarray(self._steady(times) + self._cycle(times))

    def output(self, time_s: Array) -> Array:
        """Return how hard the chamber heats (up to 1) or cools (down to -1) at each time."""
        row = self.pieces.all[self.pieces.at(time_s)]
        since_s = np.asarray(time_s) - row[..., START]
        fading = np.exp(-since_s / row[..., TAU]) / row[..., TAU]
        rate = row[..., SLOPE] - row[..., AMPLITUDE] * fading
        air = self.air_degC(time_s)
        needed = rate + (air - self.room_degC) / self._idle_tau_s
        share = needed / np.where(needed > 0.0, self._heating, self._cooling)
        struggle = np.sign(self._wanted_degC - air)
        share = np.where(row[..., EFFORT] == STRUGGLES, struggle, np.clip(share, -1.0, 1.0))
        return np.asarray(np.where(row[..., EFFORT] == OFF, 0.0, share))

    def set_point(self, time_s: float, degC: float) -> None:
        """Want another temperature of the air from a time on; without control nothing follows."""
        self._wanted_degC = min(max(degC, self._lowest_degC), self._highest_degC)
        self._plan(time_s)

    def control(self, time_s: float, on: bool) -> None:
        """Switch heater and compressor to the controller, or off."""
        self._on = on
        self._plan(time_s)

    def door(self, time_s: float, is_open: bool) -> None:
        """Open or close the door."""
        self._open = is_open
        self._plan(time_s)

    def heater(self, time_s: float, works: bool) -> None:
        """Break the heater, or repair it."""
        self._heats = works
        self._plan(time_s)

    def compressor(self, time_s: float, works: bool) -> None:
        """Let the compressor trip, or bring it back."""
        self._cools = works
        self._plan(time_s)

    def _plan(self, time_s: float) -> None:
        """Replace what was planned from a time on."""
        self._commanded_s = now_s = max(time_s, self._commanded_s)
        at = np.array([now_s])
        steady, cycle = float(self._steady(at)[0]), float(self._cycle(at)[0])
        keep = np.searchsorted(self.pieces.all[:, START], now_s, side="left")
        self.pieces.cut(max(int(keep), 1))
        if self._on and not self._open and self._reaches(steady):
            if self._cycles_from_s is None:
                steady, self._cycles_from_s = steady + cycle, now_s
            self._follow(now_s, steady)
        else:
            # What was a cycle fades with the rest.
            self._cycles_from_s = None
            self._leave(now_s, steady + cycle)
        self._changed(now_s)

    def _reaches(self, air: float) -> bool:
        """Return whether what works brings the air to its set-point and keeps it there."""
        gap = self._wanted_degC - air
        moves = self._heats if gap > 0.0 else self._cools
        return self._holds() and (moves or abs(gap) < REACHES_K)

    def _holds(self) -> bool:
        return self._heats if self._wanted_degC > self.room_degC else self._cools

    def _follow(self, now_s: float, air: float) -> None:
        gap = self._wanted_degC - air
        limit = self._heating if gap > 0.0 else -self._cooling
        wide = abs(gap) - abs(limit) * self._tau_s
        if wide > 0.0:
            self._add(now_s, air, slope=limit, effort=CONTROLS)
            now_s, gap = now_s + wide / abs(limit), limit * self._tau_s
        self._add(now_s, self._wanted_degC, -gap, self._tau_s, effort=CONTROLS)

    def _leave(self, now_s: float, air: float) -> None:
        """Let the air go to the room's temperature, to the set-point where that is between."""
        room, effort = self.room_degC, STRUGGLES if self._on else OFF
        tau_s = self._door_tau_s if self._open else self._idle_tau_s
        self._add(now_s, room, air - room, tau_s, effort=effort)
        left = (self._wanted_degC - room) / (air - room) if air != room else 0.0
        if self._on and not self._open and self._holds() and 0.0 < left < 1.0:
            self._add(now_s - tau_s * np.log(left), self._wanted_degC, effort=CONTROLS)

    def _add(
        self,
        start_s: float,
        level: float,
        amplitude: float = 0.0,
        tau_s: float = np.inf,
        slope: float = 0.0,
        effort: float = OFF,
    ) -> None:
        since_s = np.inf if self._cycles_from_s is None else self._cycles_from_s
        self.pieces.add(start_s, level, amplitude, tau_s, slope, since_s, effort)

    def _steady(self, time_s: Array) -> Array:
        row = self.pieces.all[self.pieces.at(time_s)]
        since_s = time_s - row[..., START]
        fading = row[..., AMPLITUDE] * np.exp(-since_s / row[..., TAU])
        return np.asarray(row[..., LEVEL] + fading + row[..., SLOPE] * since_s)

    def _cycle(self, time_s: Array) -> Array:
        since_s = time_s - self.pieces.all[self.pieces.at(time_s), CYCLES]
        phase = self.cycling_rad_per_s * np.where(np.isfinite(since_s), since_s, 0.0)
        return np.asarray(self.cycling_K * np.sin(phase))
