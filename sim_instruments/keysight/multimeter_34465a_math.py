"""What a Keysight 34465A makes of its readings: NULL and CALC, statistics, limits, histogram.

From pages of the Truevolt guide: limits (p. 214: bits 11 and 12 of the questionable register, both
0 after CONFigure), histogram (p. 217, 219: the bins below and above included, its range by itself
from the first 1000 readings, 9.91E+37 while there are none), scaling (p. 222 to 224: dB, dBm,
percent and Mx-B, of which functions, off with another function, 9.9E+37 beyond 1E+24), and from its
list of commands. A reference by itself is the first reading. Assumed: the order null, scale, then
limits and statistics; -221 for a scaling that a function does not have; 9.91E+37 for statistics of
nothing; SCAL and a gain of 1 after `*RST` (the guide gives 1 and 0); that each INITiate begins
statistics and histogram anew. Left out: smoothing, the trend chart, units of scaled readings are
only kept.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sim_instruments.generic.converter import OVERLOAD_READING, Function
from sim_instruments.wire.scpi import (
    ScpiError,
    boolean,
    numeric,
    single_parameter,
    unquoted,
    word,
)
from sim_instruments.wire.scpi_device import Listed, ScpiDevice, Value
from sim_instruments.world.piecewise import Array

NOT_A_NUMBER = 9.91e37
LARGEST = 1e15
RESULTS = (1e-24, 1e24)
LOWER_FAILED, UPPER_FAILED = 2048, 4096
BINS = (10, 20, 40, 100, 200, 400)
RANGED_BY = 1000
"""So many readings set the range of a histogram by themselves."""
OHMS = (50, 75, 93, 110, 124, 125, 135, 150, 250, 300, 500, 600, 800, 900, 1000, 1200, 8000)
IN_DB, WITHOUT = ("VOLT", "VOLT:AC"), ("VOLT:RAT", "CONT", "DIOD")


class Null:
    """The value that is taken off readings of a function."""

    def __init__(self, largest: float) -> None:
        self.largest = largest
        self.on, self.automatic, self.value = False, True, 0.0

    def of(self, values: Array) -> Array:
        """Return readings less the value, which may be the first of them."""
        if not self.on:
            return values
        if self.automatic:
            whole = values[np.abs(values) < OVERLOAD_READING * 0.99]
            if not len(whole):
                return values
            self.value, self.automatic = float(whole[0]), False
        return np.where(overloaded(values), values, values - self.value)

    def commands(self) -> dict[str, Value]:
        """Return the commands below the function's header."""

        def set_value(given: list[str]) -> None:
            limits = (-self.largest, self.largest, 0.0)
            self.value = numeric(single_parameter(given), *limits)
            self.automatic = False

        def switch(text: str) -> None:
            self.on = boolean(text)
            self.automatic = self.on or self.automatic

        return {
            "NULL[:STATe]": (switch, lambda: self.on),
            "NULL:VALue": Listed(set_value, asked(lambda: self.value, self.largest)),
            "NULL:VALue:AUTO": (self._set_automatic, lambda: self.automatic),
        }

    def _set_automatic(self, text: str) -> None:
        self.automatic = boolean(text)


class Scale:
    """Readings in dB, dBm, percent, or as Mx-B."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Go to the state after `*RST`."""
        self.on, self.function = False, "SCAL"
        self.gain, self.offset, self.reference, self.db_reference = 1.0, 0.0, 0.0, 0.0
        self.ohm, self.automatic, self.unit, self.shows_unit = 600.0, True, "", False

    def of(self, values: Array) -> Array:
        """Return readings as they are scaled."""
        if not self.on:
            return values
        over = overloaded(values)
        results = np.where(over, values, self._results(np.where(over, 0.0, values), ~over))
        size = np.abs(results)
        results = np.where(size < RESULTS[0], 0.0, results)
        return np.where(size > RESULTS[1], np.copysign(OVERLOAD_READING, results), results)

    def _results(self, values: Array, usable: NDArray[np.bool_]) -> Array:
        if self.function == "SCAL":
            return self.gain * values - self.offset
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.function == "PCT":
                self.reference = self._taken(values, usable, self.reference)
                changed = (values - self.reference) / self.reference * 100.0
            else:
                changed = 10.0 * np.log10(values**2 / self.ohm / 1e-3)
                if self.function == "DB":
                    self.db_reference = self._taken(changed, usable, self.db_reference)
                    changed = changed - self.db_reference
        return np.nan_to_num(
            changed, nan=OVERLOAD_READING, posinf=OVERLOAD_READING, neginf=-OVERLOAD_READING
        )

    def _taken(self, values: Array, usable: NDArray[np.bool_], kept: float) -> float:
        """Return the reference: the first reading where it is chosen by itself."""
        if not (self.automatic and usable.any()):
            return kept
        self.automatic = False
        return float(values[usable.argmax()])

    def switch(self, on: bool, function: Function) -> None:
        """Scale from now on; ScpiError -221 where the function cannot be scaled so."""
        in_db = self.function in ("DB", "DBM")
        if on and (function.name in WITHOUT or (in_db and function.name not in IN_DB)):
            raise ScpiError(-221)
        self.on = on


class Statistics:
    """Mean, deviation and extremes of all readings since they began."""

    def __init__(self) -> None:
        self.on = False
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self._values: list[Array] = []

    def take(self, values: Array) -> None:
        """Count readings that are no overloads."""
        if self.on:
            self._values.append(values[~overloaded(values)])

    def results(self) -> dict[str, float]:
        """Return all statistics by the names of their queries."""
        values = np.concatenate(self._values) if self._values else np.empty(0)
        if not len(values):
            names = ("AVERage", "SDEViation", "MINimum", "MAXimum", "PTPeak")
            return {**dict.fromkeys(names, NOT_A_NUMBER), "COUNt": 0.0}
        low, high = float(values.min()), float(values.max())
        deviation = float(values.std(ddof=1)) if len(values) > 1 else 0.0
        return {
            "AVERage": float(values.mean()),
            "SDEViation": deviation,
            "MINimum": low,
            "MAXimum": high,
            "PTPeak": high - low,
            "COUNt": float(len(values)),
        }


class Limits:
    """Two limits, and whether a reading was beyond them."""

    def __init__(self) -> None:
        self.on = False
        self.reset()

    def reset(self) -> None:
        """Set both to 0."""
        self.lower, self.upper = 0.0, 0.0
        self.clear()

    def clear(self) -> None:
        """Forget what failed."""
        self.failed = 0

    def take(self, values: Array) -> None:
        """Compare readings."""
        if self.on:
            self.failed |= LOWER_FAILED if (values < self.lower).any() else 0
            self.failed |= UPPER_FAILED if (values > self.upper).any() else 0


class Histogram:
    """How many readings are in each bin, below and above."""

    def __init__(self) -> None:
        self.on = False
        self.reset()

    def reset(self) -> None:
        """Go to 100 bins whose range sets itself."""
        self.bins, self.automatic, self.lower, self.upper = 100, True, 0.0, 0.0
        self.clear()

    def clear(self) -> None:
        """Forget the readings."""
        self._values: list[Array] = []

    def take(self, values: Array) -> None:
        """Count readings that are no overloads."""
        if self.on:
            self._values.append(values[~overloaded(values)])

    def range(self) -> tuple[float, float]:
        """Return the ends of the range."""
        if not self.automatic:
            return self.lower, self.upper
        first = self._all()[:RANGED_BY]
        return (float(first.min()), float(first.max())) if len(first) else (NOT_A_NUMBER,) * 2

    def counts(self) -> list[int]:
        """Return the readings below, in each bin, and above."""
        values, (low, high) = self._all(), self.range()
        inside = values[(values >= low) & (values <= high)]
        per_bin = np.zeros(self.bins, dtype=np.int64)
        if high > low:
            per_bin = np.histogram(inside, bins=self.bins, range=(low, high))[0]
        else:  # all readings may be the same
            per_bin[0] = len(inside)
        return [int((values < low).sum()), *per_bin.tolist(), int((values > high).sum())]

    def count(self) -> int:
        """Return how many readings there are."""
        return len(self._all())

    def _all(self) -> Array:
        return np.concatenate(self._values) if self._values else np.empty(0)


class Math:
    """All of it, for the functions of one meter; `chosen` tells the present one."""

    def __init__(self, functions: dict[str, Function], chosen: Callable[[], Function]) -> None:
        self._functions, self._chosen = functions, chosen
        self.scale, self.statistics = Scale(), Statistics()
        self.limits, self.histogram = Limits(), Histogram()
        self._nulls = {name: Null(1.2 * each.ranges[-1]) for name, each in functions.items()}
        self._scaled_function = ""

    def reset(self) -> None:
        """Go to the state after `*RST`, which CONFigure goes to as well."""
        self.scale.reset()
        self.limits.reset()
        self.histogram.reset()
        self.statistics.on = self.limits.on = self.histogram.on = False
        self.clear()
        for null in self._nulls.values():
            null.on, null.automatic, null.value = False, True, 0.0

    def clear(self) -> None:
        """Forget statistics, failed limits and the histogram."""
        for part in (self.statistics, self.limits, self.histogram):
            part.clear()

    def function_changed(self) -> None:
        """Scale no more where another function is measured."""
        if self._chosen().name != self._scaled_function:
            self.scale.on, self._scaled_function = False, self._chosen().name

    def of(self, values: Array) -> Array:
        """Return readings with null and scaling, which are counted and compared as well."""
        values = self.scale.of(self._nulls[self._chosen().name].of(values))
        for part in (self.statistics, self.limits, self.histogram):
            part.take(values)
        return values

    def null_commands(self, name: str) -> dict[str, Value]:
        """Return the commands NULL of a function."""
        return self._nulls[name].commands()

    def add_to(self, device: ScpiDevice) -> None:
        """Add the commands CALCulate to a device."""
        table = {"CLEar[:IMMediate]": self.clear}
        parts = (self._scaling(), self._limits(), self._statistics(), self._histogram(), table)
        for part in parts:
            device.add_commands(part, "CALCulate:")

    def _scaling(self) -> dict[str, Value]:
        scale = self.scale

        def switch(text: str) -> None:
            scale.switch(boolean(text), self._chosen())

        def automatic(text: str) -> None:
            scale.automatic = boolean(text)

        def unit(text: str) -> None:
            if len(unquoted(text)) > 4:
                raise ScpiError(-223)
            scale.unit = unquoted(text)

        def resistance(given: list[str]) -> None:
            ohm = numeric(single_parameter(given), OHMS[0], OHMS[-1], 600.0)
            if ohm not in OHMS:
                raise ScpiError(-224)
            scale.ohm = ohm

        def function(text: str) -> None:
            scale.function = word("DB", "DBM", "PCT", "SCALe")(text)

        def shows(text: str) -> None:
            scale.shows_unit = boolean(text)

        return {
            "SCALe[:STATe]": (switch, lambda: scale.on),
            "SCALe:FUNCtion": (function, lambda: scale.function),
            "SCALe:GAIN": self._number(scale, "gain", LARGEST, 1.0),
            "SCALe:OFFSet": self._number(scale, "offset", LARGEST, 0.0),
            "SCALe:REFerence": self._number(scale, "reference", LARGEST, 0.0, ends_automatic=True),
            "SCALe:REFerence:AUTO": (automatic, lambda: scale.automatic),
            "SCALe:DB:REFerence": self._number(
                scale, "db_reference", 200.0, 0.0, ends_automatic=True
            ),
            "SCALe:DBM:REFerence": Listed(resistance, asked(lambda: scale.ohm, 8000.0, 50.0)),
            "SCALe:UNIT": (unit, lambda: f'"{scale.unit}"'),
            "SCALe:UNIT:STATe": (shows, lambda: scale.shows_unit),
        }

    def _limits(self) -> dict[str, Value]:
        limits = self.limits
        return {
            "LIMit[:STATe]": (partial(self._switch, limits), lambda: limits.on),
            "LIMit:LOWer[:DATA]": self._number(limits, "lower", LARGEST, 0.0),
            "LIMit:UPPer[:DATA]": self._number(limits, "upper", LARGEST, 0.0),
            "LIMit:CLEar[:IMMediate]": limits.clear,
        }

    def _statistics(self) -> dict[str, Value]:
        statistics = self.statistics
        every = ("AVERage", "SDEViation", "MINimum", "MAXimum")
        table: dict[str, Value] = {
            "AVERage[:STATe]": (partial(self._switch, statistics), lambda: statistics.on),
            "AVERage:CLEar[:IMMediate]": statistics.clear,
            "AVERage:ALL?": lambda: ",".join(
                f"{statistics.results()[name]:+.8E}" for name in every
            ),
        }
        for name in (*every, "PTPeak", "COUNt"):
            table[f"AVERage:{name}?"] = partial(lambda name: statistics.results()[name], name)
        return table

    def _histogram(self) -> dict[str, Value]:
        histogram, root = self.histogram, "TRANsform:HISTogram"

        def bins(given: list[str]) -> None:
            wanted = numeric(single_parameter(given), BINS[0], BINS[-1], 100)
            if wanted not in BINS:
                raise ScpiError(-224)
            histogram.bins = round(wanted)
            histogram.clear()

        def automatic(text: str) -> None:
            histogram.automatic = boolean(text)
            histogram.clear()

        def end(which: str, given: list[str]) -> None:
            setattr(histogram, which, numeric(single_parameter(given), -LARGEST, LARGEST, 0.0))
            histogram.automatic = False
            histogram.clear()

        def counts() -> str:
            return ",".join(f"{count:+d}" for count in histogram.counts())

        def everything() -> str:
            low, high = histogram.range()
            return f"{low:+.8E},{high:+.8E},{histogram.count():+d},{counts()}"

        return {
            f"{root}[:STATe]": (partial(self._switch, histogram), lambda: histogram.on),
            f"{root}:POINts": Listed(
                bins,
                lambda given: (
                    f"{round(numeric(given[0], 10, 400, 100)):+d}"
                    if given
                    else f"{histogram.bins:+d}"
                ),
            ),
            f"{root}:RANGe:AUTO": (automatic, lambda: histogram.automatic),
            f"{root}:RANGe:LOWer": Listed(
                partial(end, "lower"), asked(lambda: histogram.range()[0], LARGEST)
            ),
            f"{root}:RANGe:UPPer": Listed(
                partial(end, "upper"), asked(lambda: histogram.range()[1], LARGEST)
            ),
            f"{root}:CLEar[:IMMediate]": histogram.clear,
            f"{root}:COUNt?": lambda: f"{histogram.count():+d}",
            f"{root}:DATA?": counts,
            f"{root}:ALL?": everything,
        }

    @staticmethod
    def _switch(part: Statistics | Limits | Histogram, text: str) -> None:
        part.on = boolean(text)
        if part.on:
            part.clear()

    def _number(
        self,
        owner: Scale | Limits,
        name: str,
        largest: float,
        default: float,
        *,
        ends_automatic: bool = False,
    ) -> Listed:
        def take(given: list[str]) -> None:
            setattr(owner, name, numeric(single_parameter(given), -largest, largest, default))
            if ends_automatic:
                self.scale.automatic = False

        return Listed(take, asked(lambda: getattr(owner, name), largest, -largest, default))


def asked(
    present: Callable[[], float],
    largest: float,
    least: float | None = None,
    default: float = 0.0,
) -> Callable[[list[str]], str]:
    """Return what answers a number, or what MIN, MAX and DEF are."""
    low = -largest if least is None else least
    return lambda given: f"{numeric(given[0], low, largest, default) if given else present():+.8E}"


def overloaded(values: Array) -> NDArray[np.bool_]:
    """Return which readings are overloads."""
    return np.abs(values) >= 0.99 * OVERLOAD_READING
