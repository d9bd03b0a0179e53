"""A thermal chamber: the temperature of its air over all time, known in closed form, and of bodies.

The controller drives the air to its set-point, which may be on a ramp, as a first-order lag, as far
as heater and compressor can; then they take turns, and the air cycles a little. Every command
starts a plan that holds until the next, in pieces of c + a exp(-t/tau) + r t. What stands in the
chamber follows the air slowly, and is warmer while it is switched on.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.piecewise import LONG_AGO_S, Array, Rows

START, LEVEL, AMPLITUDE, TAU, SLOPE, CYCLES, EFFORT = range(7)
OFF, CONTROLS, STRUGGLES = 0.0, 1.0, 2.0
ROUNDING_S = 1e-6
REACHES_K = 0.5
"""How near its set-point a chamber stays although what should move it there is broken."""


def ignore_change(time_s: float) -> None:
    """Do nothing on a change from a time on."""


class Chamber:
    """A chamber whose air is at room temperature, its control off, until it is commanded otherwise.

    Every command takes the time from which it holds; a time before the last command's counts as
    that. `changed` is called with it after each command.

    Truth: `room`; `time_constant` under control; `heating` and `cooling`, its fastest ways;
    `lowest` and `highest`, as far as it can; `idle_time_constant` of the closed chamber that is
    off, `door_time_constant` of the open one; `cycling` with `amplitude` and `period`. Of an open
    door the air takes the room's temperature, whatever the control does. `overshoot`, where it is
    given: of a step of the set-point, the share by which a badly tuned control goes beyond it.
    """

    def __init__(self, truth: Truth, changed: Callable[[float], None] = ignore_change) -> None:
        self._changed = changed
        self.room_degC = truth.quantity("room", "degC")
        self._tau_s = truth.quantity("time_constant", "s")
        self._heating = truth.quantity("heating", "degC/min") / 60.0
        self._cooling = truth.quantity("cooling", "degC/min") / 60.0
        self._lowest_degC = truth.quantity("lowest", "degC")
        self._highest_degC = truth.quantity("highest", "degC")
        self._idle_tau_s = truth.quantity("idle_time_constant", "s")
        self._door_tau_s = truth.quantity("door_time_constant", "s")
        self._overshoot = truth.quantity("overshoot", "1", 0.0)
        cycling = truth.section("cycling")
        self.cycling_K = cycling.quantity("amplitude", "K")
        self.cycling_rad_per_s = 2.0 * np.pi / cycling.quantity("period", "s")
        self.taus_s = (self._tau_s, self._idle_tau_s, self._door_tau_s)
        if min(*self.taus_s, self._heating, self._cooling) <= 0.0:
            raise SimulationError(f"{truth.where}: time constants and rates must be positive")
        self._ends_degC = self.room_degC
        self._ramp = LONG_AGO_S, self.room_degC, 0.0
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
        struggle = np.sign(self._wanted(self._commanded_s) - air)
        share = np.where(row[..., EFFORT] == STRUGGLES, struggle, np.clip(share, -1.0, 1.0))
        return np.asarray(np.where(row[..., EFFORT] == OFF, 0.0, share))

    def set_point(self, time_s: float, degC: float) -> None:
        """Want another temperature of the air from a time on; without control nothing follows."""
        self._ends_degC = self._possible(degC)
        self._ramp = time_s, self._ends_degC, 0.0
        self._plan(time_s)

    def ramp(self, time_s: float, from_degC: float, to_degC: float, K_per_s: float) -> None:
        """Want the air to go from one temperature to another, from a time on and at a rate."""
        begin, self._ends_degC = self._possible(from_degC), self._possible(to_degC)
        self._ramp = time_s, begin, float(np.copysign(K_per_s, self._ends_degC - begin))
        self._plan(time_s)

    def control(self, time_s: float, on: bool) -> None:
        """Switch heater and compressor to the controller, or off."""
        self._on = on
        self._plan(time_s)

    @property
    def door_stands_open(self) -> bool:
        """Whether the door is open."""
        return self._open

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
        wanted = self._wanted(now_s)
        if self._on and not self._open and self._reaches(wanted, steady):
            if self._cycles_from_s is None:
                steady, self._cycles_from_s = steady + cycle, now_s
            step_K = self._ends_degC - (self._ramp[1] if self._ramp[2] else steady)
            if wanted != self._ends_degC:
                slope = self._ramp[2]
                end_s = now_s + (self._ends_degC - wanted) / slope
                now_s, steady = self._follow(now_s, steady, wanted, slope, end_s)
            if self._overshoot and abs(self._ends_degC - steady) > REACHES_K:
                now_s, steady = self._wind_up(now_s, steady, self._overshoot * step_K)
            self._follow(now_s, steady, self._ends_degC)
        else:
            # What was a cycle fades with the rest.
            self._cycles_from_s = None
            self._leave(now_s, steady + cycle, wanted)
        self._changed(self._commanded_s)

    def _possible(self, degC: float) -> float:
        return min(max(degC, self._lowest_degC), self._highest_degC)

    def _wanted(self, time_s: float) -> float:
        """Return the set-point at a time, by the last command."""
        begin_s, begin, slope = self._ramp
        way, gone = self._ends_degC - begin, slope * (time_s - begin_s)
        return self._ends_degC if abs(gone) >= abs(way) else begin + gone

    def _reaches(self, wanted: float, air: float) -> bool:
        """Return whether what works brings the air to its set-point and keeps it there."""
        gap = wanted - air
        moves = self._heats if gap > 0.0 else self._cools
        return self._holds(wanted) and (moves or abs(gap) < REACHES_K)

    def _holds(self, wanted: float) -> bool:
        return self._heats if wanted > self.room_degC else self._cools

    def _follow(
        self, now_s: float, air: float, wanted: float, slope: float = 0.0, end_s: float = np.inf
    ) -> tuple[float, float]:
        """Add what follows a set-point on its way until a time; return that, and the air then."""
        tau_s, most = self._tau_s, self._fastest(slope)
        while now_s < end_s:
            gap = wanted - air
            limit = self._fastest(gap or slope)
            wide_s, gains = gap / limit - tau_s, 1.0 - slope / limit
            if wide_s > (ROUNDING_S if gains > 0.0 else -ROUNDING_S):
                closes_s = wide_s / gains if gains > 0.0 else np.inf
                lasts_s = min(closes_s, end_s - now_s)
                self._add(now_s, air, slope=limit, effort=CONTROLS)
                wanted += slope * lasts_s
                air = wanted - limit * tau_s if lasts_s == closes_s else air + limit * lasts_s
            else:
                lasts_s, behind = end_s - now_s, slope * tau_s
                if slope / most > 1.0:  # sooner or later the chamber cannot keep up
                    lasts_s = min(lasts_s, -tau_s * np.log((slope - most) / (slope - gap / tau_s)))
                self._add(now_s, wanted - behind, behind - gap, tau_s, slope, effort=CONTROLS)
                wanted += slope * lasts_s if slope else 0.0
                air = wanted - behind + (behind - gap) * float(np.exp(-lasts_s / tau_s))
            now_s += lasts_s
        return now_s, air

    def _wind_up(self, now_s: float, air: float, beyond_K: float) -> tuple[float, float]:
        """Add full power until the air is beyond its set-point; return that time, and the air."""
        way = self._ends_degC + beyond_K - air
        limit = self._fastest(way)
        self._add(now_s, air, slope=limit, effort=CONTROLS)
        return now_s + way / limit, air + way

    def _fastest(self, way: float) -> float:
        """Return the fastest the chamber can go, up or down."""
        return self._heating if way > 0.0 else -self._cooling

    def _leave(self, now_s: float, air: float, wanted: float) -> None:
        """Let the air go to the room's temperature, to the set-point where that is between."""
        room, effort = self.room_degC, STRUGGLES if self._on else OFF
        tau_s = self._door_tau_s if self._open else self._idle_tau_s
        self._add(now_s, room, air - room, tau_s, effort=effort)
        left = (wanted - room) / (air - room) if air != room else 0.0
        if self._on and not self._open and self._holds(wanted) and 0.0 < left < 1.0:
            self._add(now_s - tau_s * np.log(left), wanted, effort=CONTROLS)

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
        # By piece of the air's temperature: see `_begin`.
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
        """Compute again what the air's temperature makes of the bodies after a time."""
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
        """Begin to follow the next piece of the air's temperature, from where the bodies are.

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
        """Return temperatures and rates that the pieces `k` of the air's temperature make."""
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
