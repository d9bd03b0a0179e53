"""One channel of a function generator: levels, termination, limits, burst, and what a coil gets.

As guides of such generators have it, whoever made them: 50 ohm in series with the output; the
termination setting changes what is shown and never the output, so what is programmed for 50 ohm is
doubled at an open end; it cannot be changed while voltage limits are on; |offset| + Vpp/2 has a
largest value at an open end; a level beyond a limit is clipped, with an error; setting one level
beyond the other moves that one; a new offset is kept and the amplitude gives way, and a burst of DC
is refused. Assumed: the words of these errors; that a pulse waits at its low level; that an output
that is inverted is mirrored about the offset; that a change in the middle of a burst ends it. What
runs without burst reaches the coil with its mean.
"""

from __future__ import annotations

import math

from sim_instruments.generic.waveform import CONFLICT, Wave, clipped
from sim_instruments.wire.scpi import ScpiError, number, number_or
from sim_instruments.world.serf_coils import VoltageHistory

SOURCE_OHM = 50.0
OPEN = 9.9e37
ROUNDING_V = 1e-9
MAX_CYCLES = 1000
"""Of a burst that reach the coil here."""
NO_BURST = ("DC", "NOIS", "PRBS")


class GeneratorChannel:
    """One output. Amplitude and offset are kept as they are at an open end, in V.

    `history` is what reaches the coil, with the channel's own `gain_error` and `offset_V`.
    """

    def __init__(
        self, history: VoltageHistory, gain_error: float, offset_V: float, wave: Wave
    ) -> None:
        self.history, self.wave = history, wave
        self._gain, self._error_V = 1.0 + gain_error, offset_V
        self._ratings, self._complain = wave.ratings, wave.complain
        self.reset()

    def reset(self) -> None:
        """Go to a sine of 100 mVpp into 50 ohm, the output off."""
        self.wave.reset()
        self.on, self.inverted = False, False
        self.load_ohm, largest_V = SOURCE_OHM, self._ratings.largest_V
        self._amplitude_V, self._offset_V = 0.2, 0.0
        self.limited, self.low_limit_V, self.high_limit_V = False, -largest_V, largest_V
        self.burst, self.mode, self.cycles = False, "TRIG", 1.0
        self.source, self.slope, self.delay_s = "IMM", "POS", 0.0
        self._busy_until_s = -math.inf

    @property
    def share(self) -> float:
        """What a load as it is set gets of the voltage at an open end."""
        return self.load_ohm / (self.load_ohm + SOURCE_OHM) if self.load_ohm < OPEN else 1.0

    @property
    def amplitude_V(self) -> float:
        """The amplitude, peak to peak, as it is shown."""
        return self._amplitude_V * self.share

    @property
    def offset_V(self) -> float:
        """The offset as it is shown."""
        return self._offset_V * self.share

    @property
    def high_V(self) -> float:
        """The high level as it is shown."""
        return (self._offset_V + self._amplitude_V / 2) * self.share

    @property
    def low_V(self) -> float:
        """The low level as it is shown."""
        return (self._offset_V - self._amplitude_V / 2) * self.share

    @property
    def largest_V(self) -> float:
        """The largest voltage as it is shown."""
        return self._ratings.largest_V * self.share

    def set_load(self, text: str) -> None:
        """Say what the output is terminated with; what is shown changes with it."""
        loads_ohm = self._ratings.loads_ohm
        is_open = text.upper() in ("INF", "INFINITY")
        load_ohm = OPEN if is_open else self.wave.number(text, *loads_ohm, SOURCE_OHM)
        if self.limited:
            raise ScpiError(CONFLICT)
        before = self.share
        self.load_ohm = load_ohm
        self.low_limit_V *= self.share / before
        self.high_limit_V *= self.share / before

    def set_function(self, name: str) -> None:
        """Change the function; a burst of what has none ends."""
        self._end_burst_of_none(name)
        self.wave.function = name
        if name != "DC":
            self._make_room_for_offset()

    def set_burst(self, on: bool) -> None:
        """Switch the burst on or off."""
        self.burst = on
        self._end_burst_of_none(self.wave.function)

    def _end_burst_of_none(self, function: str) -> None:
        if self.burst and function in NO_BURST:
            self.burst = False
            what = f"not able to burst {function.lower()}, burst has been turned off"
            self._complain(CONFLICT, what)

    def set_offset(self, text: str) -> None:
        """Set the offset; where both do not fit, the amplitude becomes smaller."""
        wanted_V = number_or(text, {"MIN": -self.largest_V, "MAX": self.largest_V})
        self._offset_V = self._clipped(wanted_V, -self.largest_V, self.largest_V) / self.share
        if self.wave.function == "DC":
            self._offset_V = self._limited(self.offset_V) / self.share
        else:
            self._make_room_for_offset()
            self._keep_limits()

    def set_amplitude(self, text: str) -> None:
        """Set the amplitude; where both do not fit, the offset becomes smaller."""
        least_V, most_V = self._ratings.least_Vpp * self.share, 2 * self.largest_V
        wanted_V = number_or(text, {"MIN": least_V, "MAX": most_V})
        self._amplitude_V = self._clipped(wanted_V, least_V, most_V) / self.share
        room_V = self._ratings.largest_V - self._amplitude_V / 2
        if self.wave.function != "DC" and abs(self._offset_V) > room_V + ROUNDING_V:
            self._offset_V = math.copysign(room_V, self._offset_V)
            self._complain(CONFLICT, "offset changed due to amplitude")
        self._keep_limits()

    def set_high(self, text: str) -> None:
        """Set the high level; a low level above it goes below it."""
        apart_V = self._ratings.apart_V
        high_V = self._clipped(number(text), -self.largest_V + apart_V, self.largest_V)
        low_V = self.low_V
        if low_V > high_V - apart_V + ROUNDING_V:
            low_V = high_V - apart_V
            self._complain(CONFLICT, "low level changed due to high level")
        self._set_levels(low_V, high_V)

    def set_low(self, text: str) -> None:
        """Set the low level; a high level below it goes above it."""
        apart_V = self._ratings.apart_V
        low_V = self._clipped(number(text), -self.largest_V, self.largest_V - apart_V)
        high_V = self.high_V
        if high_V < low_V + apart_V - ROUNDING_V:
            high_V = low_V + apart_V
            self._complain(CONFLICT, "high level changed due to low level")
        self._set_levels(low_V, high_V)

    def limit_V(self, text: str) -> float:
        """Return one of the voltage limits."""
        return self._clipped(number(text), -self.largest_V, self.largest_V)

    def set_limited(self, on: bool) -> None:
        """Switch the voltage limits on or off; levels that are beyond them are in their way."""
        low_V, high_V = (
            (self.offset_V, self.offset_V)
            if self.wave.function == "DC"
            else (self.low_V, self.high_V)
        )
        inside = self.low_limit_V <= low_V and high_V <= self.high_limit_V
        if on and (not inside or self.low_limit_V >= self.high_limit_V):
            raise ScpiError(CONFLICT)
        self.limited = on

    def apply(self, now_s: float) -> None:
        """Let the coil have what the settings say, from now on; a burst that runs ends."""
        self._busy_until_s = -math.inf
        if self.wave.function == "DC":
            level = 0.0
        else:
            level = self.wave.idle() if self.waits else self.wave.mean()
        self.history.set(now_s, self._given_V(level))

    @property
    def waits(self) -> bool:
        """Whether a burst waits for a trigger that does not come by itself."""
        return self.burst and self.source in ("EXT", "BUS") and self.mode == "TRIG"

    def trigger(self, now_s: float, latency_s: float) -> None:
        """Take a trigger: play the burst; one that comes before the last burst ends is lost."""
        if not self.waits or now_s < self._busy_until_s:
            return
        start_s = now_s + self.delay_s + latency_s
        cycle_s, cycles = self.wave.cycle_s(), int(min(self.cycles, MAX_CYCLES))
        self.history.set(start_s, self.history.now_V(start_s))
        for cycle in range(cycles):
            for after_s, level in self.wave.levels():
                self.history.then(start_s + cycle * cycle_s + after_s, self._given_V(level))
        self._busy_until_s = start_s + cycles * cycle_s
        self.history.then(self._busy_until_s, self._given_V(self.wave.idle()))

    def _given_V(self, level: float) -> float:
        """Return what the coil gets at a level of the waveform, -1 to 1."""
        if not self.on:
            return 0.0
        sign = -1.0 if self.inverted else 1.0
        open_V = self._offset_V
        if self.wave.function != "DC":
            open_V += sign * level * self._amplitude_V / 2
        return self._gain * open_V + self._error_V

    def _set_levels(self, low_V: float, high_V: float) -> None:
        self._amplitude_V = (high_V - low_V) / self.share
        self._offset_V = (high_V + low_V) / 2 / self.share
        self._keep_limits()

    def _make_room_for_offset(self) -> None:
        room_V = 2 * (self._ratings.largest_V - abs(self._offset_V))
        if self._amplitude_V > max(room_V, self._ratings.least_Vpp) + ROUNDING_V:
            self._amplitude_V = max(room_V, self._ratings.least_Vpp)
            self._complain(CONFLICT, "amplitude changed due to offset")

    def _keep_limits(self) -> None:
        if self.limited and self.wave.function != "DC":
            low_V, high_V = self._limited(self.low_V), self._limited(self.high_V)
            if (low_V, high_V) != (self.low_V, self.high_V):
                self._amplitude_V = max((high_V - low_V) / self.share, self._ratings.least_Vpp)
                self._offset_V = (high_V + low_V) / 2 / self.share

    def _limited(self, level_V: float) -> float:
        if not self.limited:
            return level_V
        kept_V = min(max(level_V, self.low_limit_V), self.high_limit_V)
        if abs(kept_V - level_V) <= ROUNDING_V:
            return level_V
        self._complain(CONFLICT, "level clipped due to voltage limit")
        return kept_V

    def _clipped(self, value_V: float, lowest_V: float, highest_V: float) -> float:
        return clipped(self._complain, value_V, lowest_V, highest_V, ROUNDING_V)
