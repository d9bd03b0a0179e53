"""The current through one coil over all time, known exactly and evaluated when somebody looks.

The supply drives the coil with a level u(t) that is constant in pieces; the coil answers with its
time constant tau = L/R: tau i' = u - i. The voltage at its terminals is then R i + L i' = R u at
every moment, so a voltage limit acts as a limit of u. From the same equation follows the charge
without any numerical integration: the integral of i is the integral of u less tau times the
change of i.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from sim_instruments.world.piecewise import LONG_AGO_S, Array


class Hold:
    """One level from `start_s` on."""

    def __init__(self, start_s: float, current_A: float, level_A: float, tau_s: float) -> None:
        self.start_s = start_s
        self.end_s = np.inf
        self._level = level_A
        self._distance = current_A - level_A
        self._tau = tau_s

    def level(self, time_s: Array) -> Array:
        """Return the supply's level in A."""
        return np.full(time_s.shape, self._level)

    def current(self, time_s: Array) -> Array:
        """Return the coil's current in A."""
        if self._distance == 0.0:
            return np.full(time_s.shape, self._level)
        decay = np.exp(-np.maximum(time_s - self.start_s, 0.0) / self._tau)
        return np.asarray(self._level + self._distance * decay)

    def level_integral(self, time_s: Array) -> Array:
        """Return the integral of the level from the start, in A s."""
        return self._level * (time_s - self.start_s)

    def breakpoints(self, first_s: float, last_s: float) -> Array:
        """Return where the level changes between two times: nowhere but at the start."""
        return np.array([self.start_s]) if first_s < self.start_s < last_s else np.empty(0)

    def settled(self, time_s: float) -> float | None:
        """Return the current when it no longer moves, else None."""
        return self._level if time_s - self.start_s > 60.0 * self._tau else None


class Staircase:
    """A list of levels, each held for its dwell, walked through `cycles` times (0: for ever)."""

    def __init__(
        self,
        start_s: float,
        current_A: float,
        levels_A: Array,
        dwells_s: Array,
        cycles: int,
        tau_s: float,
    ) -> None:
        self.start_s = start_s
        self._levels = levels_A
        self._tau = tau_s
        self._edges = np.concatenate(([0.0], np.cumsum(dwells_s)))
        self._period = float(self._edges[-1])
        self._charges = np.concatenate(([0.0], np.cumsum(levels_A * dwells_s)))
        self.end_s = start_s + cycles * self._period if cycles else np.inf
        self._from_rest = self._response_from_rest(levels_A, np.exp(-dwells_s / tau_s))
        # A cycle maps its first current i to (decay i + gain): over many cycles a geometric series.
        self._cycle_decay = float(np.exp(-self._period / tau_s))
        gain = float(self._from_rest[-1])
        self._steady = gain / (1.0 - self._cycle_decay)
        self._first = current_A
        # The same numbers for one moment at a time, which arrays make slow.
        self._steps = [array.tolist() for array in (self._edges, self._charges, self._from_rest)]

    @staticmethod
    def _response_from_rest(levels_A: Array, decays: Array) -> Array:
        response = np.empty(levels_A.size + 1)
        current = 0.0
        response[0] = current
        for k, (level, decay) in enumerate(zip(levels_A.tolist(), decays.tolist(), strict=True)):
            current = level + (current - level) * decay
            response[k + 1] = current
        return response

    def _locate(self, time_s: Array) -> tuple[Array, npt.NDArray[np.int64], Array]:
        local = np.maximum(time_s - self.start_s, 0.0)
        cycle = np.floor(local / self._period)
        within = np.clip(local - cycle * self._period, 0.0, self._period)
        step = np.searchsorted(self._edges, within, side="right") - 1
        return cycle, np.clip(step, 0, self._levels.size - 1), within

    def level(self, time_s: Array) -> Array:
        """Return the supply's level in A."""
        _, step, _ = self._locate(time_s)
        return self._levels[step]

    def current(self, time_s: Array) -> Array:
        """Return the coil's current in A."""
        cycle, step, within = self._locate(time_s)
        first = self._steady + (self._first - self._steady) * self._cycle_decay**cycle
        at_step = self._from_rest[step] + first * np.exp(-self._edges[step] / self._tau)
        level = self._levels[step]
        return np.asarray(
            level + (at_step - level) * np.exp(-(within - self._edges[step]) / self._tau)
        )

    def level_integral(self, time_s: Array) -> Array:
        """Return the integral of the level from the start, in A s."""
        cycle, step, within = self._locate(time_s)
        in_cycle = self._charges[step] + self._levels[step] * (within - self._edges[step])
        return np.asarray(cycle * self._charges[-1] + in_cycle)

    def breakpoints(self, first_s: float, last_s: float) -> Array:
        """Return the times between two times at which the level changes, in s."""
        begin, end = max(first_s, self.start_s), min(last_s, self.end_s)
        if end <= begin:
            return np.empty(0)
        cycles = np.arange(
            np.floor((begin - self.start_s) / self._period),
            np.floor((end - self.start_s) / self._period) + 1.0,
        )
        times = (self.start_s + cycles[:, None] * self._period + self._edges[None, :-1]).ravel()
        return times[(times > first_s) & (times < last_s)]

    def settled(self, time_s: float) -> float | None:
        """Return None: a staircase never comes to rest."""
        return None

    def at(self, time_s: float) -> tuple[float, float]:
        """Return current in A and integral of the level from the start in A s, at one moment."""
        edges, charges, from_rest = self._steps
        local = max(time_s - self.start_s, 0.0)
        cycle = math.floor(local / self._period)
        within = min(max(local - cycle * self._period, 0.0), self._period)
        step = min(bisect_right(edges, within), len(edges) - 1) - 1
        first = self._steady + (self._first - self._steady) * self._cycle_decay**cycle
        at_step = from_rest[step] + first * math.exp(-edges[step] / self._tau)
        level, inside = float(self._levels[step]), within - edges[step]
        current = level + (at_step - level) * math.exp(-inside / self._tau)
        return current, cycle * charges[-1] + charges[step] + level * inside


class CurrentHistory:
    """What one supply has done, does, and will do if nobody intervenes.

    `changed_s` is when the supply last intervened: what lies before it stays as it is.
    """

    def __init__(
        self, resistance_ohm: float, inductance_H: float, changed: Callable[[], None]
    ) -> None:
        self.resistance_ohm = resistance_ohm
        self.tau_s = inductance_H / resistance_ohm
        self._changed = changed
        self.changed_s = LONG_AGO_S
        self._pieces: list[Hold | Staircase] = [Hold(LONG_AGO_S, 0.0, 0.0, self.tau_s)]
        self._starts = [LONG_AGO_S]
        # Integral of the level up to the start of each piece.
        self._level_integrals = [0.0]

    def hold(self, time_s: float, level_A: float) -> None:
        """Hold `level_A` from `time_s` on, whatever was planned after it."""
        self._cut(time_s)
        self._append(Hold(time_s, self._current_now(time_s), level_A, self.tau_s))
        self._changed()

    def run(
        self, time_s: float, passes: Sequence[tuple[Array, Array, int]], then_A: float
    ) -> float:
        """Walk through lists of (levels in A, dwells in s, cycles), then hold `then_A`.

        Returns the time at which the last list ends (infinite when it has no end), in s.
        """
        self._cut(time_s)
        start = time_s
        for levels, dwells, cycles in passes:
            current = self._current_now(start)
            piece = Staircase(start, current, levels, dwells, cycles, self.tau_s)
            self._append(piece)
            start = piece.end_s
        if np.isfinite(start):
            self._append(Hold(start, self._current_now(start), then_A, self.tau_s))
        self._changed()
        return start

    def pulse(self, time_s: float, level_A: float, until_s: float, then_A: float) -> None:
        """Hold `level_A` until `until_s`, then `then_A`."""
        self.hold(time_s, level_A)
        self._append(Hold(until_s, self._current_now(until_s), then_A, self.tau_s))

    def level(self, time_s: Array) -> Array:
        """Return the supply's level at each time, in A."""
        return self._by_piece(time_s, lambda piece, k, at: piece.level(at))

    def current(self, time_s: Array) -> Array:
        """Return the coil's current at each time, in A."""
        return self._by_piece(time_s, lambda piece, k, at: piece.current(at))

    def level_integral(self, time_s: Array) -> Array:
        """Return the integral of the level since long ago, in A s."""
        return self._by_piece(
            time_s, lambda piece, k, at: self._level_integrals[k] + piece.level_integral(at)
        )

    def mean_current(self, edges_s: Array) -> Array:
        """Return the exact mean current between each two neighbouring times, in A."""
        charge = self.level_integral(edges_s) - self.tau_s * self.current(edges_s)
        return np.diff(charge) / np.diff(edges_s)

    def mean_level(self, first_s: float, last_s: float) -> float:
        """Return the mean level between two times, in A; times R it is the terminal voltage."""
        piece = self._pieces[-1]
        if isinstance(piece, Staircase) and piece.start_s <= first_s:
            return (piece.at(last_s)[1] - piece.at(first_s)[1]) / (last_s - first_s)
        integral = self.level_integral(np.array([first_s, last_s]))
        return float(integral[1] - integral[0]) / (last_s - first_s)

    def recent_mean(self, first_s: float, last_s: float) -> float:
        """Return the mean current between two times, in A, without arithmetic when at rest."""
        settled = self._pieces[-1].settled(first_s)
        if settled is not None:
            return settled
        piece = self._pieces[-1]
        if isinstance(piece, Staircase) and piece.start_s <= first_s:
            (first_A, first_As), (last_A, last_As) = piece.at(first_s), piece.at(last_s)
            return (last_As - first_As - self.tau_s * (last_A - first_A)) / (last_s - first_s)
        return float(self.mean_current(np.array([first_s, last_s]))[0])

    def breakpoints(self, first_s: float, last_s: float) -> Array:
        """Return the times between two times at which the level changes, in s."""
        first = max(bisect_right(self._starts, first_s) - 1, 0)
        last = bisect_right(self._starts, last_s)
        inner = [piece.breakpoints(first_s, last_s) for piece in self._pieces[first:last]]
        starts = np.array(self._starts[first:last])
        inside = starts[(starts > first_s) & (starts < last_s)]
        return np.concatenate([inside, *inner])

    def _append(self, piece: Hold | Staircase) -> None:
        last = self._pieces[-1]
        gained = float(last.level_integral(np.array([piece.start_s]))[0])
        self._level_integrals.append(self._level_integrals[-1] + gained)
        self._pieces.append(piece)
        self._starts.append(piece.start_s)

    def _cut(self, time_s: float) -> None:
        self.changed_s = time_s
        while len(self._pieces) > 1 and self._pieces[-1].start_s >= time_s:
            # A piece that begins at this very time has had no effect yet.
            self._pieces.pop()
            self._starts.pop()
            self._level_integrals.pop()

    def _current_now(self, time_s: float) -> float:
        return float(self._pieces[-1].current(np.array([time_s]))[0])

    def _by_piece(
        self, time_s: Array, of: Callable[[Hold | Staircase, int, Array], Array]
    ) -> Array:
        # A campaign makes tens of thousands of pieces, and mostly the last one is asked for.
        first = max(bisect_right(self._starts, time_s.min()) - 1, 0)
        last = max(bisect_right(self._starts, time_s.max()) - 1, 0)
        if first == last:
            return of(self._pieces[first], first, time_s)
        starts = np.array(self._starts[first : last + 1])
        times = time_s.ravel()
        index = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        order = np.argsort(index, kind="stable")
        values = np.empty(times.shape)
        for here in np.split(order, np.flatnonzero(np.diff(index[order])) + 1):
            k = first + int(index[here[0]])
            values[here] = of(self._pieces[k], k, times[here])
        return values.reshape(time_s.shape)


def mean_products(histories: Sequence[CurrentHistory], edges_s: Array) -> Array:
    """Return the exact means of i_j i_k between neighbouring times, shape (intervals, n, n), in A².

    Between two changes of any level each current is a level plus one exponential, so the
    products integrate in closed form.
    """
    n = len(histories)
    inner = [history.breakpoints(edges_s[0], edges_s[-1]) for history in histories]
    grid = np.unique(np.concatenate([edges_s, *inner]))
    span = np.diff(grid)
    # The level is asked for in the middle, where rounding cannot pick the neighbouring step.
    middles = grid[:-1] + span / 2
    levels = [history.level(middles) for history in histories]
    distances = [
        history.current(grid[:-1]) - level for history, level in zip(histories, levels, strict=True)
    ]
    rates = [1.0 / history.tau_s for history in histories]
    single = [-np.expm1(-span * rate) / rate for rate in rates]
    owner = np.searchsorted(edges_s, middles, side="right") - 1
    length = np.diff(edges_s)
    result = np.empty((length.size, n, n))
    for j in range(n):
        for k in range(j, n):
            both = rates[j] + rates[k]
            integral = (
                levels[j] * levels[k] * span
                + levels[j] * distances[k] * single[k]
                + levels[k] * distances[j] * single[j]
                + distances[j] * distances[k] * -np.expm1(-span * both) / both
            )
            total = np.bincount(owner, weights=integral, minlength=length.size)
            result[:, j, k] = result[:, k, j] = total / length
    return result
