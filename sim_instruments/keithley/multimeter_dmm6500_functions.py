"""What a Keithley DMM6500 measures, and what it puts on readings: filter, relative offset, math.

From public notes that quote the manual DMM6500-901-01 with its pages (13-25 to 13-31 math, 13-83
aperture, 13-92 to 13-98 filter and auto-zero, 13-103 to 13-120 delays, bandwidth, impedance,
integration time, ranges, relative offset, 13-129 digitizing, 13-136 threshold, 13-138 transducer),
from PyMeasure, which names the bounds, and the answers of a unit in its tests. The defaults and the
order offset, then math are those of the 2461 of the same family (its manual, 6-19 to 6-72).
Assumed: which functions have which setting, where PyMeasure does not say it, and the digits after
`*RST`. A thermocouple is open; a resistance thermometer is the world's Pt100.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from sim_instruments.generic.converter import OVERLOAD_READING, Converter, Function
from sim_instruments.wire.scpi import (
    ScpiError,
    boolean,
    numeric,
    single_parameter,
    unquoted,
    whole_number,
    word,
)
from sim_instruments.wire.scpi_device import Listed, Value
from sim_instruments.world.piecewise import Array

VOLTS = (0.1, 1.0, 10.0, 100.0, 1000.0)
AMPERES = (1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 3.0)
OHMS = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8)
FARADS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
THRESHOLDS_V = (0.1, 1.0, 10.0, 100.0, 750.0)
BIASES_A = (1e-5, 1e-4, 1e-3, 1e-2)
BANDWIDTHS_HZ = (3.0, 30.0, 300.0)
RATES_PER_S = (1e3, 1e6)
MIN_CYCLES = 0.0005
GATES_S = (2e-3, 0.273)
USER_DELAYS_S = (167e-9, 10e3)
LARGEST_FACTOR = 1e12
PT100 = (3.9083e-3, -5.775e-7, -4.183e-12)
"""IEC 60751, of the ratio to the resistance at 0 degC."""


@dataclass
class Measured(Function):
    """A function with what this meter has besides."""

    high_input: str = "MOHM10"
    filtered: bool = False
    filter_kind: str = "REP"
    filter_count: int = 10
    nulled: bool = False
    null: float = 0.0
    scaled: bool = False
    operation: str = "PERC"
    factor: float = 1.0
    summand: float = 0.0
    reference: float = 1.0
    digits: int = 6
    bandwidth_Hz: float = 3.0
    threshold_V: float = 10.0
    automatic_threshold: bool = True
    bias_A: float = 1e-3
    automatic_delay: bool = True
    user_delays_s: dict[int, float] = field(default_factory=lambda: dict.fromkeys(range(1, 6), 0.0))
    sensor: str = "TC"
    unit_of_temperature: str = "CELS"
    rate_per_s: float = 1e6
    automatic_aperture: bool = True
    digitizes: bool = False
    stack: list[float] = field(default_factory=list, compare=False)


RANGED, ZEROED, PARTED = ("range",), ("cycles", "zero"), ("filter",)
HAS: dict[str, tuple[str, tuple[str, ...], float]] = {
    "VOLT:DC": ("VOLTage[:DC]", (*RANGED, *ZEROED, *PARTED, "input", "delay"), 1000.0),
    "VOLT:AC": ("VOLTage:AC", (*RANGED, *PARTED, "bandwidth", "delay"), 750.0),
    "CURR:DC": ("CURRent[:DC]", (*RANGED, *ZEROED, *PARTED, "delay"), 3.0),
    "CURR:AC": ("CURRent:AC", (*RANGED, *PARTED, "bandwidth", "delay"), 3.0),
    "RES": ("RESistance", (*RANGED, *ZEROED, *PARTED, "delay"), 1e8),
    "FRES": ("FRESistance", (*RANGED, *ZEROED, *PARTED, "delay"), 1e8),
    "DIOD": ("DIODe", (*ZEROED, *PARTED, "bias", "delay"), 10.0),
    "CAP": ("CAPacitance", (*RANGED, *PARTED, "delay"), 1e-3),
    "TEMP": ("TEMPerature", (*ZEROED, *PARTED, "sensor", "delay"), 3310.0),
    "CONT": ("CONTinuity", ("cycles", "delay"), 1e3),
    "FREQ:VOLT": ("FREQuency[:VOLTage]", ("gate", "threshold", "delay"), 1e6),
    "PER:VOLT": ("PERiod[:VOLTage]", ("gate", "threshold", "delay"), 1.0),
    "VOLT:DC:RAT": ("VOLTage[:DC]:RATio", (*RANGED, *ZEROED, *PARTED, "input", "delay"), 1e6),
    "DIG:VOLT": ("DIGitize:VOLTage", ("range", "rate", "input"), 1000.0),
    "DIG:CURR": ("DIGitize:CURRent", ("range", "rate"), 3.0),
}
"""By the name that `SENS:FUNC?` gives: the header, what can be set, the largest offset."""
LONG = {
    "VOLTAGE": "VOLT",
    "CURRENT": "CURR",
    "RESISTANCE": "RES",
    "FRESISTANCE": "FRES",
    "DIODE": "DIOD",
    "CAPACITANCE": "CAP",
    "TEMPERATURE": "TEMP",
    "CONTINUITY": "CONT",
    "FREQUENCY": "FREQ",
    "PERIOD": "PER",
    "RATIO": "RAT",
}
WHOLE = {
    "VOLT": "VOLT:DC",
    "CURR": "CURR:DC",
    "FREQ": "FREQ:VOLT",
    "PER": "PER:VOLT",
    "VOLT:RAT": "VOLT:DC:RAT",
}


def functions() -> dict[str, Measured]:
    """Return the functions as after `*RST`, by the name that `SENS:FUNC?` gives."""
    made = {
        # The converter knows its functions by the short names of SCPI.
        "VOLT:DC": Measured("VOLT", "VDC", VOLTS, 1, range=1000.0, cycles=1.0),
        "VOLT:AC": Measured("VOLT:AC", "VAC", (*VOLTS[:-1], 750.0), 1, range=750.0, cycles=1.0),
        "CURR:DC": Measured("CURR", "ADC", AMPERES, 2, range=3.0, cycles=1.0),
        "CURR:AC": Measured("CURR:AC", "AAC", AMPERES[2:], 2, range=3.0, cycles=1.0),
        "RES": Measured("RES", "OHM", OHMS, 512, range=1e8, cycles=1.0),
        "FRES": Measured("FRES", "OHM", (1.0, *OHMS), 512, range=1e8, cycles=1.0),
        "DIOD": Measured("DIOD", "DIODE", (10.0,), 1, range=10.0, cycles=1.0),
        "CAP": Measured("CAP", "F", FARADS, 1, range=1e-3, cycles=1.0, can_zero=False),
        "TEMP": Measured("TEMP", "DEGC", (3310.0,), 1, range=3310.0, cycles=1.0),
        "CONT": Measured("CONT", "OHM", (1e3,), 512, range=1e3, cycles=0.006, zero_on=False),
        "FREQ:VOLT": Measured("FREQ", "HZ", (1e6,), 1, range=1e6, aperture_s=0.2),
        "PER:VOLT": Measured("PER", "S", (1.0,), 1, range=1.0, aperture_s=0.2),
        "VOLT:DC:RAT": Measured("VOLT:RAT", "RATIO", VOLTS, 1, range=1000.0, cycles=1.0),
        "DIG:VOLT": Measured("VOLT", "VDC", VOLTS, 1, range=1000.0, autorange=False),
        "DIG:CURR": Measured("CURR", "ADC", AMPERES, 2, range=3.0, autorange=False),
    }
    for name in ("FREQ:VOLT", "PER:VOLT", "DIG:VOLT", "DIG:CURR"):
        made[name].zero_on = False
    for name in ("DIG:VOLT", "DIG:CURR"):
        made[name].aperture_s = 1.0 / made[name].rate_per_s
        made[name].digits, made[name].digitizes = 4, True
    return made


def named(text: str) -> str:
    """Return the name of a function that stands between quotes; ScpiError -224 where it is none."""
    parts = [LONG.get(part, part) for part in unquoted(text).upper().split(":")]
    name = WHOLE.get(":".join(parts), ":".join(parts))
    if name not in HAS:
        raise ScpiError(-224)
    return name


class Readings:
    """Readings of a function: what the converter gives, filtered, less the offset, scaled."""

    def __init__(self, converter: Converter) -> None:
        self.converter = converter

    def busy_s(self, function: Measured) -> float:
        """Return how long one reading takes."""
        repeated = function.filtered and function.filter_kind == "REP"
        single_s = self.converter.busy_s(function)
        return single_s * (function.filter_count if repeated else 1)

    def pause_s(self, function: Measured, least_s: float) -> float:
        """Return what goes by between two readings; digitizing keeps its rate."""
        if not function.digitizes:
            return least_s
        return 1.0 / function.rate_per_s - self.converter.aperture_s(function)

    def of(self, function: Measured, starts_s: Array) -> Array:
        """Return the readings that begin at the given times, shape (readings,)."""
        values = self._filtered(function, starts_s) if function.filtered else None
        if values is None:
            values = self.unchanged(function, starts_s)
        over = np.abs(values) >= 0.99 * OVERLOAD_READING
        changed = values - function.null if function.nulled else values
        if function.scaled:
            changed = self._scaled(function, changed)
        return np.where(over, values, changed)

    def unchanged(self, function: Measured, starts_s: Array) -> Array:
        """Return readings without filter, offset and math."""
        if function.unit == "DEGC" and function.sensor != "TC":
            resistance = Measured("FRES", "OHM", OHMS, 512, cycles=function.cycles, range=1e3)
            return self._degrees(function, self.converter.read(resistance, starts_s))
        return self.converter.read(function, starts_s)

    def _degrees(self, function: Measured, ohm: Array) -> Array:
        a, b, c = PT100
        degC = (np.minimum(ohm, 1e3) / 100.0 - 1.0) / a
        for _ in range(6):
            below = np.where(degC < 0.0, c * (degC - 100.0) * degC**3, 0.0)
            degC = degC - (1.0 + a * degC + b * degC**2 + below - ohm / 100.0) / a
        shown = {"CELS": degC, "KELV": degC + 273.15, "FAHR": 1.8 * degC + 32.0}
        beyond = ohm >= 1e3
        return np.where(beyond, OVERLOAD_READING, shown[function.unit_of_temperature])

    def _filtered(self, function: Measured, starts_s: Array) -> Array:
        count = function.filter_count
        if function.filter_kind == "REP":
            parts_s = np.arange(count) * self.converter.busy_s(function)
            each = self.unchanged(function, (starts_s[:, None] + parts_s).ravel())
            parts = each.reshape(-1, count)
            over = np.abs(parts).max(axis=1) >= 0.99 * OVERLOAD_READING
            return np.where(over, OVERLOAD_READING, parts.mean(axis=1))
        values = []
        for value in self.unchanged(function, starts_s).tolist():
            if abs(value) >= 0.99 * OVERLOAD_READING:
                values.append(value)
                continue
            # The first one fills the stack.
            function.stack = [*(function.stack or [value] * count)[1:], value]
            values.append(sum(function.stack) / count)
        return np.array(values)

    @staticmethod
    def _scaled(function: Measured, values: Array) -> Array:
        if function.operation == "MXB":
            return function.factor * values + function.summand
        if function.operation == "PERC":
            return 100.0 * (values - function.reference) / function.reference
        with np.errstate(divide="ignore"):
            inverse = 1.0 / values
        return np.where(np.isfinite(inverse), inverse, OVERLOAD_READING)


Change = Callable[[str, str, object], None]
"""Takes the function's name, the setting's and its value."""


class FunctionCommands:
    """The tables of commands of each function; `change` carries a setting out, or refuses it."""

    def __init__(
        self, functions: Callable[[], Mapping[str, Measured]], mains_Hz: float, change: Change
    ) -> None:
        self._functions, self._mains_Hz, self._change = functions, mains_Hz, change

    def sense(self, name: str) -> dict[str, Value]:
        """Return the settings below `SENSe:<function>`."""
        largest = HAS[name][2]
        table: dict[str, Value] = {
            "RELative[:LEVel]": self._number(name, "null", -largest, largest, 0.0),
            "RELative:STATe": self._word(name, "nulled", boolean),
        }
        for what in HAS[name][1]:
            table |= getattr(self, f"_{what}")(name)
        return table

    def math(self, name: str) -> dict[str, Value]:
        """Return the settings below `CALCulate:<function>:MATH`."""
        bounds = (-LARGEST_FACTOR, LARGEST_FACTOR)
        return {
            "STATe": self._word(name, "scaled", boolean),
            "FORMat": self._word(name, "operation", word("MXB", "PERCent", "RECiprocal")),
            "MMFactor": self._number(name, "factor", *bounds, 1.0),
            "MBFactor": self._number(name, "summand", *bounds, 0.0),
            "PERCent": self._number(name, "reference", *bounds, 1.0),
        }

    def display(self, name: str) -> dict[str, Value]:
        """Return the settings below `DISPlay:<function>`; readings keep all their digits."""
        default = functions()[name].digits
        return {"DIGits": self._number(name, "digits", 3, 6, default, whole=True)}

    def _word(self, name: str, what: str, read: Callable[[str], object]) -> Value:
        return (
            lambda text: self._change(name, what, read(text)),
            lambda: getattr(self._functions()[name], what),
        )

    def _number(
        self, name: str, what: str, low: float, high: float, default: float, *, whole: bool = False
    ) -> Listed:
        def read(text: str) -> float:
            value = numeric(text, low, high, default)
            return round(value) if whole else value

        return Listed(
            lambda given: self._change(name, what, read(single_parameter(given))),
            lambda given: written(
                read(single_parameter(given)) if given else getattr(self._functions()[name], what)
            ),
        )

    def _among(self, name: str, what: str, values: tuple[float, ...], default: float) -> Listed:
        """Return a number that is one of some; ScpiError -224 for any other."""

        def read(text: str) -> float:
            value = numeric(text, values[0], values[-1], default)
            if not any(abs(value - known) <= 1e-6 * known for known in values):
                raise ScpiError(-224)
            return value

        plain = self._number(name, what, values[0], values[-1], default)
        return Listed(
            lambda given: self._change(name, what, read(single_parameter(given))), plain.give
        )

    def _upper(self, name: str, what: str, ranges: tuple[float, ...], switch: str) -> Listed:
        """Return a range, which ends what chooses it by itself."""

        def take(given: list[str]) -> None:
            text = single_parameter(given)
            if text.startswith("-"):
                raise ScpiError(-222)
            wanted = numeric(text, min(0.0, ranges[0]), ranges[-1], ranges[-1])
            wanted = ranges[0] if text.upper().startswith("MIN") else wanted
            self._change(name, what, next(full for full in ranges if wanted <= full))
            self._change(name, switch, False)

        return Listed(take, self._number(name, what, ranges[0], ranges[-1], ranges[-1]).give)

    def _range(self, name: str) -> dict[str, Value]:
        table: dict[str, Value] = {
            "RANGe[:UPPer]": self._upper(name, "range", functions()[name].ranges, "autorange")
        }
        if not name.startswith("DIG"):
            table["RANGe:AUTO"] = self._word(name, "autorange", boolean)
        return table

    def _cycles(self, name: str) -> dict[str, Value]:
        most = 15.0 if self._mains_Hz == 60.0 else 12.0
        cycles = self._number(name, "cycles", MIN_CYCLES, most, functions()[name].cycles)
        low_s, high_s = MIN_CYCLES / self._mains_Hz, most / self._mains_Hz

        def read_s(given: list[str]) -> float:
            return numeric(single_parameter(given), low_s, high_s, 1.0 / self._mains_Hz)

        def shown(given: list[str]) -> str:
            return written(
                read_s(given) if given else self._functions()[name].cycles / self._mains_Hz
            )

        # Both are views of the same setting.
        aperture = Listed(
            lambda given: self._change(name, "cycles", read_s(given) * self._mains_Hz), shown
        )
        return {"NPLCycles": cycles, "APERture": aperture}

    def _zero(self, name: str) -> dict[str, Value]:
        return {"AZERo[:STATe]": self._word(name, "zero_on", boolean)}

    def _filter(self, name: str) -> dict[str, Value]:
        return {
            "AVERage[:STATe]": self._word(name, "filtered", boolean),
            "AVERage:COUNt": self._number(name, "filter_count", 1, 100, 10, whole=True),
            "AVERage:TCONtrol": self._word(name, "filter_kind", word("REPeat", "MOVing")),
        }

    def _input(self, name: str) -> dict[str, Value]:
        return {"INPutimpedance": self._word(name, "high_input", word("AUTO", "MOHM10"))}

    def _bandwidth(self, name: str) -> dict[str, Value]:
        return {"DETector:BANDwidth": self._among(name, "bandwidth_Hz", BANDWIDTHS_HZ, 3.0)}

    def _bias(self, name: str) -> dict[str, Value]:
        return {"BIAS:LEVel": self._among(name, "bias_A", BIASES_A, 1e-3)}

    def _gate(self, name: str) -> dict[str, Value]:
        return {"APERture": self._number(name, "aperture_s", *GATES_S, 0.2)}

    def _threshold(self, name: str) -> dict[str, Value]:
        switch = "automatic_threshold"
        return {
            "THReshold:RANGe": self._upper(name, "threshold_V", THRESHOLDS_V, switch),
            "THReshold:RANGe:AUTO": self._word(name, switch, boolean),
        }

    def _delay(self, name: str) -> dict[str, Value]:
        table: dict[str, Value] = {"DELay:AUTO": self._word(name, "automatic_delay", boolean)}
        for n in range(1, 6):
            table[f"DELay:USER{n}"] = Listed(
                partial(self._set_delay, name, n),
                lambda _, n=n: written(self._functions()[name].user_delays_s[n]),  # type: ignore[misc]
            )
        return table

    def _set_delay(self, name: str, n: int, given: list[str]) -> None:
        delay_s = numeric(single_parameter(given), 0.0, USER_DELAYS_S[1], 0.0)
        if 0.0 < delay_s < USER_DELAYS_S[0]:
            raise ScpiError(-222)
        delays_s = self._functions()[name].user_delays_s
        self._change(name, "user_delays_s", {**delays_s, n: delay_s})

    def _sensor(self, name: str) -> dict[str, Value]:
        return {
            "TRANsducer": self._word(name, "sensor", word("TCouple", "RTD", "FRTD")),
            "UNIT": self._word(
                name, "unit_of_temperature", word("CELSius", "KELVin", "FAHRenheit")
            ),
            "RTD:FOUR": (word("PT100"), lambda: "PT100"),
            "RTD:TWO": (word("PT100"), lambda: "PT100"),
        }

    def _rate(self, name: str) -> dict[str, Value]:
        rate = self._number(name, "rate_per_s", *RATES_PER_S, RATES_PER_S[1], whole=True)

        def take_rate(given: list[str]) -> None:
            per_s = whole_number(single_parameter(given), 1000, 1_000_000)
            function = self._functions()[name]
            longest_s = 1.0 / per_s
            self._change(name, "rate_per_s", per_s)
            if function.automatic_aperture or (function.aperture_s or 0.0) > longest_s:
                self._change(name, "aperture_s", longest_s)

        def take_aperture(given: list[str]) -> None:
            text = single_parameter(given)
            longest_s = 1.0 / self._functions()[name].rate_per_s
            automatic = text.upper() in ("AUTO", "DEF", "DEFAULT")
            wanted_s = longest_s if automatic else numeric(text, 1e-6, longest_s, longest_s)
            self._change(name, "automatic_aperture", automatic)
            self._change(name, "aperture_s", wanted_s)

        def shown(_: list[str]) -> str:
            function = self._functions()[name]
            return "AUTO" if function.automatic_aperture else written(function.aperture_s or 0.0)

        return {"SRATe": Listed(take_rate, rate.give), "APERture": Listed(take_aperture, shown)}


def written(value: float) -> str:
    """Return a number as the meter answers it."""
    return str(value) if isinstance(value, int) else f"{value:.7G}"
